/*
 * command_file: whole files in and out of a command.
 * Layer: clients. Threads: the main thread. Ownership: as stated.
 */
#ifndef LS_CLIENTS_COMMAND_FILE_H
#define LS_CLIENTS_COMMAND_FILE_H

#include "core/error.h"

#include <jansson.h>
#include <stddef.h>

/** Read a whole file of at most @limit bytes. *bytes: (transfer full), NUL-terminated. */
LS_MUST_CHECK enum ls_err ls_command_read_file(const char *path, size_t limit, char **bytes,
                                               size_t *n, struct ls_diag *diag);

/** Read a whole file of at most @limit bytes of JSON, without duplicate keys. *root: (transfer
 * full). Errors: those of reading, LS_ERR_INVALID with the line. */
LS_MUST_CHECK enum ls_err ls_command_read_json(const char *path, size_t limit, json_t **root,
                                               struct ls_diag *diag);

/**
 * Write a whole file. A regular file, or none: written beside it under a name of its own, then
 * renamed over it, so that there is never half a file. A link: what it points at. Anything else (a
 * pipe, a device): written into.
 */
LS_MUST_CHECK enum ls_err ls_command_write_file(const char *path, const void *bytes, size_t n,
                                                struct ls_diag *diag);

/** Could ls_command_write_file write here, as far as can be seen without writing? For what takes
 * long to make. LS_ERR_INVALID, with the reason. */
LS_MUST_CHECK enum ls_err ls_command_check_writable(const char *path, struct ls_diag *diag);

#endif
