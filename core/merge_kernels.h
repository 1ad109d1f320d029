/*
 * merge_kernels: the arithmetic of merge.h on groups of pixels, once per instruction set.
 * Layer: core, inside the merge only. Threads: any; pure. Ownership: everything is the caller's.
 */
#ifndef LS_CORE_MERGE_KERNELS_H
#define LS_CORE_MERGE_KERNELS_H

#include "core/cpu.h"
#include "core/merge.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* Kernels work on multiples of this many pixels, the most lanes of any instruction set. */
enum { LS_MERGE_GROUP = 16 };

/** The parameters as the kernels want them. Times are in units of the longest exposure, exposures
 * ascend. Weights are w' = t / sigma^2 = 1 / (floor / t + shot max(E, 0)). */
struct ls_merge_model {
    uint32_t n;
    uint32_t order[LS_MERGE_MAX_EXPOSURES]; /* sorted -> caller's index */
    float t[LS_MERGE_MAX_EXPOSURES];        /* (0, 1] */
    float floor_t[LS_MERGE_MAX_EXPOSURES];  /* noise without light / t, DN^2 */
    float low, high, clip;                  /* DN */
    float noise, shot;                      /* sigma^2 = noise + shot max(E t, 0), DN^2 */
    float scale, scale2;                    /* DN per longest exposure -> full scale / s, squared */
    float reference_s;
    bool products; /* weights as products of the others' variances cannot leave float's range */
    bool wide;     /* samples of 16 bits, else 8 */
};

/** Where a run of pixels is. */
struct ls_merge_lines {
    const void *x[LS_MERGE_MAX_EXPOSURES];     /* samples, sorted as in the model */
    const float *dark[LS_MERGE_MAX_EXPOSURES]; /* DN */
    float *e, *variance;                       /* or NULL */
    uint16_t *half;                            /* or NULL */
    uint8_t *validity;
};

struct ls_merge_kernels {
    /* Merge @n pixels, a multiple of LS_MERGE_GROUP. Any alignment of elements. */
    void (*run)(const struct ls_merge_model *model, const struct ls_merge_lines *lines, size_t n);
};

extern const struct ls_merge_kernels ls_merge_kernels_c, ls_merge_kernels_avx2,
    ls_merge_kernels_avx512;

/** All return the same bits. (transfer none). RT-safe. */
const struct ls_merge_kernels *ls_merge_kernels(enum ls_isa isa);

/** ls_merge_rows with given kernels (tests, benchmarks). RT-safe. */
void ls_merge_rows_with(const struct ls_merge_kernels *kernels,
                        const struct ls_merge_params *params, const struct ls_merge_spans *spans,
                        uint32_t first_row, uint32_t n_rows);

#endif
