/*
 * split_samples: samples of one light separated as the separated sums do it, without the sums.
 * Layer: tests. Threads: any. Ownership: arrays are the caller's.
 */
#ifndef LS_TESTS_CORE_SPLIT_SAMPLES_H
#define LS_TESTS_CORE_SPLIT_SAMPLES_H

#include "core/separated_kernels.h"

#include <string.h>

/** @n samples of V and H, ungained and finite. */
static inline void split_samples(const struct ls_split *split, const float *v, const float *h,
                                 size_t n, float *d, float *s)
{
    const struct ls_separated_kernels *kernels = ls_separated_kernels(ls_cpu_isa());
    const struct ls_separated_terms terms = {.split = *split};
    float room[5][LS_SEPARATED_PAD] = {{0}};
    for (size_t k, j = 0; j < n; j += k) {
        k = n - j < LS_SEPARATED_PAD ? n - j : LS_SEPARATED_PAD;
        memcpy(room[0], v + j, k * sizeof *v);
        memcpy(room[1], h + j, k * sizeof *h);
        kernels->split(&terms, room[0], room[1], k, room[2], room[3], room[4]);
        memcpy(d + j, room[2], k * sizeof *d);
        memcpy(s + j, room[3], k * sizeof *s);
    }
}

#endif
