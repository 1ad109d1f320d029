/*
 * promote: what a white field looks like under a spectrum that was photographed only once.
 * Layer: core. Threads: any (no state). Ownership: all arrays are the caller's.
 *
 * LeGendre, Yu and Debevec, Eq. 1, with the denominator that was really photographed:
 *     R(i,p,s,c) = R(i,p,0,c) F(p,s,c) / V(p,s,c)
 *     F = picture of the full sphere of spectrum s / nominal duty x droop factor
 *     V = sum_i g(i,s) R(i,p,0,c),  R(i,p,0,c) = k(i,0) E(i,p,c)
 * F shows lights of unequal strength g(i,s), so V weights the white field with the same strengths.
 * Where lights differ in colour (core/gains.h), k(i,s,c) and g(i,s,c) = 1 / k(i,s,c) are those of
 * each camera colour, and so is V.
 * The paper's own denominator F(0), the photographed white sphere, is had by passing the picture
 * sphere[0] x ls_promote_sphere_factor(0) as V (its weight row is that one factor): right only
 * where all spectra share one spread of strengths. Both are in stored units (the scale of the field
 * cancels) and demosaiced before the division.
 *
 * The stable ratio. Where V >= 10 sigma_V the ratio is F/V exactly. Below, F/V loses its mean
 * (Fieller, Q. J. Pharm. Pharmacol. 17, 1944: the confidence interval of a quotient is bounded
 * only while the denominator is several sigma from zero), so the estimate moves to the ratio of
 * sums over a neighbourhood, sum F / sum V, the classical ratio estimator whose bias falls with
 * the number of samples (Cochran, Sampling Techniques, 1977, ch. 6): windows of 5 x 5 and
 * 17 x 17 pixels, and at last the constant p(s)/p(0) of a spectrally flat surface. Each level h
 * trusts its own quotient by q = smoothstep((V_h/sigma_h - 4) / 6), 0 below 4 sigma, 1 from 10 on:
 *     r_h = q F_h/V_h + (1 - q) r_(h+1)
 * where a quotient that is trusted only in part (q < 1) is limited to +-8 times the larger of
 * |r_(h+1)| and p(s)/p(0). The result is finite for any input: a sample of F or V that is not
 * finite counts as not measured (V = 0). Negative V, negative F are honest noise and need nothing
 * special.
 */
#ifndef LS_CORE_PROMOTE_H
#define LS_CORE_PROMOTE_H

#include "core/error.h"
#include "core/field.h"

#include <stddef.h>
#include <stdint.h>

enum {
    LS_RATIO_HALO_PX = 8, /* pixels around a ratio's own that it may depend on */
    LS_CONTRAST_HALO_PX = 2,
    LS_PROMOTE_HALO_PX =
        LS_RATIO_HALO_PX + LS_CONTRAST_HALO_PX, /* with sigma made of V's contrast */
};

/** What a stored picture of the sphere of spectrum @s is multiplied by to be F: factor / duty. */
double ls_promote_sphere_factor(const struct ls_field *field, uint32_t s);

/**
 * Noise of V from the field's model: sigma[j] = sqrt(read sum r^2 + dark (sum r)^2
 * + shot max(r) max(V, 0)), r the weight row.
 * Demosaicing changes a sample's noise by a factor below 2 and correlates neighbours; neither is
 * modelled. n values.
 */
void ls_promote_sigma(const struct ls_field *field, const float *row, size_t n_row, const float *v,
                      size_t n, float *sigma);

/** The same where V is a sum of both signs over pictures of many lights (core/multiplex.h): V says
 * nothing of the light whose shot noise it has. @light: sum_j r_j^2 m_j over the pictures m_j, V's
 * unit; variance read sum r^2 + dark (sum r)^2 + shot max(light, 0). @sigma may not be @light. */
void ls_promote_sigma_light(const struct ls_field *field, const float *row, size_t n_row,
                            const float *light, size_t n, float *sigma);

/**
 * Add, in quadrature, what demosaicing may have done to V: 5 % of the range of V over
 * the 5 x 5 pixels that the interpolation reads. Beside a highlight an interpolated V can be wrong
 * by a good part of the step, even negative, whatever its noise; F is wrong by another part, and
 * their quotient would be a spark. A sample below a fifth of such a step is no longer trusted
 * alone; on smooth ground (a range of 10 %) the addition is 0.5 % of V. Once per colour; not for
 * mono, which interpolates nothing. @v, @sigma: [height][width][channels].
 */
void ls_promote_add_contrast(const float *v, uint32_t width, uint32_t height, uint32_t channels,
                             float *sigma);

/**
 * The stable ratio of one spectrum over a picture (or a part of it that carries
 * LS_RATIO_HALO_PX of border, whose ratios are then not to be used). @f, @v, @sigma, @ratio:
 * [height][width][channels], all demosaiced; f already in F's unit. @neutral: p(s,c)/p(0,c)
 * [channels]. The result at a pixel depends only on the pixels within LS_RATIO_HALO_PX, in a fixed
 * order: a crop with its border is bit-identical. Errors: LS_ERR_INVALID (neutral not finite and
 * positive, sizes), LS_ERR_NOMEM.
 */
LS_MUST_CHECK enum ls_err ls_promote_ratio(const float *f, const float *v, const float *sigma,
                                           uint32_t width, uint32_t height, uint32_t channels,
                                           const double *neutral, float *ratio,
                                           struct ls_diag *diag);

#endif
