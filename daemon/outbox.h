/*
 * outbox: what waits to be written to one client, in order, without ever blocking.
 * Layer: daemon. Threads: one at a time (ls-main). Ownership: takes the chunks it is given.
 */
#ifndef LS_DAEMON_OUTBOX_H
#define LS_DAEMON_OUTBOX_H

#include "core/error.h"

#include <glib.h>
#include <stddef.h>
#include <stdint.h>
#include <sys/uio.h>

/** Bytes that lie elsewhere (a mapped file), sent from there without a copy. Allocated by whoever
 * lends them. */
struct ls_lent {
    const struct iovec *spans;
    size_t n_spans, n_bytes;
    /** Any thread, once: they are written, or never will be. Frees the struct. */
    void (*give_back)(struct ls_lent *lent);
};

/** One frame: header and message, then the payload: some bytes of its own, then what is lent. Spans
 * are malloc'd, or NULL. */
struct ls_chunk {
    uint8_t *head, *payload;
    size_t head_bytes, payload_bytes;
    struct ls_lent *lent; /* or NULL */
};

/** Free the spans, give back what is lent, and zero. */
void ls_chunk_finish(struct ls_chunk *chunk);

/** Of the whole frame. */
size_t ls_chunk_bytes(const struct ls_chunk *chunk);

struct ls_outbox {
    GQueue chunks;  /* struct ls_chunk, heap */
    size_t bytes;   /* waiting */
    size_t written; /* of the first chunk */
};

void ls_outbox_init(struct ls_outbox *outbox);
void ls_outbox_finish(struct ls_outbox *outbox);

/** Append and zero *chunk. (transfer full) of its spans. */
void ls_outbox_push(struct ls_outbox *outbox, struct ls_chunk *chunk);

/**
 * Write as much as the non-blocking socket @fd takes now. *sent: bytes. LS_OK also when nothing
 * could be written; LS_ERR_GONE when the peer is.
 */
LS_MUST_CHECK enum ls_err ls_outbox_write(struct ls_outbox *outbox, int fd, size_t *sent);

#endif
