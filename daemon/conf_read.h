/*
 * conf_read: strict reading of libconfig groups: every key known, typed and in range.
 * Layer: daemon. Threads: any, one per ls_conf. Ownership: strings returned are duplicated
 * (transfer full) unless stated; the libconfig tree is the caller's.
 *
 * One ls_conf reads one group. Its getters record which keys were asked for; ls_conf_finish then
 * refuses any other key. The first error sticks: later getters do nothing, so that a reader is a
 * plain list of keys and one check at its end.
 */
#ifndef LS_DAEMON_CONF_READ_H
#define LS_DAEMON_CONF_READ_H

#include "core/error.h"

#include <libconfig.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum { LS_CONF_MAX_KEYS = 48 };

struct ls_conf {
    const config_setting_t *group;
    const char *file; /* for messages */
    const char *known[LS_CONF_MAX_KEYS];
    unsigned n_known;
    enum ls_err err;
    struct ls_diag *diag;
};

/** Start reading @group (NULL: an absent optional group, every key takes its default). */
void ls_conf_begin(struct ls_conf *conf, const config_setting_t *group, const char *file,
                   struct ls_diag *diag);

/** The sticky error, or LS_ERR_INVALID for the first key nobody asked for. */
LS_MUST_CHECK enum ls_err ls_conf_finish(struct ls_conf *conf);

/** Record an error at a key of this group (or at the group itself where the key is absent). */
void ls_conf_error(struct ls_conf *conf, const char *key, const char *fmt, ...) LS_PRINTF(3, 4);

/* Getters. A mandatory key has no default; numbers must lie in [min, max]. */
double ls_conf_number(struct ls_conf *conf, const char *key, double fallback, double min,
                      double max);
double ls_conf_need_number(struct ls_conf *conf, const char *key, double min, double max);
int64_t ls_conf_int(struct ls_conf *conf, const char *key, int64_t fallback, int64_t min,
                    int64_t max);
bool ls_conf_bool(struct ls_conf *conf, const char *key, bool fallback);
/** NULL fallback is allowed; (transfer full), NULL on error or absence. */
char *ls_conf_string(struct ls_conf *conf, const char *key, const char *fallback);
char *ls_conf_need_string(struct ls_conf *conf, const char *key);
/** One of @words (NULL-terminated); returns its index. fallback < 0: mandatory. */
int ls_conf_word(struct ls_conf *conf, const char *key, const char *const *words, int fallback);
/** Exactly @n numbers into @out. Returns false (no error) if the key is absent and not @needed. */
bool ls_conf_numbers(struct ls_conf *conf, const char *key, double *out, unsigned n, bool needed);
/** A sub-setting of the given libconfig type (group, list or array); NULL if absent or wrong. */
const config_setting_t *ls_conf_child(struct ls_conf *conf, const char *key, int type, bool needed);

/** A path in a configuration file is relative to that file. @path: (transfer full), NULL stays
 * NULL. (transfer full); NULL without memory. */
char *ls_conf_beside(const char *file, char *path);

/** Line of a setting, for messages. */
unsigned ls_conf_line(const config_setting_t *setting);

#endif
