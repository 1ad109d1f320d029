/*
 * relight: weighted sums over all lights of a field in one pass, and pictures made from them.
 * Layer: core. Threads: reentrant; a caller splits a picture by regions of tiles, and the result
 * does not depend on the split. Ownership: all arrays are the caller's.
 *
 * out(p) = sum_s ratio(p,s) sum_i w(i,s) k(i,0) E(i,p): the spectra's sums, the denominators V and
 * any number of environments are all rows of weights over the same pictures, so one pass over the
 * field serves them all. Demosaic and ratio come after, once per sum.
 */
#ifndef LS_CORE_RELIGHT_H
#define LS_CORE_RELIGHT_H

#include "core/demosaic.h"
#include "core/error.h"
#include "core/field.h"

#include <stddef.h>
#include <stdint.h>

enum { LS_ACCUMULATE_MAX_SUMS = 256 };

/** What to sum. */
struct ls_accumulate_job {
    const struct ls_picture *pictures; /* [n_pictures]: a field's white, or its spheres */
    uint32_t n_pictures;
    uint32_t n_sums;
    const float *weights;  /* [n_sums][n_pictures] */
    const float *tile_max; /* [tiles_y * tiles_x][n_pictures], max |value| of the tile; or NULL */
    size_t row_stride;     /* floats from row to row of a sum; 0 = the region's width */
    size_t sum_stride;     /* floats from sum to sum; 0 = its rows */
    double max_error;      /* per sum and pixel, in stored units: what may be left out; 0 = none.
                              Needs tile_max */
};

struct ls_accumulate_report {
    double bound;        /* largest sum of |w| tile_max left out, over sums and tiles */
    uint64_t tiles_read; /* (picture, tile) pairs */
    uint64_t tiles_skipped;
    uint64_t not_finite; /* stored Inf or NaN met; each counted as 0 */
};

/**
 * sums[n_sums][height][width] of the region's pixels: sums[q] = sum_i weights[q][i] picture_i.
 * Larger strides put a region in its place among others', between them nothing is written
 * (core/relight_rows.h).
 * A picture whose weight is 0 in every sum is never read, nor is a NULL tile. With max_error, the
 * pairs of least bound (ties: lowest picture) are left out of a tile as long as what is left out
 * stays under max_error in every sum; report->bound says how much that is. With tile_max, a tile
 * that is 0 in every picture that counts is not read either, whatever max_error: the sums are the
 * same bits.
 *
 * Accuracy: |error| <= (min(n, 8) + ceil(n/8)) 2^-24 sum_i |w_i e_i| + bound (+ 2^-150 per
 * picture where products leave the range of normal floats), n the pictures read: partial sums of
 * 8 pictures in ascending order, each step one fused multiply-add, then the partial sums in
 * ascending order, all in float. Every instruction set returns the same bits, whatever the region,
 * the number of threads or what is summed beside. A stored Inf or NaN counts as 0 and is counted in
 * the report.
 * Allocates copies of the weights, and the sums of a tile or room for 512 pixels of each picture.
 * Errors: LS_ERR_INVALID (region, a weight that is not finite, max_error without tile_max),
 * LS_ERR_NOMEM.
 */
LS_MUST_CHECK enum ls_err ls_accumulate(const struct ls_field *field,
                                        const struct ls_accumulate_job *job,
                                        const struct ls_tile_region *region, float *sums,
                                        struct ls_accumulate_report *report, struct ls_diag *diag);

struct ls_accumulate_kernels;

/** ls_accumulate with the kernels of a given instruction set, see accumulate_kernels.h (tests,
 * benches). */
LS_MUST_CHECK enum ls_err
ls_accumulate_with(const struct ls_accumulate_kernels *kernels, const struct ls_field *field,
                   const struct ls_accumulate_job *job, const struct ls_tile_region *region,
                   float *sums, struct ls_accumulate_report *report, struct ls_diag *diag);

/** Weight row of @n lights, for ls_accumulate: row[i] = w[i] k[i], @w in radiance x sr, @k the
 * gains of their pictures. @w NULL = 1. Of relit white w is the environment's, of Eq. 1's
 * denominator the strengths g(i,s) (core/promote.h). RT-safe. */
void ls_relight_row(const double *k, const double *w, uint32_t n, float *row);

/** The tristimulus baseline: weights of white for camera channel @c from those of the light, in
 * place: w[i] / p(0,c); mono has one channel for all. [n_lights]. RT-safe. */
void ls_relight_tristimulus(const struct ls_field *field, uint32_t c, double *w);

/** Demosaic a sum as the field says: @window is what of the picture @sum holds
 * ([window.height][window.width]),
 * @region the part wanted (with its halo inside the window, see ls_demosaic_needs). Mono copies.
 * out[region.height][region.width][n_channels]. Errors as ls_demosaic. */
LS_MUST_CHECK enum ls_err ls_relight_demosaic(const struct ls_field *field, const float *sum,
                                              struct ls_demosaic_region window,
                                              struct ls_demosaic_region region, float *out);

/** One addend of a picture. Maps cover the region's rows: [height][width][...], map_stride floats
 * from row to row. */
struct ls_relight_term {
    const float *sum;    /* mosaic over the window */
    const float *ratio;  /* [height][width][n_channels]; NULL = 1 (white) */
    const float *matrix; /* [height][width][3][n_channels] instead of a ratio (core/linear.h), for
                            channel -1 of Bayer; NULL = none */
    size_t map_stride;   /* of whichever of them is given; 0 = its rows follow each other */
    int32_t channel;     /* -1: shared weights, every channel of the demosaiced sum goes to the same
                            channel of the output (mono: to all three). 0..2: only this camera
                            channel (RGB, unequal weights), or this output channel (mono) */
};

/**
 * out[region.height][region.width][3]: the sum over terms of scale x demosaic(sum) x ratio, or of
 * matrix (scale x demosaic(sum)) with its products added in order of the channels; terms added in
 * order, then @m (row-major 3x3; NULL = none). All in float, nothing fused, except @m in double: a
 * pixel is the same bits in any region. Holds four demosaiced rows of one term. Errors:
 * LS_ERR_INVALID, LS_ERR_NOMEM.
 */
LS_MUST_CHECK enum ls_err ls_relight_finish(const struct ls_field *field,
                                            struct ls_demosaic_region window,
                                            struct ls_demosaic_region region,
                                            const struct ls_relight_term *terms, size_t n_terms,
                                            const double *m, float *out, struct ls_diag *diag);

#endif
