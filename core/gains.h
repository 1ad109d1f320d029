/*
 * gains: the lights' brightness gains of one spectrum from the strengths that shading found.
 * Layer: core. Threads: any; pure. Ownership: every array is the caller's.
 *
 * Model: ln q(i,j) = ln g(i) + ln level(j), j = camera x colour: one level per camera and colour,
 * found from the lights that cameras share; weighted least squares, exact (the lights eliminated,
 * then a system of at most 48 unknowns). Weight of a measurement: 1/(relative error)^2, which grows
 * with the lit visible area, times 0 where the lit part is below 10 %, rising to 1 at 20 %.
 * Measurements of SNR q/sigma >= 100 count; a light that has none of them (or none with enough lit
 * area) takes what it has, its level known by then. Errors are scaled by sqrt(chi^2/dof) where
 * cameras or colours disagree by more than their errors say. A light known no better than a tenth
 * of the lights' spread (a thin crescent) leans on the others: the mean of its own ln g and theirs,
 * weighted by 1/error^2 and 1/spread^2.
 * Normalisation: mean of g over the lights = 1 (ls_field_normalise_gains); k = 1/g. The error of
 * that mean, which the lights nobody saw dominate, is common to all and part of every sigma_k; so
 * is 0.01 %, by which merged pictures may be off at the edges of the exposures' ranges.
 *
 * Lights that differ in colour get factors on k for each camera colour: what is left of a colour's
 * measurements once ln g and the level are gone, averaged over cameras. A factor is 1 unless the
 * colour's own error is below 0.5 % (a worse one would do harm), and all of a light are 1 unless
 * one of them is off by more than 4.5 errors of what is left: then k, the mean of its colours, is
 * off in all of them. Of the 8304 factors of 346 lights, 8 channels and 3 colours that are really
 * 1, 3 errors would let 22 through, and one is enough to make a channel's every picture cost three
 * sums; 4.5 let one through on one rig of eighteen. The errors are scaled by how much the middle
 * measurement disagrees, which lights that differ in colour, while they are few, leave alone. What
 * is found is taken out before it is judged how much the others disagree. A light with a flag has
 * none. Of a simulated rig of three cameras, a quarter of whose lights is 2 % off in one colour,
 * k and factor together come back within 0.18 % in every colour, k alone within 1.6 %.
 *
 * Accuracy, of lights without a flag on 25 simulated rigs (ls_grey_measure, spheres of 37 px
 * radius) whose lights spread by 5 and 10 % and stand up to 0.9 degrees beside their place: k
 * within 0.48 % (one camera), 0.27 % (two), 0.17 % (three), 0.14 % (four); 0.5 % is promised. With
 * one camera most of it is the error of the mean of g, common to all lights; the rest lies within
 * its sigma for 66 % of them.
 *
 * From the levels, with rho the reflectance of the grey sphere and "green" the reference colour
 * (mono: the only one): scale = rho / level(W, green), p(s,c) = level(s,c) / level(W, green).
 */
#ifndef LS_CORE_GAINS_H
#define LS_CORE_GAINS_H

#include "core/error.h"

#include <stdbool.h>
#include <stdint.h>

#define LS_GAINS_MIN_SNR 100.0
#define LS_GAINS_MIN_LIT 0.10
#define LS_GAINS_COLOUR_SIGMA 0.005

struct ls_gains_input {
    uint32_t n_lights, n_cameras, n_colours; /* cameras <= 16; colours 3 or 1 */
    const double *strength, *sigma; /* [(light * n_cameras + camera) * n_colours + colour]; sigma
                                       <= 0 or not finite: not measured */
    const double *lit;              /* [light * n_cameras + camera] */
    const uint8_t *one_sided;       /* [light], see ls_gains_one_sided; NULL = none */
};

struct ls_gains {
    double *g, *k, *sigma_k; /* [light], caller's */
    double *colour;      /* [light * n_colours + colour] factors on k, or NULL: not looked for */
    uint8_t *flags;      /* [light], enum ls_light_flag (core/calibration.h) */
    double level[16][3]; /* strength of a light of g = 1, per camera and colour; 0 unknown */
    double level_sigma[16][3]; /* relative */
    double sigma_mean; /* relative error of the mean of g: the part of every sigma_k / k that is
                          common to all lights */
    double chi2;       /* per degree of freedom; 0 without any */
    uint32_t n_snr;    /* lights with a measurement of SNR >= 100 */
};

/**
 * Dead lights (below 2 % of the middle one by 3 errors, where that is known to a tenth) and those
 * nobody measured get g = k = 1 and their flag. sigma_k of a one-sided light is at least 2 %: a
 * real sphere is no Lambertian at grazing angles. Errors: LS_ERR_INVALID with a sentence: nothing
 * was measured well enough (dark, no sphere), or cameras share no light; LS_ERR_LIMIT,
 * LS_ERR_NOMEM. Never NaN, never a k outside [1e-6, 1e6].
 */
LS_MUST_CHECK enum ls_err ls_gains_solve(const struct ls_gains_input *input, struct ls_gains *out,
                                         struct ls_diag *diag);

/** Does @direction lie more than 120 degrees from every camera, seen from the centre? RT-safe. */
bool ls_gains_one_sided(const double direction[3], const double (*camera_m)[3], uint32_t n_cameras);

/**
 * Behind a polariser: scale g (and k, sigma_k, level) so that a depolariser reads half of W in the
 * reference colour: V + H = W. @w: the solved white channel. Averages over cameras. @n_lights of
 * both. LS_ERR_INVALID: no camera knows both levels.
 */
LS_MUST_CHECK enum ls_err ls_gains_scale_polarised(struct ls_gains *gains, const struct ls_gains *w,
                                                   uint32_t n_lights, uint32_t n_cameras,
                                                   uint32_t n_colours, struct ls_diag *diag);

/**
 * Closure of one camera: scale, and p(s,c) of a spectrally flat 100 % Lambertian for each of
 * @n_channels solved channels, white first. @reflectance: of the sphere per channel and colour
 * [channel * n_colours + colour] (0.33 everywhere for the grey sphere). @p: [channel][3].
 * LS_ERR_INVALID: white has no level in this camera, a reflectance is not in (0, 1].
 */
LS_MUST_CHECK enum ls_err ls_gains_closure(const struct ls_gains *const *channels,
                                           uint32_t n_channels, uint32_t camera, uint32_t n_colours,
                                           const double *reflectance, double *scale, float (*p)[3],
                                           struct ls_diag *diag);

#endif
