/*
 * fetch_options: the command line of fetch.
 * Layer: clients. Threads: the main thread. Ownership: strings are the command line's.
 */
#ifndef LS_CLIENTS_FETCH_OPTIONS_H
#define LS_CLIENTS_FETCH_OPTIONS_H

#include "clients/command.h"

#include <stdbool.h>
#include <stdint.h>

struct ls_fetch_options {
    const char *channel; /* or several, "R,A,B" */
    const char *lights, *output;
    const char *coefficients; /* "harmonics", "gradients", or NULL: lights */
    struct lightstage_promotion promotion;
    enum lightstage_layout layout;
    bool estimate, half, full_sphere, promoted, validity, variance, factored;
    uint32_t camera, level;
    struct lightstage_region region;
    double max_error; /* 0: none given */
};

/** LS_EXIT_OK, the take being what is left; or the exit code, said already. */
int ls_fetch_options_parse(struct ls_command_context *context, int argc, char **argv,
                           struct ls_fetch_options *out);

#endif
