/*
 * cell_lighting: from what an environment puts into each light's cell to the strengths of the
 * light's LED spectra: cell -> spectrum -> what a chart reads of it -> strengths.
 * Layer: core. Threads: any (no state). Ownership: all arrays are the caller's.
 *
 * An RGB does not determine six strengths: it is taken to be the smoothest non-negative spectrum
 * that reproduces it (core/spectrum.h). A spectral lobe brings its own. Strengths come in the unit
 * of the cells: radiance x sr in, weights in sr out (core/lighting.h).
 *
 * Accuracy: of lobes, every strength is within 1e-11 of what its cell gives alone, by integrals of
 * the mixed light (charts of a condition below 1e3); an LED's own light gives 1 of that LED. Of
 * maps, strengths follow a cell's brightness within 1e-7, as the smoothest spectrum ends its rounds
 * at 1e-10 of the RGB. Finite for cells of 1e-30 to 1e30, negative ones, and charts of rank 0
 * and 1.
 */
#ifndef LS_CORE_CELL_LIGHTING_H
#define LS_CORE_CELL_LIGHTING_H

#include "core/environment.h"
#include "core/lighting.h"

/** A chart as data: what it reflects, and what reads it. */
struct ls_spectral_chart {
    const struct ls_lighting_solver *solver; /* of the same patches */
    const struct ls_spectrum *reflectance;   /* [n_patches] */
    size_t n_patches;
    const struct ls_spectrum *reader; /* [n_readers]: the camera's sensitivities; for a mono camera
                                         the functionals of the output channels */
    size_t n_readers;                 /* as many as the solver has targets */
};

struct ls_cell_lighting {
    double energy;   /* sum over cells of the RGB's norm; maps only */
    double missed;   /* of it, what no non-negative spectrum reaches */
    double residual; /* root of summed squared residuals over that of summed squared targets */
    struct ls_lighting_solution
        worst; /* of one cell; cells below 1e-6 of the brightest not asked */
};

/**
 * alpha[n][outputs] for RGB cells[n][3] read with @functionals (core/spectrum.h). Cells that are 0
 * get 0. @out may be NULL. Errors: those of ls_spectrum_smoothest and ls_lighting_solver_run.
 */
LS_MUST_CHECK enum ls_err ls_cell_lighting_map(const struct ls_spectral_chart *chart,
                                               const struct ls_spectrum functionals[3],
                                               const double *cells, size_t n, double *alpha,
                                               struct ls_cell_lighting *out, struct ls_diag *diag);

/** The same for cells[n][lobes->n] of lobes (ls_envlights_lobes). */
LS_MUST_CHECK enum ls_err ls_cell_lighting_lobes(const struct ls_spectral_chart *chart,
                                                 const struct ls_lobes *lobes, const double *cells,
                                                 size_t n, double *alpha,
                                                 struct ls_cell_lighting *out,
                                                 struct ls_diag *diag);

/** The same for cells whose chart was photographed: targets[n][n_patches][n_readers]. */
LS_MUST_CHECK enum ls_err ls_cell_lighting_targets(const struct ls_lighting_solver *solver,
                                                   const double *targets, size_t values_per_cell,
                                                   size_t n, double *alpha,
                                                   struct ls_cell_lighting *out,
                                                   struct ls_diag *diag);

#endif
