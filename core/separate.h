/*
 * separate: diffuse and specular parts of what a light sends, from two polarised pictures.
 * Layer: core. Threads: any; pure. Ownership: all arrays are the caller's.
 *
 * With a of core/polarisation.h and pictures V, H in which a depolariser reads the same,
 *
 *     S = (V - H) / (a_V - a_H),   D = 2 (a_V H - a_H V) / (a_V - a_H),   D + S = V + H,
 *
 * both signed: noise is never clamped. A light whose |a_V - a_H| is below LS_POLARISATION_LEAST is
 * inseparable; it has S = 0 and D = V + H, so that all of it goes through Eq. 1, as without
 * polarisers. Stored pictures E are ungained, V = k_V E_V, H = k_H E_H, so a light's four
 * coefficients hold its gains: S = s_v E_V + s_h E_H and D = d_v E_V + d_h E_H.
 *
 * All of it is linear: sums over lights may be taken on the mosaic (weights equal in R, G, B).
 */
#ifndef LS_CORE_SEPARATE_H
#define LS_CORE_SEPARATE_H

#include "core/error.h"
#include "core/polarisation.h"

#include <stddef.h>
#include <stdint.h>

/** One light's coefficients. */
struct ls_split {
    float s_v, s_h, d_v, d_h;
};

/**
 * The coefficients of a light. @a may be measured (not summing to 1): it is scaled to a_V + a_H = 1
 * first, since V + H = W belongs to the gains. Errors: LS_ERR_INVALID (a gain that is not finite
 * and positive, an a that is not finite or sums to 0.5 or less).
 */
LS_MUST_CHECK enum ls_err ls_split_make(struct ls_polarisation a, double k_v, double k_h,
                                        struct ls_split *out, struct ls_diag *diag);

/** Did ls_split_make find the light inseparable? RT-safe. */
bool ls_split_inseparable(const struct ls_split *split);

/**
 * Eq. 1's fraction for D (and for the specular part of conductors), from sums over all lights i
 * weighted with g(i,s): @diffuse of D, @specular of S, @conductor of S times its share of conductor
 * (core/separated.h makes all three), and the photographed full sphere @f, in one unit, spans of
 * [n_px][n_channels], demosaiced. The dielectric part of what the sphere shows is known, Eq. 3
 * gives it the colour of the light; what is left of F belongs to the rest of the field:
 *
 *     r = (F - tint sum g (S - wS)) / sum g (D + wS),   tint = p(s,c)/p(w,c).
 *
 * So the promoted field adds up to F exactly, as it does with Eq. 1 alone; without highlights, and
 * where all is metal, r is Eq. 1's F/V. (The paper's F(s)/F(0) lets a dielectric's white highlights
 * into the ratio that its diffuse part is tinted with.) Writes numerator and denominator, to
 * become a stable ratio by ls_promote_ratio. @numerator may be @f, @denominator may be @diffuse.
 * RT-safe.
 */
void ls_separate_remainder(const float *f, const float *diffuse, const float *specular,
                           const float *conductor, const double *tint, size_t n_px,
                           uint32_t n_channels, float *numerator, float *denominator);

#endif
