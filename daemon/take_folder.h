/*
 * take_folder: the folder of a take being written: made, locked, its space reserved.
 * Layer: daemon. Threads: one at a time. Ownership: it owns its descriptors and path.
 */
#ifndef LS_DAEMON_TAKE_FOLDER_H
#define LS_DAEMON_TAKE_FOLDER_H

#include "core/error.h"
#include "daemon/diskio.h"

#include <stdbool.h>
#include <stdint.h>

enum { LS_FOLDER_MAX_CAMERAS = 64 };

/** Zero bytes are not a closed folder: use the functions. */
struct ls_take_folder {
    char *path;
    const char *id;                     /* last component of path */
    int dir_fd, journal_fd, reserve_fd; /* reserve_fd -1 = none */
    int camera_fd[LS_FOLDER_MAX_CAMERAS], raw_fd[LS_FOLDER_MAX_CAMERAS]; /* raw_fd -1 = none */
    uint32_t n_cameras;
    uint64_t reserved_bytes;
    const struct ls_disk_shim *shim;
};

/** Make a new folder under @root with its subfolders and an empty, locked journal. */
LS_MUST_CHECK enum ls_err ls_take_folder_create(const char *root, const char *name, int64_t utc_s,
                                                uint32_t n_cameras, bool keep_raw,
                                                const struct ls_disk_shim *shim,
                                                struct ls_take_folder *folder,
                                                struct ls_diag *diag);

/** Open an existing one and lock it. LS_ERR_BUSY, LS_ERR_NOT_FOUND. */
LS_MUST_CHECK enum ls_err ls_take_folder_open(const char *path, uint32_t n_cameras, bool keep_raw,
                                              const struct ls_disk_shim *shim,
                                              struct ls_take_folder *folder, struct ls_diag *diag);

/** Remove what a killed writer left: `*.tmp` and the reservation. */
LS_MUST_CHECK enum ls_err ls_take_folder_sweep(struct ls_take_folder *folder, struct ls_diag *diag);

/** Take @need_bytes off the disk's free space, leaving @spare_bytes. LS_ERR_FULL names the
 * numbers. */
LS_MUST_CHECK enum ls_err ls_take_folder_reserve(struct ls_take_folder *folder, uint64_t need_bytes,
                                                 uint64_t spare_bytes, struct ls_diag *diag);

/** Give @n_bytes of the reservation back, for a file about to be written. */
LS_MUST_CHECK enum ls_err ls_take_folder_release(struct ls_take_folder *folder, uint64_t n_bytes,
                                                 struct ls_diag *diag);

/** Drop the reservation, unlock, close. */
void ls_take_folder_close(struct ls_take_folder *folder);

/** Close, and delete a folder that was only just created. */
void ls_take_folder_discard(struct ls_take_folder *folder);

#endif
