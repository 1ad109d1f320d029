/*
 * map_file: room for a derived map on disk instead of on the heap.
 * Layer: daemon. Threads: one at a time; what it holds, any. Ownership: the caller's; see finish.
 *
 * A file without a name in the storage folder, or in /var/tmp where that cannot be written, mapped:
 * the kernel may write its pages out and read them back, so maps of many spectra cost no memory that
 * is needed for something else, and nothing is left behind, whatever happens to the process. All of
 * it is allocated at once: a full disk is an error here, never a signal later.
 */
#ifndef LS_DAEMON_MAP_FILE_H
#define LS_DAEMON_MAP_FILE_H

#include "core/error.h"

#include <stddef.h>
#include <stdint.h>

struct ls_map_file {
    void *base;
    size_t bytes;
};

/** @bytes > 0 of zeros in @folder, whose disk has @spare_bytes left after that. Errors: LS_ERR_FULL
 * (the disk), LS_ERR_OS, naming the folder. */
LS_MUST_CHECK enum ls_err ls_map_file_create(struct ls_map_file *map, const char *folder,
                                             size_t bytes, uint64_t spare_bytes,
                                             struct ls_diag *diag);

/** Zeroed is allowed. */
void ls_map_file_finish(struct ls_map_file *map);

#endif
