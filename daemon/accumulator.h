/*
 * accumulator: where the exposures of one condition of one camera wait for each other.
 * Layer: daemon. Threads: under the merge stage's lock; buffers of a claimed exposure or a merging
 * accumulator belong to who claimed or merges them. Ownership: the pool owns every buffer.
 */
#ifndef LS_DAEMON_ACCUMULATOR_H
#define LS_DAEMON_ACCUMULATOR_H

#include "core/error.h"
#include "core/merge.h"
#include "daemon/plan.h"

#include <stddef.h>
#include <stdint.h>

enum ls_accumulator_state {
    LS_ACCUMULATOR_FREE,
    LS_ACCUMULATOR_FILLING,
    LS_ACCUMULATOR_MERGING, /* every exposure is in */
};

struct ls_accumulator {
    enum ls_accumulator_state state;
    uint32_t camera, condition;
    uint64_t used;    /* when it was last claimed from, for giving up the oldest */
    uint32_t claimed; /* bit per exposure: being copied, or in */
    uint32_t copying, filled;
    unsigned char *raw[LS_MAX_EXPOSURES];
    double exposure_s[LS_MAX_EXPOSURES];
    uint64_t pulse_ns, arrived_ns; /* of its latest frame: start of the pulse, arrival */
    uint8_t *validity;
    uint16_t *half;
    struct ls_merge_params params;
    struct ls_merge_spans spans;
    uint32_t n_bands, bands_taken, bands_done; /* 0 bands: merging has not begun */
};

struct ls_accumulators {
    uint32_t n, n_exposures;
    uint64_t clock;
    struct ls_accumulator *items;
};

/** Bytes of one accumulator. */
size_t ls_accumulator_bytes(size_t payload_bytes, size_t n_px, uint32_t n_exposures);

/** @n accumulators of @n_exposures frames of @payload_bytes, touched. LS_ERR_NOMEM. */
LS_MUST_CHECK enum ls_err ls_accumulators_init(struct ls_accumulators *pool, uint32_t n,
                                               uint32_t n_exposures, size_t payload_bytes,
                                               size_t n_px);

/** Zeroed pools are allowed. */
void ls_accumulators_finish(struct ls_accumulators *pool);

/** The accumulator filling for @condition, or NULL. */
struct ls_accumulator *ls_accumulators_find(struct ls_accumulators *pool, uint32_t condition);

/**
 * One for @condition: the one filling, else a free one, else the longest unused one that is filling
 * and not being copied into, which is given up. *given_up: its condition, or -1. NULL if all are
 * busy.
 */
struct ls_accumulator *ls_accumulators_claim(struct ls_accumulators *pool, uint32_t condition,
                                             int64_t *given_up);

/** The one with bands to be taken whose last frame came first, or NULL. Any other order would let
 * some wait as long as the rest are busy. */
struct ls_accumulator *ls_accumulators_waiting(const struct ls_accumulators *pool);

/** Empty it. */
void ls_accumulator_free(struct ls_accumulator *accumulator);

#endif
