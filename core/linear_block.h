/*
 * linear block: the normal equations of core/linear.h for a block of pixels, side by side.
 * Layer: core, for linear.c and linear_error.c. Threads: any (no state). Ownership: the caller's.
 *
 * Every array has the pixel innermost, so that a compiler makes vectors of it. Nothing is added
 * across pixels: the result of one does not depend on its neighbours in the block.
 */
#ifndef LS_CORE_LINEAR_BLOCK_H
#define LS_CORE_LINEAR_BLOCK_H

#include "core/linear.h"

enum {
    LS_LINEAR_BLOCK = 64,
    LS_LINEAR_TRIANGLE = LS_LINEAR_MAX_INPUTS * (LS_LINEAR_MAX_INPUTS + 1) / 2,
};

/** One segment's row of each pixel: v, f times its weight, in units of the mean brightness, and the
 * variance of that. */
struct ls_linear_row {
    double noise[LS_LINEAR_BLOCK];
    double v[LS_LINEAR_MAX_INPUTS][LS_LINEAR_BLOCK];
    double f[LS_LINEAR_MAX_OUTPUTS][LS_LINEAR_BLOCK];
};

/** Sums of rows. Element (a, b), b <= a, of a symmetric matrix is [a (a + 1) / 2 + b]. */
struct ls_linear_normal {
    double noise[LS_LINEAR_BLOCK];
    double vv[LS_LINEAR_TRIANGLE][LS_LINEAR_BLOCK];
    double vf[LS_LINEAR_MAX_INPUTS][LS_LINEAR_MAX_OUTPUTS][LS_LINEAR_BLOCK];
    double n_rows;
};

/** What M must make of the sum over segments, Eq. 1 (D), and how far to trust it. */
struct ls_linear_total {
    double v[LS_LINEAR_MAX_INPUTS][LS_LINEAR_BLOCK];
    double f[LS_LINEAR_MAX_OUTPUTS][LS_LINEAR_BLOCK];
    double ratio[LS_LINEAR_MAX_OUTPUTS][LS_LINEAR_BLOCK];
    double trust[LS_LINEAR_BLOCK];          /* q */
    double per_brightness[LS_LINEAR_BLOCK]; /* 1 / the mean segment's; 0: nothing to fit */
};

struct ls_linear_matrix {
    double m[LS_LINEAR_MAX_OUTPUTS][LS_LINEAR_MAX_INPUTS][LS_LINEAR_BLOCK];
};

/** Row of segment @g for @n pixels from pixel @first of the band. */
void ls_linear_block_row(const struct ls_linear_pictures *pictures,
                         const struct ls_linear_options *options, uint32_t g, size_t first,
                         uint32_t n, const struct ls_linear_total *total,
                         struct ls_linear_row *row);

/** normal += sign x row: 1 adds it, -1 takes it out again. */
void ls_linear_block_add(const struct ls_linear_pictures *pictures, const struct ls_linear_row *row,
                         double sign, struct ls_linear_normal *normal);

/** M of every pixel; D where nothing is fitted. */
void ls_linear_block_solve(const struct ls_linear_pictures *pictures,
                           const struct ls_linear_options *options,
                           const struct ls_linear_normal *normal,
                           const struct ls_linear_total *total, struct ls_linear_matrix *out);

/** smoothstep((x - 4) / 6): how far a value of x sigma is trusted. RT-safe. */
double ls_linear_trust(double snr);

/** Sums over segments of a band, with what Eq. 1 makes of them. */
struct ls_linear_sums {
    float *room;
    float *v, *sigma; /* [pixels][n_in] */
    float *f, *ratio; /* [pixels][n_out] */
};

/** Check pictures and options, and sum up. ls_linear_sums_finish also after an error. */
LS_MUST_CHECK enum ls_err ls_linear_sums_init(const struct ls_linear_pictures *pictures,
                                              const struct ls_linear_options *options,
                                              uint32_t first_row, uint32_t n_rows,
                                              struct ls_linear_sums *sums, struct ls_diag *diag);
void ls_linear_sums_finish(struct ls_linear_sums *sums);

/** Totals of @n pixels from pixel @first of the band. */
void ls_linear_sums_block(const struct ls_linear_pictures *pictures,
                          const struct ls_linear_sums *sums, size_t first, uint32_t n,
                          struct ls_linear_total *total);

#endif
