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
 */
#ifndef LS_DAEMON_RING_H
#define LS_DAEMON_RING_H

#include "core/error.h"
#include "drivers/camera.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct ls_ring;

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

/** Slots the driver holds now. RT-safe. */
uint32_t ls_ring_queued(const struct ls_ring *ring);

/** NULL is allowed. */
void ls_ring_destroy(struct ls_ring *ring);

#endif
