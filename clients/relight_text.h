/*
 * relight_text: what came of relighting, for people and for programs.
 * Layer: clients. Threads: the main thread. Ownership: the caller's.
 */
#ifndef LS_CLIENTS_RELIGHT_TEXT_H
#define LS_CLIENTS_RELIGHT_TEXT_H

#include "clients/relight_options.h"
#include "clients/relight_request.h"

#include <stdbool.h>
#include <stdint.h>

struct ls_relight_told {
    const struct ls_relight_options *options;
    const struct ls_light_weights *weights; /* [n] */
    const struct ls_relit *result;
    uint32_t n; /* pictures */
};

/** On standard output; warnings of the strengths on standard error. */
void ls_relight_print(const struct ls_relight_told *told, bool json);

/** The file of a picture, from 0, by the @name that was asked for; NULL without one, or out of
 * memory. (transfer full). */
char *ls_relight_name(const char *name, uint32_t picture);

#endif
