/*
 * outbox: what waits to be written to one client, in order, without ever blocking.
 * Layer: daemon. Threads: any, except init and finish; locks are held for a few list operations.
 * Ownership: takes the chunks it is given.
 */
#ifndef LS_DAEMON_OUTBOX_H
#define LS_DAEMON_OUTBOX_H

#include "core/error.h"
#include "daemon/transport.h"

#include <glib.h>
#include <stdbool.h>
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
    struct ls_lent *lent;  /* or NULL */
    bool passes;           /* a descriptor goes with the head, to whoever is at the other end */
    int fd;                /* then closed here */
    uint64_t handed_bytes; /* that it gives access to: counted as payload, where credit is */
};

/** Free the spans, give back what is lent, and zero. */
void ls_chunk_finish(struct ls_chunk *chunk);

/** What the client gets, by any way, beside the head. */
uint64_t ls_chunk_payload(const struct ls_chunk *chunk);

/** Of the whole frame, as written. */
size_t ls_chunk_bytes(const struct ls_chunk *chunk);

struct ls_outbox {
    GMutex lock;    /* of the list and `closed` */
    GMutex writing; /* held by who writes */
    GQueue chunks;  /* struct ls_chunk, heap */
    size_t waiting; /* atomic: bytes */
    size_t written; /* of the first chunk; the writer's */
    bool closed;
};

void ls_outbox_init(struct ls_outbox *outbox);
void ls_outbox_finish(struct ls_outbox *outbox);

/** Append and zero *chunk. (transfer full) of its spans. After ls_outbox_close it is freed. */
void ls_outbox_push(struct ls_outbox *outbox, struct ls_chunk *chunk);

/** What is pushed from now on is dropped; what waits still goes out. */
void ls_outbox_close(struct ls_outbox *outbox);

/** Bytes that wait now. */
size_t ls_outbox_waiting(const struct ls_outbox *outbox);

/**
 * Write as much as @transport takes now. *sent: bytes. LS_OK also when nothing could be written;
 * LS_ERR_GONE when the peer is; LS_ERR_BUSY when another thread is writing.
 */
LS_MUST_CHECK enum ls_err ls_outbox_write(struct ls_outbox *outbox, struct ls_transport *transport,
                                          size_t *sent);

#endif
