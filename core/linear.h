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
 *     mean over g of w_g^2 |(D + Z) V_g - F_g|^2 + (d / P)^2 |(D + Z) p(0) - p(s)|^2
 *         + sum over inputs a of mu_a |(D + Z)_a|^2 + lambda |Z|^2
 *     subject to (D + Z) V = F
 *   w_g     1 / sqrt(b^2 + n^2 / row_noise^2): b the brightness of V_g (mean over inputs), at least
 *           row_floor of the mean segment's; n its noise and that of F_g (divided by the mean of
 *           p(s) over that of p(0)). Shadows count as much as lit areas while their noise is below
 *           row_noise of their brightness, and less from there on
 *   d       dielectric_weight, P the mean of p(0): light mirrored by the coat of a dielectric has
 *           never met its colour, so p(0) must become p(s). One such row counts as much as all
 *           segments together
 *   mu      noise_ridge x mean over lights of the variance of v_a, in units of the mean light's
 *           brightness: M is for pictures of single lights, which are sqrt(N / G) times noisier
 *           than the rows it is fitted on. Columns that only tell apart what that noise hides would
 *           amplify it, so what M makes of it is paid for: that of M and not of Z, because the sum
 *           is held and Eq. 1, one channel for one channel, is not the quietest map that holds it.
 *           Without noise nothing; the darker the pixel the more
 *   lambda  ridge x mean of the diagonal of the normal matrix: towards Eq. 1 (Hoerl and Kennard,
 *           Technometrics 12, 1970)
 *   q       smoothstep((V/sigma - 4) / 6) of V's least certain input: from 10 sigma on the full
 *           sphere is reproduced exactly, below M fades into Eq. 1, which itself fades into its
 *           neighbourhood
 * One segment holds nothing that Eq. 1 does not know: G = 1 returns D, to the bit. So does a pixel
 * with a value that is not finite in any segment, or with sum V not positive in brightness.
 * Negative values are honest noise. The result is finite for any input.
 *
 * Accuracy. Sums and solve are in double: the full sphere is reproduced within 1e-5 of its
 * brightest channel where q = 1 (M is rounded to float). Against a solve in long double, M differs
 * by less than 1e-5 of its largest element.
 */
#ifndef LS_CORE_LINEAR_H
#define LS_CORE_LINEAR_H

#include "core/error.h"
#include "core/promote.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum {
    LS_LINEAR_MAX_INPUTS = 6,
    LS_LINEAR_MAX_OUTPUTS = 3,
    LS_LINEAR_MAX_SEGMENTS = 1024,
    LS_LINEAR_MAX_LIGHTS = 65536,
    LS_LINEAR_MAX_STEP = 65536,
    LS_LINEAR_HALO_PX = LS_PROMOTE_HALO_PX, /* pixels around a result that it may depend on */
};

/** Variance of a value x: floor + shot max(x, 0), in the unit of the picture, squared. */
struct ls_linear_noise {
    double floor, shot;
};

/** Pictures of one spectrum over a band of rows: [height][width][n_in or n_out]. */
struct ls_linear_pictures {
    uint32_t width, height;
    uint32_t n_segments, n_lights; /* of the dome, all segments together */
    uint32_t n_in, n_out;
    const float *const *v;                  /* [n_segments] -> [height][width][n_in] */
    const float *const *f;                  /* [n_segments] -> [height][width][n_out] */
    const struct ls_linear_noise *v_noise;  /* [n_segments], of sums over single lights */
    const struct ls_linear_noise *f_noise;  /* [n_segments] */
    struct ls_linear_noise total_noise;     /* of the sum of all v */
    const double *p_in;                     /* [n_in], p of what each input photographed */
    const double *p_out;                    /* [n_out], p(s,c) */
    uint32_t inputs[LS_LINEAR_MAX_OUTPUTS]; /* the input that Eq. 1 scales for each output */
    bool demosaiced;                        /* V's contrast counts as noise (core/promote.h) */
};

struct ls_linear_options {
    double ridge;             /* 1e-4 */
    double noise_ridge;       /* 2 */
    double row_floor;         /* 1e-3 */
    double row_noise;         /* 0.02 */
    double dielectric_weight; /* 1; 0 = no such row */
};

/** The values beside the members. RT-safe. */
void ls_linear_options_default(struct ls_linear_options *options);

/**
 * out[n][n_out] = M v for n pixels: m[n][n_out][n_in], v[n][n_in]; float, inputs added in order.
 * RT-safe.
 */
void ls_linear_apply(const float *m, const float *v, size_t n, uint32_t n_in, uint32_t n_out,
                     float *out);

/** Squares summed over pixels; sums of parts may be added. */
struct ls_linear_error {
    double difference; /* of predicted - photographed */
    double noise;      /* what noise of both should contribute to difference */
    double single;     /* what M makes of single lights' noise, as if segments were single lights */
    double total;      /* of photographed */
    uint64_t pixels;
};

/** *sum += *part. RT-safe. */
void ls_linear_error_add(struct ls_linear_error *sum, const struct ls_linear_error *part);

/**
 * sqrt((max(difference - noise, 0) + single) / total): relative RMS. 0 where nothing is added.
 * RT-safe.
 */
double ls_linear_estimate(const struct ls_linear_error *error);

/** A rectangle of the pictures, and what is wanted of it. */
struct ls_linear_part {
    uint32_t x, y, width, height;
    float *out;                    /* [height][width][n_out][n_in]; NULL: no M */
    size_t out_stride;             /* floats from row to row; 0 = they follow each other */
    uint32_t step;                 /* 0: nothing is left out; up to LS_LINEAR_MAX_STEP */
    uint32_t first_x, first_y;     /* of the part: the first pixel and row of every step-th */
    struct ls_linear_error *error; /* added to */
};

/**
 * M of a rectangle, which must carry LS_LINEAR_HALO_PX on all sides (less at the picture's border):
 * the result does not depend on the band or the split, to the bit. Allocates 2 n_in + 4 n_out
 * floats per pixel of the band, beside what ls_promote_ratio takes. Errors: LS_ERR_INVALID (sizes,
 * numbers of p not finite and positive, inputs, options), LS_ERR_NOMEM.
 *
 * With @step the error of M without truth: each segment is left out of the fit (its row and its
 * part of the sums), exactly, by a rank-one downdate, and predicted from the rest, at every step-th
 * pixel of every step-th row; pixels with a value that is not finite are left out. Without a
 * segment two must be left, since one is not fitted: LS_ERR_STATE of fewer than 3.
 *
 * ls_linear_estimate of it estimates the relative RMS error of a single light's promoted picture as
 * served: what the rest does not foresee of a segment, beyond its noise, and what M makes of a
 * single light's noise. 0.8 to 1.4 of it on the simulated still life, at 0, 0.2, 0.8 and 3 % of
 * noise, in RGB and of two or three spectra in mono (tests/core/test_still_life.c): a fit without a
 * segment knows less, and a segment's lights, taken as alike, are not. Of segments whose lights are
 * no neighbours (core/segments.h makes none) it tells nothing: all look alike.
 */
LS_MUST_CHECK enum ls_err ls_linear_fit(const struct ls_linear_pictures *pictures,
                                        const struct ls_linear_options *options,
                                        const struct ls_linear_part *part, struct ls_diag *diag);

/** A light that was also photographed alone in spectrum s: n pixels of it. */
struct ls_linear_light {
    size_t n;
    uint32_t n_in, n_out, n_lights;
    double strength;      /* g(i,s) of the light */
    const float *v;       /* [n][n_in], of the light */
    const float *v_total; /* [n][n_in], sum over all lights of g(i,s) v */
    const float *m;       /* [n][n_out][n_in] */
    const float *f;       /* [n][n_out], as photographed */
};

/**
 * Compare M v with the photograph. Adds to *all, and to *highlights the pixels at which this light
 * alone makes more than 16 / n_lights of the full sphere's brightness: four times what a matte
 * surface facing the light can (cosine over its mean, 4 / n_lights). Pixels with a value that is
 * not finite are left out; noise is not filled in. RT-safe.
 */
void ls_linear_check_light(const struct ls_linear_light *light, struct ls_linear_error *all,
                           struct ls_linear_error *highlights);

#endif
