#include "daemon/outbox.h"

#include <stdlib.h>
#include <string.h>
#include <unistd.h>

enum { SPANS = 512 }; /* the kernel takes 1024 */

void ls_chunk_finish(struct ls_chunk *chunk)
{
    free(chunk->head);
    free(chunk->payload);
    if (chunk->lent)
        chunk->lent->give_back(chunk->lent);
    if (chunk->passes)
        close(chunk->fd);
    memset(chunk, 0, sizeof *chunk);
}

uint64_t ls_chunk_payload(const struct ls_chunk *chunk)
{
    return chunk->payload_bytes + (chunk->lent ? chunk->lent->n_bytes : 0) + chunk->handed_bytes;
}

size_t ls_chunk_bytes(const struct ls_chunk *chunk)
{
    return chunk->head_bytes + chunk->payload_bytes + (chunk->lent ? chunk->lent->n_bytes : 0);
}

static void chunk_free(void *pointer)
{
    ls_chunk_finish(pointer);
    g_free(pointer);
}

void ls_outbox_init(struct ls_outbox *outbox)
{
    memset(outbox, 0, sizeof *outbox);
    g_mutex_init(&outbox->lock);
    g_mutex_init(&outbox->writing);
    g_queue_init(&outbox->chunks);
}

void ls_outbox_finish(struct ls_outbox *outbox)
{
    g_queue_clear_full(&outbox->chunks, chunk_free);
    g_mutex_clear(&outbox->lock);
    g_mutex_clear(&outbox->writing);
}

size_t ls_outbox_waiting(const struct ls_outbox *outbox)
{
    return __atomic_load_n(&outbox->waiting, __ATOMIC_ACQUIRE);
}

void ls_outbox_close(struct ls_outbox *outbox)
{
    g_mutex_lock(&outbox->lock);
    outbox->closed = true;
    g_mutex_unlock(&outbox->lock);
}

void ls_outbox_push(struct ls_outbox *outbox, struct ls_chunk *chunk)
{
    struct ls_chunk *kept = g_new(struct ls_chunk, 1);
    *kept = *chunk;
    memset(chunk, 0, sizeof *chunk);
    g_mutex_lock(&outbox->lock);
    bool closed = outbox->closed;
    if (!closed) {
        g_queue_push_tail(&outbox->chunks, kept);
        __atomic_add_fetch(&outbox->waiting, ls_chunk_bytes(kept), __ATOMIC_RELEASE);
    }
    g_mutex_unlock(&outbox->lock);
    if (closed)
        chunk_free(kept);
}

struct spans {
    struct iovec span[SPANS];
    size_t n, skip; /* bytes that are written already */
};

static void add_span(struct spans *to, const void *bytes, size_t size)
{
    size_t skipped = size < to->skip ? size : to->skip;
    to->skip -= skipped;
    if (size > skipped && to->n < SPANS)
        to->span[to->n++] = (struct iovec){(uint8_t *)bytes + skipped, size - skipped};
}

static void add_chunk(struct spans *to, const struct ls_chunk *chunk)
{
    add_span(to, chunk->head, chunk->head_bytes);
    add_span(to, chunk->payload, chunk->payload_bytes);
    for (size_t k = 0; chunk->lent && k < chunk->lent->n_spans && to->n < SPANS; k++)
        add_span(to, chunk->lent->spans[k].iov_base, chunk->lent->spans[k].iov_len);
}

static bool passes(const GList *link)
{
    return ((const struct ls_chunk *)link->data)->passes;
}

/* The chunks stay where they are until the writer drops them. A descriptor goes with the first byte
 * of what is written: a chunk that has one begins it. */
static int collect(struct ls_outbox *outbox, struct spans *spans)
{
    int fd = -1;
    *spans = (struct spans){.n = 0, .skip = outbox->written};
    g_mutex_lock(&outbox->lock);
    const GList *first = outbox->chunks.head;
    if (first && passes(first) && outbox->written == 0)
        fd = ((struct ls_chunk *)first->data)->fd;
    for (const GList *l = first; l && spans->n < SPANS && (l == first || !passes(l)); l = l->next)
        add_chunk(spans, l->data);
    g_mutex_unlock(&outbox->lock);
    return fd;
}

/* The first chunk, if all of it is written. */
static struct ls_chunk *take_written(struct ls_outbox *outbox)
{
    struct ls_chunk *first = NULL;
    g_mutex_lock(&outbox->lock);
    first = g_queue_peek_head(&outbox->chunks);
    if (first && outbox->written >= ls_chunk_bytes(first))
        g_queue_pop_head(&outbox->chunks);
    else
        first = NULL;
    g_mutex_unlock(&outbox->lock);
    return first;
}

static void drop_written(struct ls_outbox *outbox, size_t n)
{
    outbox->written += n;
    for (struct ls_chunk *first; (first = take_written(outbox));) {
        outbox->written -= ls_chunk_bytes(first);
        chunk_free(first);
    }
    __atomic_sub_fetch(&outbox->waiting, n, __ATOMIC_RELEASE);
}

enum ls_err ls_outbox_write(struct ls_outbox *outbox, struct ls_transport *transport, size_t *sent)
{
    enum ls_err err = LS_OK;
    size_t n = 1;
    *sent = 0;
    if (!g_mutex_trylock(&outbox->writing))
        return LS_ERR_BUSY;
    while (!err && n > 0 && ls_outbox_waiting(outbox) > 0) {
        struct spans spans;
        int fd = collect(outbox, &spans);
        err = fd < 0 ? ls_transport_write(transport, spans.span, spans.n, &n)
                     : ls_transport_write_fd(transport, spans.span, spans.n, fd, &n);
        drop_written(outbox, n);
        *sent += n;
    }
    g_mutex_unlock(&outbox->writing);
    return err;
}
