/*
 * take_text: the state of a take for people and for programs.
 * Layer: clients. Threads: the main thread. Ownership: JSON is (transfer full).
 */
#ifndef LS_CLIENTS_TAKE_TEXT_H
#define LS_CLIENTS_TAKE_TEXT_H

#include "proto/lightstage.pb-c.h"

#include <jansson.h>

/** "running", "complete", ... Never NULL. */
const char *ls_take_state_word(Lightstage__TakeState state);

json_t *ls_take_status_json(const Lightstage__TakeStatus *status);

/** A few lines on stdout. Cleans the strings of @status. */
void ls_take_status_print(const Lightstage__TakeStatus *status);

#endif
