/*
 * left_out: which pictures a weighted sum may leave out of a tile.
 * Layer: core. Threads: one at a time per object. Ownership: see init and finish.
 *
 * Leaving picture i out of a sum under weight w changes no pixel by more than |w| reach_i, where
 * reach_i bounds what the picture puts there under weight 1. Pictures are left out from the least
 * bound up (the largest over all sums; ties: lowest picture) as long as the bounds of what is left
 * out add up to at most max_error in every sum. Greedy, so not the most pictures that could be.
 */
#ifndef LS_CORE_LEFT_OUT_H
#define LS_CORE_LEFT_OUT_H

#include "core/error.h"

#include <stdbool.h>
#include <stdint.h>

struct ls_left_out {
    uint32_t n_pictures, n_sums;
    const float *weights; /* [n_sums][n_pictures] */
    double *reach;        /* [n_pictures], >= 0; the caller fills it before each choice */
    bool *skip;           /* [n_pictures], the last choice */
    double bound;         /* the largest sum of bounds left out, over all choices and sums */
    struct ls_left_out_place {
        double most;
        uint32_t picture;
    } * order;
    double *total; /* [n_sums] */
};

/** @weights: [n_sums][n_pictures], finite, (transfer none). Errors: LS_ERR_NOMEM. */
LS_MUST_CHECK enum ls_err ls_left_out_init(struct ls_left_out *left, const float *weights,
                                           uint32_t n_pictures, uint32_t n_sums);

/** From `reach`, choose anew. A reach of Inf or NaN is never left out. RT-safe. */
void ls_left_out_choose(struct ls_left_out *left, double max_error);

/** Zeroed is allowed. */
void ls_left_out_finish(struct ls_left_out *left);

#endif
