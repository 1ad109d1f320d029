/*
 * write_buffers: memory for files on their way to the disk, used again and again.
 * Layer: daemon, inside the store. Threads: any at once. Ownership: a buffer taken is the taker's
 * until it is given back; the pool frees those it has.
 *
 * A picture's file has 8 MB. Fresh memory of that size comes from the kernel page by page, cleared,
 * and that costs more than filling it; so buffers are kept, as many as were in use at once, until
 * the pool is finished. They begin at a block of the disk (diskio.h), large ones at a huge page.
 */
#ifndef LS_DAEMON_WRITE_BUFFERS_H
#define LS_DAEMON_WRITE_BUFFERS_H

#include "core/error.h"

#include <pthread.h>
#include <stddef.h>
#include <stdint.h>

struct ls_write_buffer {
    uint8_t *bytes;
    size_t capacity;
};

struct ls_write_buffers {
    pthread_mutex_t lock;
    struct ls_write_buffer idle[64];
    uint32_t n_idle;
};

void ls_write_buffers_init(struct ls_write_buffers *pool);

/** Room for @bytes > 0, contents undefined. LS_ERR_NOMEM with its sentence. */
LS_MUST_CHECK enum ls_err ls_write_buffers_take(struct ls_write_buffers *pool, size_t bytes,
                                                struct ls_write_buffer *out, struct ls_diag *diag);

/** A buffer without bytes is allowed. */
void ls_write_buffers_give_back(struct ls_write_buffers *pool, struct ls_write_buffer buffer);

/** Every buffer is back. */
void ls_write_buffers_finish(struct ls_write_buffers *pool);

#endif
