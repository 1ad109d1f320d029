/*
 * diskio: every byte the store puts on a disk goes through here, so a test can make it fail.
 * Layer: daemon. Threads: any; a shim is called on the thread that does the operation.
 * Ownership: paths and descriptors stay the caller's.
 */
#ifndef LS_DAEMON_DISKIO_H
#define LS_DAEMON_DISKIO_H

#include "core/error.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum ls_disk_op {
    LS_DISK_CREATE,
    LS_DISK_ALLOCATE, /* fallocate */
    LS_DISK_WRITE,
    LS_DISK_SYNC, /* fdatasync of a file */
    LS_DISK_RENAME,
    LS_DISK_SYNC_DIR,
    LS_DISK_TRUNCATE,
};

/** Called before each operation. Returns 0 to go on or an errno to fail with; may shorten
 * *n_bytes of a write, may not return at all. NULL shim = none. */
struct ls_disk_shim {
    int (*before)(void *user, enum ls_disk_op op, const char *name, size_t *n_bytes);
    void *user;
};

/**
 * Write all of @bytes to @fd at its position, whatever short writes or EINTR there are.
 * Errors of this header: LS_ERR_FULL (no space, quota, file size limit), LS_ERR_OS; the sentence
 * names file and reason.
 */
LS_MUST_CHECK enum ls_err ls_disk_write(const struct ls_disk_shim *shim, int fd, const char *name,
                                        const void *bytes, size_t n_bytes, struct ls_diag *diag);

/** fdatasync. */
LS_MUST_CHECK enum ls_err ls_disk_sync(const struct ls_disk_shim *shim, int fd, const char *name,
                                       struct ls_diag *diag);

/** fsync of a directory, so that renames in it are durable. */
LS_MUST_CHECK enum ls_err ls_disk_sync_dir(const struct ls_disk_shim *shim, int dir_fd,
                                           const char *name, struct ls_diag *diag);

/** Reserve [0, n_bytes) of @fd. A file system that cannot is not an error: the write will tell. */
LS_MUST_CHECK enum ls_err ls_disk_allocate(const struct ls_disk_shim *shim, int fd,
                                           const char *name, uint64_t n_bytes,
                                           struct ls_diag *diag);

/** Cut @fd to @n_bytes. */
LS_MUST_CHECK enum ls_err ls_disk_truncate(const struct ls_disk_shim *shim, int fd,
                                           const char *name, uint64_t n_bytes,
                                           struct ls_diag *diag);

/** Create @name, empty, in @dir_fd, opened for writing; *fd is the caller's. */
LS_MUST_CHECK enum ls_err ls_disk_create(const struct ls_disk_shim *shim, int dir_fd,
                                         const char *name, int *fd, struct ls_diag *diag);

/**
 * Put a whole file in place atomically: `<name>.tmp` created, allocated, written, synced, renamed
 * over @name. The directory is *not* synced. On error the temporary file is removed and an older
 * @name is as it was.
 *
 * Whole blocks of what ls_disk_can_be_direct go to the disk without a copy in the page cache
 * (O_DIRECT), the end of the file through it; all does where the file system refuses. *n_direct:
 * how many bytes had no copy, 0 = refused, or too few. NULL is allowed.
 */
LS_MUST_CHECK enum ls_err ls_disk_replace(const struct ls_disk_shim *shim, int dir_fd,
                                          const char *name, const void *bytes, size_t n_bytes,
                                          size_t *n_direct, struct ls_diag *diag);

/* Where direct writes begin and end in memory and file: file systems want 512 to 4096. */
enum { LS_DISK_BLOCK_BYTES = 4096 };

/** Do these begin at a block, and are they at least one? */
bool ls_disk_can_be_direct(const void *bytes, size_t n_bytes);

/** Read a whole file of at most @limit_bytes. *bytes: (transfer full), free(), NUL-terminated
 * beyond its end. Errors: LS_ERR_NOT_FOUND, LS_ERR_LIMIT, LS_ERR_OS, LS_ERR_NOMEM. */
LS_MUST_CHECK enum ls_err ls_disk_read(int dir_fd, const char *name, size_t limit_bytes,
                                       uint8_t **bytes, size_t *n_bytes, struct ls_diag *diag);

#endif
