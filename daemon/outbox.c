#include "daemon/outbox.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>

enum { SPANS = 512 }; /* the kernel takes 1024 */

void ls_chunk_finish(struct ls_chunk *chunk)
{
    free(chunk->head);
    free(chunk->payload);
    if (chunk->lent)
        chunk->lent->give_back(chunk->lent);
    memset(chunk, 0, sizeof *chunk);
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
    g_queue_init(&outbox->chunks);
}

void ls_outbox_finish(struct ls_outbox *outbox)
{
    g_queue_clear_full(&outbox->chunks, chunk_free);
    outbox->bytes = outbox->written = 0;
}

void ls_outbox_push(struct ls_outbox *outbox, struct ls_chunk *chunk)
{
    struct ls_chunk *kept = g_new(struct ls_chunk, 1);
    *kept = *chunk;
    memset(chunk, 0, sizeof *chunk);
    outbox->bytes += ls_chunk_bytes(kept);
    g_queue_push_tail(&outbox->chunks, kept);
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

static void drop_written(struct ls_outbox *outbox, size_t n)
{
    outbox->bytes -= n;
    outbox->written += n;
    for (struct ls_chunk *first; (first = g_queue_peek_head(&outbox->chunks));) {
        size_t size = ls_chunk_bytes(first);
        if (outbox->written < size)
            return;
        outbox->written -= size;
        chunk_free(g_queue_pop_head(&outbox->chunks));
    }
}

enum ls_err ls_outbox_write(struct ls_outbox *outbox, int fd, size_t *sent)
{
    *sent = 0;
    while (outbox->bytes > 0) {
        struct spans spans = {.n = 0, .skip = outbox->written};
        for (GList *l = outbox->chunks.head; l && spans.n < SPANS; l = l->next)
            add_chunk(&spans, l->data);
        struct msghdr message = {.msg_iov = spans.span, .msg_iovlen = spans.n};
        ssize_t wrote = sendmsg(fd, &message, MSG_NOSIGNAL | MSG_DONTWAIT);
        if (wrote < 0 && errno == EINTR)
            continue;
        if (wrote < 0)
            return errno == EAGAIN || errno == EWOULDBLOCK ? LS_OK : LS_ERR_GONE;
        drop_written(outbox, (size_t)wrote);
        *sent += (size_t)wrote;
    }
    return LS_OK;
}
