/*
 * promotion_option: the options by which a user chooses how spectra come to each light.
 * Layer: clients. Threads: the main thread. Ownership: none.
 */
#ifndef LS_CLIENTS_PROMOTION_OPTION_H
#define LS_CLIENTS_PROMOTION_OPTION_H

#include "clients/lightstage.h"

/** For a command's table, before LS_COMMON_OPTIONS. */
enum { LS_OPTION_MODEL = 900, LS_OPTION_REFERENCE, LS_OPTION_IDEAL, LS_OPTION_PLAIN };
#define LS_PROMOTION_OPTIONS                                         \
    {"model", required_argument, NULL, LS_OPTION_MODEL},             \
        {"reference", required_argument, NULL, LS_OPTION_REFERENCE}, \
        {"ideal-polarisation", no_argument, NULL, LS_OPTION_IDEAL},  \
    {                                                                \
        "plain-conductors", no_argument, NULL, LS_OPTION_PLAIN       \
    }

/** One line of a command's usage. */
#define LS_PROMOTION_USAGE                                            \
    "         [--model measured|sphere|headlight|separated|linear]\n" \
    "         [--reference strengths|paper] [--ideal-polarisation] [--plain-conductors]\n"

/** Take one of these options into @out (initialised). LS_EXIT_OK; LS_EXIT_USAGE, said why, for a
 * word that is none, or (silently) an option that is not one of these. */
int ls_promotion_option(int option, const char *word, struct lightstage_promotion *out);

#endif
