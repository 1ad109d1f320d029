/*
 * separated_kernels: the inner loops of core/separated.h, one instance per instruction set.
 * Layer: core. Threads: any; no state. Ownership: everything is the caller's.
 *
 * All instances return the same bits: the operations and their order stand below, none is fused.
 */
#ifndef LS_CORE_SEPARATED_KERNELS_H
#define LS_CORE_SEPARATED_KERNELS_H

#include "core/conductor.h"
#include "core/cpu.h"
#include "core/separated.h"
#include "core/separate.h"

#include <stddef.h>
#include <stdint.h>

enum { LS_SEPARATED_GROUP = 8 }; /* lights per partial sum */

/** What a light's samples become. */
struct ls_separated_terms {
    struct ls_split split;
    float variance, shot_v, shot_h; /* of S: variance + shot_v max(v, 0) + shot_h max(h, 0) */
};

struct ls_separated_kernels {
    /** n halves at any address, widened; those not finite become 0 and are counted. n <= 68. */
    unsigned (*widen)(const void *halfs, size_t n, float *out);
    /** d = d_v v + d_h h, s = s_v v + s_h h, variance = (variance + shot_v v+) + shot_h h+. */
    void (*split)(const struct ls_separated_terms *terms, const float *v, const float *h, size_t n,
                  float *d, float *s, float *variance);
    /** sigma[j] = scale sqrt(max of row and next at j and j + 1). Reads n + 1 of each. */
    void (*sigma)(const float *row, const float *next, size_t n, float scale, float *sigma);
    /** As ls_conductor_part. */
    void (*conductor)(const struct ls_conductor *conductor, const float *const s[3],
                      const float *sigma, size_t n, float *const out[3], float *share);
    /** sum[j] += ((w[0] x_0[j] + w[1] x_1[j]) + ...) over n_lights <= 8, x_k = values + k stride.
     */
    void (*add)(const float *w, uint32_t n_lights, const float *values, size_t stride, size_t n,
                float *sum);
};

extern const struct ls_separated_kernels ls_separated_kernels_c;

/** (transfer none). */
const struct ls_separated_kernels *ls_separated_kernels(enum ls_isa isa);

/** ls_separated_accumulate with given kernels (tests, benchmarks). */
LS_MUST_CHECK enum ls_err ls_separated_accumulate_with(
    const struct ls_separated_kernels *kernels, const struct ls_separated_job *job, float *diffuse,
    float *specular, float *conductor, struct ls_separated_report *report, struct ls_diag *diag);

#endif
