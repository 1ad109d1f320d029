/*
 * file: read a small file whole.
 * Layer: daemon. Threads: any. Ownership: the text is the caller's (transfer full), free().
 */
#ifndef LS_DAEMON_FILE_H
#define LS_DAEMON_FILE_H

#include "core/error.h"

#include <stddef.h>

/** The bytes of @path, with a NUL after them. Errors: LS_ERR_NOT_FOUND, LS_ERR_LIMIT (longer than
 * @max), LS_ERR_OS, LS_ERR_NOMEM; the sentence names the path. */
LS_MUST_CHECK enum ls_err ls_file_read(const char *path, size_t max, char **text, size_t *length,
                                       struct ls_diag *diag);

#endif
