/*
 * file: a whole file in memory.
 * Layer: sim. Threads: any. Ownership: the bytes are the caller's.
 */
#ifndef SIM_FILE_H
#define SIM_FILE_H

#include "core/error.h"

#include <stddef.h>

/** Read @path. *bytes: (transfer full), free(). Errors: LS_ERR_NOT_FOUND, LS_ERR_LIMIT (more than
 * @limit_bytes), LS_ERR_OS, LS_ERR_NOMEM; the sentence names the file. */
LS_MUST_CHECK enum ls_err sim_file_read(const char *path, size_t limit_bytes, char **bytes,
                                        size_t *n_bytes, struct ls_diag *diag);

#endif
