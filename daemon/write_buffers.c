#include "daemon/write_buffers.h"

#include "daemon/diskio.h"

#include <stdlib.h>
#include <sys/mman.h>

static const size_t huge_page_bytes = 2 << 20;

void ls_write_buffers_init(struct ls_write_buffers *pool)
{
    *pool = (struct ls_write_buffers){0};
    pthread_mutex_init(&pool->lock, NULL);
}

static size_t whole(size_t bytes, size_t unit)
{
    return (bytes + unit - 1) / unit * unit;
}

static uint8_t *fresh(size_t *bytes)
{
    size_t unit = *bytes < huge_page_bytes ? LS_DISK_BLOCK_BYTES : huge_page_bytes;
    if (*bytes > SIZE_MAX - unit)
        return NULL;
    *bytes = whole(*bytes, unit);
    void *memory = aligned_alloc(unit, *bytes);
    if (memory && unit == huge_page_bytes)
        (void)madvise(memory, *bytes, MADV_HUGEPAGE); /* a wish */
    return memory;
}

/* The smallest that will do. Under the lock. */
static struct ls_write_buffer idle_one(struct ls_write_buffers *pool, size_t bytes)
{
    struct ls_write_buffer found = {0};
    uint32_t at = 0;
    for (uint32_t k = 0; k < pool->n_idle; k++)
        if (pool->idle[k].capacity >= bytes &&
            (!found.bytes || pool->idle[k].capacity < found.capacity))
            found = pool->idle[at = k];
    if (found.bytes)
        pool->idle[at] = pool->idle[--pool->n_idle];
    return found;
}

enum ls_err ls_write_buffers_take(struct ls_write_buffers *pool, size_t bytes,
                                  struct ls_write_buffer *out, struct ls_diag *diag)
{
    pthread_mutex_lock(&pool->lock);
    *out = idle_one(pool, bytes);
    struct ls_write_buffer small = {0};
    if (!out->bytes && pool->n_idle)
        small = pool->idle[--pool->n_idle];
    pthread_mutex_unlock(&pool->lock);
    free(small.bytes);
    if (out->bytes)
        return LS_OK;
    out->capacity = bytes;
    out->bytes = fresh(&out->capacity);
    return out->bytes ? LS_OK
                      : ls_fail(diag, LS_ERR_NOMEM, "no memory for a file of %zu bytes", bytes);
}

void ls_write_buffers_give_back(struct ls_write_buffers *pool, struct ls_write_buffer buffer)
{
    enum { ROOM = sizeof pool->idle / sizeof *pool->idle };
    if (!buffer.bytes)
        return;
    pthread_mutex_lock(&pool->lock);
    if (pool->n_idle < ROOM) {
        pool->idle[pool->n_idle++] = buffer;
        buffer.bytes = NULL;
    }
    pthread_mutex_unlock(&pool->lock);
    free(buffer.bytes);
}

void ls_write_buffers_finish(struct ls_write_buffers *pool)
{
    for (uint32_t k = 0; k < pool->n_idle; k++)
        free(pool->idle[k].bytes);
    pthread_mutex_destroy(&pool->lock);
    *pool = (struct ls_write_buffers){0};
}
