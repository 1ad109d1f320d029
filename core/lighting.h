/*
 * lighting: the strengths of a stage's LED spectra that reproduce a target light on a colour
 * chart.
 * Layer: core. Threads: any; a solver is read-only once made. Ownership: a solver copies what it
 * needs; arrays are the caller's.
 *
 * Source: LeGendre, Yu and Debevec, Efficient Multispectral Reflectance Function Capture for
 * Image-Based Relighting, Eq. 4 (camera-raw), Eq. 5 (after the 3x3 matrix M), Eq. 6 (one solution
 * per output channel).
 */
#ifndef LS_CORE_LIGHTING_H
#define LS_CORE_LIGHTING_H

#include "core/error.h"
#include "core/solve.h"

#include <stddef.h>

enum ls_solve_mode {
    LS_SOLVE_SHARED,     /* one strength per spectrum, equal in every output channel (Eq. 4, 5) */
    LS_SOLVE_PER_TARGET, /* one per spectrum and output channel (Eq. 6) */
};

/** The space the strengths were fitted in. Per-target strengths after M need M applied to the
 * field before weighting. */
enum ls_solve_space { LS_SOLVE_CAMERA_RAW, LS_SOLVE_AFTER_M };

/** A chart as seen under each spectrum of the stage. */
struct ls_lighting {
    size_t n_patches, n_channels, n_spectra; /* channels: 3, or 1 (mono) */
    const double *chart;      /* [patch][channel][spectrum]: L, under the cell-weighted virtual
                                 sphere sum_i Omega_i R_i, so a strength is per unit radiance */
    const double *m;          /* row-major 3x3, camera-raw to output; NULL = unset */
    const double *row_weight; /* [patch][channel]; NULL = 1 */
    enum ls_solve_mode mode;
    enum ls_solve_method method;
    double tikhonov;
};

/** The defaults: RGB = shared NNLS; mono = per-target least squares with Tikhonov 1e-3 (M makes
 * negative targets, which non-negative strengths of a mono chart cannot follow). Sets mode, method
 * and tikhonov of @lighting from its n_channels.
 *
 * Shared NNLS is not damped: its signs bound the strengths already, and 72 readings of six measured
 * spectra after M have condition 116, per target 333 to 796. Under the paper's two lights damping
 * by 1e-3 would leave 2.33 % of the chart's reading in place of 2.29. A rig whose spectra lie
 * closer together (`relight
 * --json` tells the condition) may want some: `--tikhonov`. */
void ls_lighting_defaults(struct ls_lighting *lighting);

/** The space a solve of this chart works in: after M if it has one and three channels. */
enum ls_solve_space ls_lighting_space(const struct ls_lighting *lighting);

struct ls_lighting_solution {
    enum ls_solve_space space;
    enum ls_solve_mode mode;
    struct ls_solution worst; /* of the solves it took: the one of the largest relative residual */
};

struct ls_lighting_solver;

/**
 * Factor a chart for any number of lights. (transfer full).
 * @n_targets: output channels of a per-target solve: 3 for a three-channel chart, 1..3 for mono;
 * ignored when shared. Errors: LS_ERR_INVALID, LS_ERR_NOMEM, LS_ERR_BUG.
 */
LS_MUST_CHECK enum ls_err ls_lighting_solver_create(const struct ls_lighting *lighting,
                                                    size_t n_targets,
                                                    struct ls_lighting_solver **out,
                                                    struct ls_diag *diag);

/** NULL is allowed. */
void ls_lighting_solver_destroy(struct ls_lighting_solver *solver);

/** Strengths of one solution: n_spectra, times n_targets if per-target. RT-safe. */
size_t ls_lighting_solver_outputs(const struct ls_lighting_solver *solver);

/**
 * Strengths that reproduce @targets on the chart.
 * Shared: @targets is P [patch][channel] in camera-raw (M is applied to it and to L here);
 * alpha[n_spectra].
 * Per-target: @targets is [patch][n_targets]; three channels: P in camera-raw too (M is applied
 * here); mono: in the space of the output picture. alpha[n_targets][n_spectra].
 * Linear in the targets up to the active set: targets in radiance give strengths per radiance,
 * targets in radiance x sr give weights in sr. @out may be NULL. Reentrant.
 */
LS_MUST_CHECK enum ls_err ls_lighting_solver_run(const struct ls_lighting_solver *solver,
                                                 const double *targets, double *alpha,
                                                 struct ls_lighting_solution *out,
                                                 struct ls_diag *diag);

#endif
