/*
 * light_weights: from an environment and a calibrated stage to the weight of every LED spectrum of
 * every light: the cells' light (envlights), its spectrum, and the strengths that reproduce it on
 * the chart (solve).
 * Layer: core. Threads: any (no state). Ownership: everything is the caller's.
 *
 * A light's spectrum is that of the environment integrated over its cell. Of an RGB map only three
 * numbers are known of it: it becomes the smoothest non-negative spectrum that has them, for
 * rec709-linear maps through the CIE 1931 observer, for camera-raw maps through the camera's
 * sensitivities. Radiance 1 of a rec709-linear map is the D65 light that the camera's green (mono:
 * its channel) reads as 1.
 */
#ifndef LS_CORE_LIGHT_WEIGHTS_H
#define LS_CORE_LIGHT_WEIGHTS_H

#include "core/envlights.h"
#include "core/error.h"
#include "core/solve.h"
#include "core/spectrum.h"

#include <stddef.h>

/** An environment over a stage. Exactly one of map and lobes is set. */
struct ls_environment {
    const struct ls_map *map;
    const struct ls_lobes *lobes;
    const double *rotation;       /* row-major 3x3, see envlights; NULL = none */
    const float (*directions)[3]; /* [n_lights] */
    size_t n_lights;
};

/** The camera and the chart it saw under every spectrum. */
struct ls_stage_chart {
    struct ls_lighting lighting;             /* chart L, M, mode, method */
    const struct ls_spectrum *reflectances;  /* [lighting.n_patches] */
    const struct ls_spectrum *sensitivities; /* [lighting.n_channels] */
};

struct ls_light_weights_report {
    double worst_relative; /* largest residual / target of a lit light's solve */
    size_t unreachable;    /* lights whose RGB no spectrum has; the nearest was taken */
    unsigned rank;         /* least of any solve */
    double condition;      /* largest */
    enum ls_solve_space space;
};

/** spectra[n_lights]: spectral radiance x sr of every light's cell. @report may be NULL (only
 * unreachable is set). @sensitivities as in ls_stage_chart; unused for lobes. */
LS_MUST_CHECK enum ls_err ls_light_spectra(const struct ls_environment *environment,
                                           const struct ls_spectrum *sensitivities,
                                           size_t n_channels, struct ls_spectrum *spectra,
                                           struct ls_light_weights_report *report,
                                           struct ls_diag *diag);

/**
 * Shared: weights[n_lights][n_spectra]. Per-target: weights[n_lights][3][n_spectra], for the
 * output channels R, G, B: linear Rec. 709 through the observer for a mono camera, the camera's
 * own (after M where set) for an RGB one. In radiance x sr, ready for ls_relight_row. A light of
 * no radiance gets exactly 0. Errors: those of envlights, smoothest and solve.
 */
LS_MUST_CHECK enum ls_err ls_light_weights(const struct ls_environment *environment,
                                           const struct ls_stage_chart *chart, double *weights,
                                           struct ls_light_weights_report *report,
                                           struct ls_diag *diag);

/**
 * The tristimulus baseline: weights[n_lights][3], the environment in camera-raw, for
 * ls_relight_tristimulus_row. A camera-raw map is used as it is. RGB cameras only.
 */
LS_MUST_CHECK enum ls_err ls_light_weights_tristimulus(const struct ls_environment *environment,
                                                       const struct ls_spectrum sensitivities[3],
                                                       double *weights,
                                                       struct ls_light_weights_report *report,
                                                       struct ls_diag *diag);

#endif
