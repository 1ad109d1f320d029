/*
 * accumulate_kernels: the inner loop of ls_accumulate (relight.h), one instance per instruction
 * set. All return the same bits. Layer: core. Threads: any; pure. Users include relight.h; this is
 * for the kernels' own files, their tests and benches.
 */
#ifndef LS_CORE_ACCUMULATE_KERNELS_H
#define LS_CORE_ACCUMULATE_KERNELS_H

#include "core/cpu.h"

#include <stddef.h>
#include <stdint.h>

enum {
    LS_ACCUMULATE_GROUP = 32,  /* pictures per partial sum, at most */
    LS_ACCUMULATE_PANEL = 128, /* pixels taken at a time */
};

struct ls_accumulate_kernels {
    /**
     * For q < n_sums, j < count: part = 0; part = fmaf(w[i][q], e[i][j], part) for i = 0 .. n - 1;
     * acc[q * stride + j] += part. e[i] are @count halves at @halfs[i], any alignment; an Inf or
     * NaN among them counts as 0, and the function returns how many there were. n <= 32.
     * @acc: rows with room for @count rounded up to LS_ACCUMULATE_PANEL, which may be overwritten
     * with anything. Weights finite; n_sums >= 1. RT-safe.
     * @next: [n], any addresses: where reading is likely to go on, fetched meanwhile.
     */
    unsigned (*add)(const void *const *halfs, const void *const *next, const float *const *w,
                    uint32_t n, uint32_t count, uint32_t n_sums, float *acc, size_t stride);
};

extern const struct ls_accumulate_kernels ls_accumulate_kernels_c, ls_accumulate_kernels_avx2,
    ls_accumulate_kernels_avx512;

/** (transfer none). RT-safe. */
const struct ls_accumulate_kernels *ls_accumulate_kernels(enum ls_isa isa);

#endif
