/*
 * memfds: pictures in memory that is handed over to local clients: sealed, shared, never copied.
 * Layer: daemon. Threads: any. Ownership: descriptors are the caller's to close; the cache keeps
 * its own.
 *
 * A picture lies in a memfd tile after tile, in the order of its file, all of one length: tile t at
 * t x tile_bytes. What is not written reads as 0 and takes no memory. Once sealed, neither side can
 * change it. Its memory is given back when the last who holds it lets go: the cache, or a client.
 */
#ifndef LS_DAEMON_MEMFDS_H
#define LS_DAEMON_MEMFDS_H

#include "core/error.h"
#include "daemon/picture_map.h"

#include <stddef.h>
#include <stdint.h>

/** Room for @bytes, still writable. LS_ERR_OS. *fd: (transfer full), close. */
LS_MUST_CHECK enum ls_err ls_memfd_create(uint64_t bytes, int *fd, struct ls_diag *diag);

/** @n bytes at @at. LS_ERR_NOMEM, LS_ERR_OS. */
LS_MUST_CHECK enum ls_err ls_memfd_write(int fd, uint64_t at, const void *bytes, size_t n,
                                         struct ls_diag *diag);

/** Another descriptor of the same, (transfer full). LS_ERR_OS. */
LS_MUST_CHECK enum ls_err ls_memfd_share(int fd, int *out, struct ls_diag *diag);

/** From now on it is as it is. LS_ERR_OS. */
LS_MUST_CHECK enum ls_err ls_memfd_seal(int fd, struct ls_diag *diag);

/** Those of stored pictures that were asked for last. */
struct ls_memfds;

/** Up to @max_bytes of pictures, and at most 64 of them. (transfer full). */
struct ls_memfds *ls_memfds_create(uint64_t max_bytes);

/** The tiles of the picture that is mapped, each of 64 x 64 halves, whole and sealed: one that is
 * kept, or made now. *fd: (transfer full), close. LS_ERR_INVALID: the file cannot be read;
 * LS_ERR_NOMEM, LS_ERR_OS. */
LS_MUST_CHECK enum ls_err ls_memfds_get(struct ls_memfds *memfds, const struct ls_picture_map *map,
                                        int *fd, struct ls_diag *diag);

/** What clients hold stays theirs. NULL is allowed. */
void ls_memfds_destroy(struct ls_memfds *memfds);

#endif
