#include "daemon/outbox.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>

enum { SPANS = 16 };

void ls_chunk_finish(struct ls_chunk *chunk)
{
    free(chunk->head);
    free(chunk->payload);
    memset(chunk, 0, sizeof *chunk);
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
    outbox->bytes += kept->head_bytes + kept->payload_bytes;
    g_queue_push_tail(&outbox->chunks, kept);
}

static void add_span(struct iovec *spans, size_t *n, uint8_t *bytes, size_t size, size_t *skip)
{
    size_t skipped = size < *skip ? size : *skip;
    *skip -= skipped;
    if (size > skipped)
        spans[(*n)++] = (struct iovec){.iov_base = bytes + skipped, .iov_len = size - skipped};
}

static void drop_written(struct ls_outbox *outbox, size_t n)
{
    outbox->bytes -= n;
    outbox->written += n;
    for (struct ls_chunk *first; (first = g_queue_peek_head(&outbox->chunks));) {
        size_t size = first->head_bytes + first->payload_bytes;
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
        struct iovec spans[SPANS];
        size_t n = 0, skip = outbox->written;
        for (GList *l = outbox->chunks.head; l && n + 2 <= SPANS; l = l->next) {
            struct ls_chunk *chunk = l->data;
            add_span(spans, &n, chunk->head, chunk->head_bytes, &skip);
            add_span(spans, &n, chunk->payload, chunk->payload_bytes, &skip);
        }
        struct msghdr message = {.msg_iov = spans, .msg_iovlen = n};
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
