/*
 * config_read: read a libconfig group into a struct by a table of keys, refusing what the table
 * does not know.
 * Layer: sim. Threads: any; pure. Ownership: the caller owns target and table.
 */
#ifndef LS_SIM_CONFIG_READ_H
#define LS_SIM_CONFIG_READ_H

#include "core/error.h"

#include <libconfig.h>
#include <stddef.h>
#include <stdint.h>

enum sim_key_type {
    SIM_KEY_U32,
    SIM_KEY_U64,
    SIM_KEY_I32,
    SIM_KEY_DOUBLE,
    SIM_KEY_BOOL,
    SIM_KEY_STRING, /* char[size] */
    SIM_KEY_PATH,   /* char[size], relative to the file's folder */
    SIM_KEY_CHOICE, /* uint32_t: index into the words of choices */
    SIM_KEY_VECTOR, /* double[3] */
    SIM_KEY_OTHER,  /* known, read by somebody else */
};

struct sim_key {
    const char *name;
    enum sim_key_type type;
    size_t offset;       /* of the field in the target */
    double min, max;     /* of numbers, inclusive */
    size_t size;         /* of strings and paths, with the final NUL */
    const char *choices; /* space-separated */
};

/** A field of @type: the offset and, for strings, the size of it. */
#define SIM_FIELD(type, field) offsetof(type, field), 0, 0, sizeof(((type *)0)->field)

/** The same for a number in [min, max]. */
#define SIM_RANGE(type, field, min, max) offsetof(type, field), min, max, 0

/** "FILE:LINE: <text>" into @diag, returning LS_ERR_INVALID. */
enum ls_err sim_config_fail(const config_setting_t *setting, struct ls_diag *diag, const char *fmt,
                            ...) LS_PRINTF(3, 4);

/** Read every member of @group (a group) by @keys, ended by a NULL name. A member the table lacks,
 * a wrong type or a value out of range is LS_ERR_INVALID with file, line and what was expected. */
LS_MUST_CHECK enum ls_err sim_config_read(const config_setting_t *group, const struct sim_key *keys,
                                          void *target, struct ls_diag *diag);

/** Index of @word among the space-separated @choices, or -1. */
int sim_config_choice(const char *choices, const char *word);

#endif
