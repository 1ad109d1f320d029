/*
 * mono blend: promotion of a mono camera with one spectrum per light, by ratios of segments.
 * Layer: core. Threads: any (no state). Ownership: all arrays are the caller's.
 *
 * One value per light leaves no matrix to fit (core/linear.h), but its ratio may depend on the
 * direction of the light:
 *     R(i,p,s) = r(i,p) R(i,p,0),  r(i,p) = sum_g phi[i][g] r_g(p)
 * with phi >= 0 a partition of unity over segments (sum over g = 1 for every light), smooth in the
 * light's direction, and r_g from the picture F_g of segment g of spectrum s:
 *     r_g = n(p) (stable ratio of F_g and V_g) + m(p),  V_g = sum of g(i,s) R(i,p,0) over the
 * segment. n(p) makes the full sphere exact, sum_g r_g U_g = sum_g F_g, where U_g = sum over *all*
 * lights of phi[i][g] g(i,s) R(i,p,0). It lies in [1/2, 2]; what is then still missing from the sum
 * is m(p) sum_g U_g: where a surface reflects next to nothing of s, both sums are noise around 0,
 * and their quotient would be a spark. All fade into the stable ratio of the full sphere where the
 * sum is below 10 sigma (n to 1, m to 0, r_g to the sphere's), as core/promote.h does.
 * An estimator of its own name: it is not Eq. 1 and not linear in what was photographed per light.
 * Relighting costs one sum per segment: out = sum_g r_g sum_i w_i phi[i][g] R(i,p,0).
 */
#ifndef LS_CORE_MONO_BLEND_H
#define LS_CORE_MONO_BLEND_H

#include "core/error.h"
#include "core/linear.h"

#include <stdint.h>

/**
 * phi[n_lights][n_segments] of a partition (core/segments.h): a Gaussian of the angle to each
 * segment's centre, normalised. Infinitely smooth; a light at the border of two segments takes half
 * of either. One segment: all 1. Errors: as ls_segments_centres, LS_ERR_NOMEM.
 */
LS_MUST_CHECK enum ls_err ls_mono_blend_weights(const float (*directions)[3], uint32_t n_lights,
                                                const uint32_t *segment, uint32_t n_segments,
                                                double *phi, struct ls_diag *diag);

/**
 * What the blend would make of a segment's lights without it, others[n_segments][n_segments]: row g
 * are the shares of the other segments in its lights, which add up to 1. At least two segments.
 */
void ls_mono_blend_others(const double *phi, uint32_t n_lights, const uint32_t *segment,
                          uint32_t n_segments, double *others);

/** Pictures of one spectrum over a band of rows, each [height][width]. */
struct ls_mono_blend_pictures {
    uint32_t width, height, n_segments, n_lights;
    const float *const *v;                 /* [n_segments], V_g */
    const float *const *u;                 /* [n_segments], U_g */
    const float *const *f;                 /* [n_segments], F_g */
    const struct ls_linear_noise *v_noise; /* [n_segments] */
    const struct ls_linear_noise *f_noise; /* [n_segments] */
    struct ls_linear_noise total_noise;    /* of the sum of all v */
    double neutral;                        /* p(s) / p(0) */
    const double *others;                  /* for an error */
};

/**
 * r_g of a rectangle as of core/linear.h, part->out [height][width][n_segments]. A segment too dark
 * to have a ratio takes that of the full sphere. One segment returns the stable ratio of
 * core/promote.h, to the bit. Halo LS_LINEAR_HALO_PX, bit-identical for any split, finite for any
 * input. Errors: those of ls_linear_fit.
 *
 * With part->step, each segment is predicted by the ratios of the others, as `others` mixes them
 * (which n and m have made fit the sum of all). ls_linear_estimate of that is 1.3 to 1.6 times the
 * relative RMS error of a single light's promoted picture as served on the simulated still life: a
 * light is on average half as far from the middle of its own segment as from those of the others.
 */
LS_MUST_CHECK enum ls_err ls_mono_blend_fit(const struct ls_mono_blend_pictures *pictures,
                                            const struct ls_linear_part *part,
                                            struct ls_diag *diag);

#endif
