/*
 * plan_text: the plan as it is sent, with a list of conditions of the user's own inside.
 * Layer: clients. Threads: any. Ownership: as stated.
 */
#ifndef LS_CLIENTS_PLAN_TEXT_H
#define LS_CLIENTS_PLAN_TEXT_H

#include "core/error.h"

#include <stdbool.h>
#include <stddef.h>

/** Read @plan_path; the file @custom_path (NULL: none) becomes its key `custom`, and with @sweep it
 * gets `sweep = true`. *text: (transfer full), NUL-terminated. Errors: LS_ERR_NOT_FOUND, LS_ERR_OS,
 * LS_ERR_LIMIT (1 MiB), LS_ERR_NOMEM.
 */
LS_MUST_CHECK enum ls_err ls_plan_text_read(const char *plan_path, const char *custom_path,
                                            bool sweep, char **text, size_t *n,
                                            struct ls_diag *diag);

#endif
