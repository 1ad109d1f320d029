/*
 * solve: small least-squares problems, and the strengths of a stage's LED spectra that reproduce
 * a target light on a colour chart.
 * Layer: core. Threads: any (no state). Ownership: all arrays are the caller's.
 *
 * Sources: LeGendre, Yu and Debevec, Efficient Multispectral Reflectance Function Capture for
 * Image-Based Relighting, Eq. 4 (camera-raw), Eq. 5 (after the 3x3 matrix M), Eq. 6 (one solution
 * per output channel); Lawson and Hanson, Solving Least Squares Problems, 1974, ch. 23.
 */
#ifndef LS_CORE_SOLVE_H
#define LS_CORE_SOLVE_H

#include "core/error.h"
#include "core/spectrum.h"

#include <stddef.h>

enum { LS_SOLVE_MAX_COLS = 64, LS_SOLVE_MAX_ROWS = 65536 };

/** min over x of sum_r w_r^2 (A x - b)_r^2 + t mean_j(diag(A' W^2 A)) ||x||^2. */
struct ls_system {
    size_t rows, cols;        /* 1 .. LS_SOLVE_MAX_ROWS, 1 .. LS_SOLVE_MAX_COLS */
    const double *a;          /* [rows][cols] */
    const double *b;          /* [rows] */
    const double *row_weight; /* [rows], >= 0; NULL = 1 */
    double tikhonov;          /* t >= 0, relative to the mean diagonal */
};

struct ls_solution {
    double residual;     /* ||W (A x - b)||, without the Tikhonov rows */
    double relative;     /* residual / ||W b||; 0 if b = 0 */
    unsigned rank;       /* of W A, singular values above 1e-12 of the largest */
    double condition;    /* largest / smallest singular value of W A; INFINITY if rank < cols */
    double kkt;          /* NNLS: largest violation of the KKT conditions, relative; else 0 */
    unsigned iterations; /* NNLS */
};

/** Least squares, minimum norm when rank-deficient (LAPACK dgelsd). x[cols]. @out may be NULL.
 * Errors: LS_ERR_INVALID (sizes, a value that is not finite), LS_ERR_NOMEM, LS_ERR_BUG. */
LS_MUST_CHECK enum ls_err ls_solve_least_squares(const struct ls_system *system, double *x,
                                                 struct ls_solution *out, struct ls_diag *diag);

/**
 * Non-negative least squares: the exact active-set method of Lawson and Hanson, on columns scaled
 * to unit norm, entering the column of steepest descent, ties (1e-12) to the lowest index. A
 * column that depends on those already in the set does not enter, so duplicated and rank-1
 * systems end too. At exit x >= 0 and the KKT conditions hold within 1e-10 of ||W b||:
 * gradient >= 0 everywhere, = 0 where x > 0.
 */
LS_MUST_CHECK enum ls_err ls_solve_nnls(const struct ls_system *system, double *x,
                                        struct ls_solution *out, struct ls_diag *diag);

enum ls_solve_mode {
    LS_SOLVE_SHARED,     /* one strength per spectrum, equal in every output channel (Eq. 4, 5) */
    LS_SOLVE_PER_TARGET, /* one per spectrum and output channel (Eq. 6) */
};

enum ls_solve_method { LS_SOLVE_NNLS, LS_SOLVE_LEAST_SQUARES };

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

/** The defaults: RGB = shared NNLS; mono = per-target least squares with Tikhonov 1e-3. Sets mode,
 * method and tikhonov of @lighting from its n_channels. */
void ls_lighting_defaults(struct ls_lighting *lighting);

/** The space ls_lighting_solve works in for this chart: after M if it has one and three channels.
 */
enum ls_solve_space ls_lighting_space(const struct ls_lighting *lighting);

/**
 * Strengths that reproduce @targets on the chart.
 * Shared: @targets is P [patch][channel] in camera-raw (M is applied to it and to L here);
 * alpha[n_spectra].
 * Per-target: @targets is [patch][n_targets] in the output space (camera-raw or after M, as
 * ls_lighting_space says; mono: the output picture's channels), alpha[n_targets][n_spectra].
 * @n_targets is ignored when shared. Linear in the targets up to the active set: targets in
 * radiance give strengths per radiance, targets in radiance x sr give weights in sr.
 * @out: worst residual, rank, condition. May be NULL.
 */
LS_MUST_CHECK enum ls_err ls_lighting_solve(const struct ls_lighting *lighting,
                                            const double *targets, size_t n_targets, double *alpha,
                                            struct ls_solution *out, struct ls_diag *diag);

/**
 * P_pc = integral of light x reflectance_p x sensitivity_c: what the camera reads of a chart of
 * Lambertian patches under constant radiance @light. @sensitivities are in units such that a
 * 100 % Lambertian reads ls_spectrum_dot(light, sensitivity). targets[n_patches][n_channels].
 */
void ls_lighting_targets(const struct ls_spectrum *reflectances, size_t n_patches,
                         const struct ls_spectrum *sensitivities, size_t n_channels,
                         const struct ls_spectrum *light, double *targets);

#endif
