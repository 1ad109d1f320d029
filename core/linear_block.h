/*
 * linear block: the fit of core/linear.h for a block of pixels, side by side; one instance per
 * instruction set.
 * Layer: core, for linear.c, linear_error.c and mono_blend.c. Threads: any (no state). Ownership:
 * the caller's.
 *
 * All instances return the same bits: they are one source (core/linear_lanes.inc), of double
 * operations in a fixed order, none fused, none across pixels. The result of a pixel does not
 * depend on its neighbours in the block.
 */
#ifndef LS_CORE_LINEAR_BLOCK_H
#define LS_CORE_LINEAR_BLOCK_H

#include "core/cpu.h"
#include "core/linear.h"

enum { LS_LINEAR_BLOCK = 64 };

/** Pixels first, first + stride .. of a band; n at most LS_LINEAR_BLOCK. */
struct ls_linear_span {
    size_t first;
    uint32_t n, stride;
};

/** Sums over segments of a band, with what Eq. 1 makes of them. */
struct ls_linear_sums {
    float *room;
    float *v, *sigma; /* [pixels][n_in] */
    float *f, *ratio; /* [pixels][n_out] */
};

/** As struct ls_linear_error, of each pixel of a span. */
struct ls_linear_pixel_errors {
    double difference[LS_LINEAR_BLOCK], noise[LS_LINEAR_BLOCK], single[LS_LINEAR_BLOCK],
        total[LS_LINEAR_BLOCK];
};

struct ls_linear_kernels {
    /** M of the pixels, out[n][n_out][n_in]. */
    void (*fit)(const struct ls_linear_pictures *pictures, const struct ls_linear_options *options,
                const struct ls_linear_sums *sums, const struct ls_linear_span *span, float *out);
    /** Every segment left out of the fit by a rank-one downdate, and predicted by the rest; of at
     * least three. */
    void (*predict)(const struct ls_linear_pictures *pictures,
                    const struct ls_linear_options *options, const struct ls_linear_sums *sums,
                    const struct ls_linear_span *span, struct ls_linear_pixel_errors *errors);
};

extern const struct ls_linear_kernels ls_linear_kernels_c, ls_linear_kernels_avx2,
    ls_linear_kernels_avx512;

/** (transfer none). */
const struct ls_linear_kernels *ls_linear_kernels(enum ls_isa isa);

/** smoothstep((x - 4) / 6): how far a value of x sigma is trusted. RT-safe. */
double ls_linear_trust(double snr);

/** Is it a part of them? LS_ERR_INVALID, LS_ERR_STATE: those of ls_linear_fit. */
LS_MUST_CHECK enum ls_err ls_linear_check_part(const struct ls_linear_pictures *pictures,
                                               const struct ls_linear_part *part,
                                               struct ls_diag *diag);

/** Check pictures and options, and sum up. ls_linear_sums_finish also after an error. */
LS_MUST_CHECK enum ls_err ls_linear_sums_init(const struct ls_linear_pictures *pictures,
                                              const struct ls_linear_options *options,
                                              uint32_t first_row, uint32_t n_rows,
                                              struct ls_linear_sums *sums, struct ls_diag *diag);
void ls_linear_sums_finish(struct ls_linear_sums *sums);

/** ls_linear_fit with the kernels of a given instruction set (tests, benches). */
LS_MUST_CHECK enum ls_err ls_linear_fit_with(const struct ls_linear_kernels *kernels,
                                             const struct ls_linear_pictures *pictures,
                                             const struct ls_linear_options *options,
                                             const struct ls_linear_part *part,
                                             struct ls_diag *diag);

#endif
