/*
 * ring: the memory one camera's frames land in, and who holds each slot of it.
 * Layer: daemon. Threads: take and hand on ls-cam, give_back on any thread, queued on any thread.
 * Ownership: the ring owns the memory; a slot has exactly one holder, and only the holder may read
 * it or pass it on.
 *
 * Four verbs, each a legal transition or a bug:
 *     queue      (nobody)  -> driver     before start: every slot is the driver's
 *     take       driver    -> ls-cam     a frame came out of ls_camera_next
 *     hand       ls-cam    -> merge      the frame is bound, its ticket travels with the slot
 *     give_back  ls-cam or merge -> driver  just before ls_camera_release
 * Slots the driver holds are what credit is counted from, so a slow merge stage slows the lights.
 *
 * Behind the slots lies an index (struct ls_ring_index) for those that only look, other processes
 * too: they hold nothing, wait for nobody and are waited for by nobody, and learn afterwards
 * whether what they read was still the frame. The memfd can be mapped for reading only, by anybody
 * but us.
 */
#ifndef LS_DAEMON_RING_H
#define LS_DAEMON_RING_H

#include "core/error.h"
#include "drivers/camera.h"

#include <stdatomic.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdint.h>

struct ls_ring;

/** Of one slot, 16 bytes, little-endian as the machine. */
struct ls_ring_entry {
    _Atomic uint64_t change; /* odd while a frame may be landing; each change adds 1 */
    _Atomic uint64_t number; /* of the frame that landed in it last, from 1; 0: none yet */
};

/** At ls_ring_index_at. */
struct ls_ring_index {
    char magic[8]; /* "LSRING 1" */
    uint32_t n_slots, reserved;
    uint64_t stride, payload_bytes; /* slot i begins at i x stride */
    _Atomic uint64_t landed;        /* number of the newest frame */
    uint64_t zero[3];
    struct ls_ring_entry entry[]; /* [n_slots], at 64 */
};

/**
 * One memfd of @n_slots slots of @payload_bytes, rounded up to pages, touched and, if the process
 * may, locked in memory. Errors: LS_ERR_INVALID (0 slots or bytes, or more than 1024 slots),
 * LS_ERR_OS, LS_ERR_NOMEM. @out: (transfer full).
 */
LS_MUST_CHECK enum ls_err ls_ring_create(uint32_t n_slots, size_t payload_bytes,
                                         struct ls_ring **out, struct ls_diag *diag);

/** The slots, as ls_camera_start wants them. (transfer none). */
struct ls_camera_slots ls_ring_slots(const struct ls_ring *ring);

/** Start of a slot. RT-safe. */
const void *ls_ring_payload(const struct ls_ring *ring, uint32_t slot);

/** All slots to the driver. Call when the driver is stopped. */
void ls_ring_queue(struct ls_ring *ring);

/** LS_ERR_BUG if the slot was not the previous holder's. RT-safe. */
LS_MUST_CHECK enum ls_err ls_ring_take(struct ls_ring *ring, uint32_t slot);
LS_MUST_CHECK enum ls_err ls_ring_hand(struct ls_ring *ring, uint32_t slot);
LS_MUST_CHECK enum ls_err ls_ring_give_back(struct ls_ring *ring, uint32_t slot);

/** For handing over: another descriptor of the memfd, sealed against writing, (transfer full),
 * close; where its index begins; its length. LS_ERR_OS. */
LS_MUST_CHECK enum ls_err ls_ring_share(const struct ls_ring *ring, int *fd, struct ls_diag *diag);
uint64_t ls_ring_index_at(const struct ls_ring *ring);
uint64_t ls_ring_payload_bytes(const struct ls_ring *ring);
uint64_t ls_ring_bytes(const struct ls_ring *ring);

/** Slots the driver holds now. RT-safe. */
uint32_t ls_ring_queued(const struct ls_ring *ring);

/** NULL is allowed. */
void ls_ring_destroy(struct ls_ring *ring);

#endif
