/*
 * take_head: the keys of take.json that the store owns, written and read.
 * Layer: daemon. Threads: any. Ownership: a parsed ls_take_head owns its strings.
 */
#ifndef LS_DAEMON_TAKE_HEAD_H
#define LS_DAEMON_TAKE_HEAD_H

#include "core/error.h"
#include "daemon/store.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct ls_take_head {
    enum ls_store_state state;
    char name[65];
    char utc[32]; /* ISO 8601 */
    uint32_t n_cameras, n_shots, n_conditions;
    char **conditions;
    bool keep_raw;
};

/**
 * The text of take.json: the caller's object @document with the keys of @head, @missing and
 * @skips_json put in. *text: (transfer full), free(). Errors: LS_ERR_INVALID (document or skips
 * are not JSON of the right kind, with line), LS_ERR_NOMEM.
 */
LS_MUST_CHECK enum ls_err ls_take_head_write(const struct ls_take_head *head, const char *document,
                                             const char *const *missing, size_t n_missing,
                                             const char *skips_json, char **text,
                                             struct ls_diag *diag);

/** Read the keys back. Errors: LS_ERR_INVALID, LS_ERR_UNSUPPORTED (other format), LS_ERR_NOMEM.
 * @head: finish it. */
LS_MUST_CHECK enum ls_err ls_take_head_parse(const char *text, size_t n, struct ls_take_head *head,
                                             struct ls_diag *diag);

/** Free what it owns and zero it. */
void ls_take_head_finish(struct ls_take_head *head);

#endif
