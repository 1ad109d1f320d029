/*
 * separated_kernels: the inner loops of core/separated.h, one instance per instruction set.
 * Layer: core. Threads: any; no state. Ownership: everything is the caller's.
 *
 * All instances return the same bits: the operations and their order stand below, fused only where
 * fmaf is written. Every span but the halves has room for n rounded up to LS_SEPARATED_PAD values
 * (and sigma's inputs for one more); what stands there is read and overwritten, and means nothing.
 */
#ifndef LS_CORE_SEPARATED_KERNELS_H
#define LS_CORE_SEPARATED_KERNELS_H

#include "core/conductor.h"
#include "core/cpu.h"
#include "core/separate.h"
#include "core/separated.h"

#include <stddef.h>
#include <stdint.h>

enum {
    LS_SEPARATED_GROUP = 8, /* lights per partial sum */
    LS_SEPARATED_PAD = 16,
};

/** What a light's samples become. */
struct ls_separated_terms {
    struct ls_split split;
    float variance, shot_v, shot_h; /* of S: (variance + shot_v max(v, 0)) + shot_h max(h, 0) */
};

/** Sums: sum + q sum_stride gets the rows of weights w[q] over lights' values x_k = values + k
 * stride. */
struct ls_separated_add {
    const float (*w)[LS_SEPARATED_GROUP];
    uint32_t n_rows, n_lights; /* n_lights in [1, LS_SEPARATED_GROUP] */
    const float *values;
    size_t stride, n;
    float *sum;
    size_t sum_stride;
};

struct ls_separated_kernels {
    /** n halves at any address, widened; those not finite become 0 and are counted. Exactly n are
     * read and written. */
    unsigned (*widen)(const void *halfs, size_t n, float *out);
    /** d = d_v v + d_h h, s = s_v v + s_h h, and the variance of s. Accuracy of s: |error| <= 3
     * 2^-24 (|s_v v| + |s_h h|), likewise of d. */
    void (*split)(const struct ls_separated_terms *terms, const float *v, const float *h, size_t n,
                  float *d, float *s, float *variance);
    /** sigma[j] = scale sqrt(max of row and next at j and j + 1). */
    void (*sigma)(const float *row, const float *next, size_t n, float scale, float *sigma);
    /** As ls_conductor_part on three planes in place. */
    void (*conductor)(const struct ls_conductor *conductor, float *const s[3], const float *sigma,
                      size_t n);
    /** sum[j] += fmaf(w[7], x_7[j], .. fmaf(w[0], x_0[j], 0)), for every row. */
    void (*add)(const struct ls_separated_add *add);
};

extern const struct ls_separated_kernels ls_separated_kernels_c, ls_separated_kernels_avx2,
    ls_separated_kernels_avx512;

/** (transfer none). */
const struct ls_separated_kernels *ls_separated_kernels(enum ls_isa isa);

/** ls_separated_accumulate with given kernels (tests, benchmarks). */
LS_MUST_CHECK enum ls_err ls_separated_accumulate_with(
    const struct ls_separated_kernels *kernels, const struct ls_separated_job *job, float *diffuse,
    float *specular, float *conductor, struct ls_separated_report *report, struct ls_diag *diag);

#endif
