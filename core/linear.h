/*
 * linear: promotion by a matrix per pixel, fitted on pictures of segments of the dome.
 * Layer: core. Threads: any (no state). Ownership: all arrays are the caller's.
 *
 * Eq. 1 of LeGendre, Yu and Debevec is a diagonal linear map per pixel fitted on one picture. Here
 *     R(i,p,s,.) = M_s(p) v(i,p)
 * with v what was photographed per light (white on RGB: 3 values; a mono camera may add spectra),
 * and M_s(p), [n_out][n_in], fitted on G pictures F_g of segments in spectrum s against
 *     V_g = sum over lights i of segment g of g(i,s) v(i,p)
 * which holds the strengths of *that* spectrum, because F_g was photographed with them. All is
 * demosaiced before it comes here. M_s commutes with relighting: sum v under the weights of s,
 * demosaic, apply M_s once.
 *
 * The fit. D is Eq. 1 on the sums over segments, F = sum F_g, V = sum V_g: the stable ratio of
 * core/promote.h, D[c][inputs[c]]. M = D + q Z, where Z minimises
 *     sum_g w_g^2 |(D + Z) V_g - F_g|^2 + b^2 |(D + Z) p(0) - p(s)|^2 / |p(0)|_mean^2 + lambda
 * |Z|^2 subject to (D + Z) V = F w_g     1 / max(brightness of V_g, row_floor x the mean
 * segment's), less where noise rules, so that shadows count as much as lit areas; brightness is the
 * mean over inputs b       dielectric_weight: a light without colour of its own meets the
 * dielectric coat of a surface before its colour, and comes back as p(s) if p(0) went in lambda
 * ridge x mean of the diagonal of the normal matrix: Tikhonov towards Eq. 1 (Hoerl and Kennard,
 * Technometrics 12, 1970) q       smoothstep((V/sigma - 4) / 6) of the darkest input and output:
 * from 10 sigma on the full sphere is reproduced exactly, below M fades into Eq. 1, which itself
 * fades into its neighbourhood One segment holds nothing that Eq. 1 does not know: G = 1 returns D,
 * to the bit. A segment with a value that is not finite is left out of the rows; if it makes the
 * sum over segments not finite, M = D there. Negative values are honest noise. The result is finite
 * for any input.
 */
#ifndef LS_CORE_LINEAR_H
#define LS_CORE_LINEAR_H

#include "core/error.h"
#include "core/promote.h"

#include <stddef.h>
#include <stdint.h>

enum {
    LS_LINEAR_MAX_INPUTS = 6,
    LS_LINEAR_MAX_OUTPUTS = 3,
    LS_LINEAR_MAX_SEGMENTS = 1024,
    LS_LINEAR_HALO_PX = LS_PROMOTE_HALO_PX, /* pixels around a result that it may depend on */
};

/** Variance of a value x: floor + shot max(x, 0), in the unit of the picture, squared. */
struct ls_linear_noise {
    double floor, shot;
};

/** Pictures of one spectrum over a band of rows: [height][width][n_in or n_out]. */
struct ls_linear_pictures {
    uint32_t width, height;
    uint32_t n_segments;
    uint32_t n_in, n_out;
    const float *const *v;                  /* [n_segments] -> [height][width][n_in] */
    const float *const *f;                  /* [n_segments] -> [height][width][n_out] */
    const struct ls_linear_noise *v_noise;  /* [n_segments], shot the same or less for the sum */
    const struct ls_linear_noise *f_noise;  /* [n_segments] */
    struct ls_linear_noise total_noise;     /* of the sum of all v */
    const double *p_in;                     /* [n_in], p of what each input photographed */
    const double *p_out;                    /* [n_out], p(s,c) */
    uint32_t inputs[LS_LINEAR_MAX_OUTPUTS]; /* the input that Eq. 1 scales for each output */
    int demosaiced;                         /* V's contrast counts as noise (core/promote.h) */
};

struct ls_linear_options {
    double ridge;             /* 0.003 */
    double row_floor;         /* 1e-3 */
    double dielectric_weight; /* 1; 0 = no such row */
};

/** The values in the comments above. RT-safe. */
void ls_linear_options_default(struct ls_linear_options *options);

/**
 * M for rows [first_row, first_row + n_rows) of the band, out[n_rows][width][n_out][n_in]. The band
 * must carry LS_LINEAR_HALO_PX rows around them (fewer at the picture's border); the result then
 * does not depend on the band, to the bit. Allocates for the band: about
 * (6 n_out + n_in) floats per pixel. Errors: LS_ERR_INVALID (sizes, numbers of p not finite and
 * positive, inputs, options), LS_ERR_NOMEM.
 */
LS_MUST_CHECK enum ls_err ls_linear_fit(const struct ls_linear_pictures *pictures,
                                        const struct ls_linear_options *options, uint32_t first_row,
                                        uint32_t n_rows, float *out, struct ls_diag *diag);

/**
 * out[n][n_out] = M v for n pixels: m[n][n_out][n_in], v[n][n_in]; float, inputs added in order.
 * RT-safe.
 */
void ls_linear_apply(const float *m, const float *v, size_t n, uint32_t n_in, uint32_t n_out,
                     float *out);

/** Squares of one spectrum, summed over pixels; add those of bands and divide at the end. */
struct ls_linear_error {
    double difference; /* sum of squares predicted - photographed, less what noise explains */
    double total;      /* sum of squares photographed, less noise */
    uint64_t n;        /* pixels */
};

/**
 * The error of M without truth: each segment is left out of the fit (its rows and its part of the
 * sums) and predicted from the rest, by an exact rank-one downdate. Every @step-th pixel of every
 * @step-th row of the rows given is taken. Adds to *error; with @per_pixel [n_rows][width] not
 * NULL, also writes there the relative error of each pixel taken (others are not touched).
 * sqrt(difference / total) estimates the relative RMS error of the field in this spectrum.
 * With one segment there is nothing to leave out: LS_ERR_STATE. Other errors as ls_linear_fit.
 */
LS_MUST_CHECK enum ls_err ls_linear_leave_one_out(const struct ls_linear_pictures *pictures,
                                                  const struct ls_linear_options *options,
                                                  uint32_t first_row, uint32_t n_rows,
                                                  uint32_t step, struct ls_linear_error *error,
                                                  float *per_pixel, struct ls_diag *diag);

#endif
