/*
 * take_text: the state of a take for people and for programs.
 * Layer: clients. Threads: the main thread. Ownership: JSON is (transfer full).
 */
#ifndef LS_CLIENTS_TAKE_TEXT_H
#define LS_CLIENTS_TAKE_TEXT_H

#include "clients/lightstage.h"

#include <jansson.h>

/** "running", "complete", ... Never NULL. */
const char *ls_take_state_word(enum lightstage_take_state state);

json_t *ls_take_status_json(const struct lightstage_take_status *status);

/** A few lines on stdout. */
void ls_take_status_print(const struct lightstage_take_status *status);

#endif
