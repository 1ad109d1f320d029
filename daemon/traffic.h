/*
 * traffic: the bytes of one connection: frames in, chunks out, over a transport.
 * Layer: daemon. Threads: ls-main, except ls_traffic_send. Ownership: owns the transport; its user
 * holds it.
 *
 * Small answers are written on ls-main. Bulk is written by the ls-serve thread that made it; what
 * the socket does not take waits for ls-main to see room, which hands the writing back to a thread.
 * So ls-main never copies, encrypts or waits for bulk.
 */
#ifndef LS_DAEMON_TRAFFIC_H
#define LS_DAEMON_TRAFFIC_H

#include "daemon/job.h"
#include "daemon/outbox.h"
#include "daemon/transport.h"
#include "proto/frame.h"

#include <glib.h>
#include <stdbool.h>
#include <stdint.h>

/** All called on ls-main. */
struct ls_traffic_ops {
    /** A whole request, in traffic->decoder during the call. */
    void (*frame)(void *user);
    /** The stream is not this protocol's. */
    void (*damaged)(void *user, enum ls_err err, const struct ls_diag *diag);
    /** Something was written: there may be room, or nothing left that waits. */
    void (*wrote)(void *user);
    /** The peer has left. */
    void (*gone)(void *user);
    /** Keep @user, and this, until released: a thread or a call is at it. */
    void (*hold)(void *user);
    void (*release)(void *user);
};

struct ls_traffic {
    const struct ls_traffic_ops *ops;
    void *user;
    struct ls_job_pool *pool;
    struct ls_transport *transport;
    struct ls_outbox outbox;
    struct ls_frame_decoder decoder;
    struct ls_job flush; /* first of its kind: writes what waits */
    bool flushing, open, deaf;
    guint reading, writing; /* sources, 0 = none */
    int wanted;             /* atomic: ls-main waits to write */
    int64_t wrote_us;       /* atomic: last time bytes moved out */
    int64_t begun_us;       /* the frame under way, or the wait for one */
    uint8_t *in;            /* [in_used, in_fill) is still to be decoded */
    size_t in_used, in_fill;
};

/** @transport: (transfer full). @pool writes what is big. Nothing is read before
 * ls_traffic_go_on. */
void ls_traffic_init(struct ls_traffic *traffic, struct ls_transport *transport,
                     struct ls_job_pool *pool, uint64_t max_payload,
                     const struct ls_traffic_ops *ops, void *user);

/** When nobody holds it any more. */
void ls_traffic_finish(struct ls_traffic *traffic);

/** Read, and decode what was read, as far as answers have room to wait. */
void ls_traffic_go_on(struct ls_traffic *traffic);

/** Bytes that wait to be written; is there room for another frame? */
size_t ls_traffic_waiting(const struct ls_traffic *traffic);
bool ls_traffic_has_room(const struct ls_traffic *traffic);

/** Queue *chunk (transfer full), to be written as soon as the socket takes it. */
void ls_traffic_push(struct ls_traffic *traffic, struct ls_chunk *chunk);

/** ls-serve. Queue *chunk (transfer full) and write what the socket takes. False: not all of it, or
 * ls-main wants to write: ls_traffic_settle on ls-main is next. */
bool ls_traffic_send(struct ls_traffic *traffic, struct ls_chunk *chunk);

/** A thread that may have sent is done. */
void ls_traffic_settle(struct ls_traffic *traffic);

/** Nothing is read any more, and nothing sent but what waits already. */
void ls_traffic_last_words(struct ls_traffic *traffic);

/** Write what the socket takes now, here (at the end of everything). */
void ls_traffic_write_now(struct ls_traffic *traffic);

/** Nothing was taken for @ms though something waits, or the frame under way began @ms ago. */
bool ls_traffic_stalled(const struct ls_traffic *traffic, int64_t now_us, unsigned ms);

/** Since the last byte went out, or the last frame began to come in. */
int64_t ls_traffic_quiet_us(const struct ls_traffic *traffic, int64_t now_us);

/** Hang up. The descriptor stays until ls_traffic_finish. */
void ls_traffic_close(struct ls_traffic *traffic);

#endif
