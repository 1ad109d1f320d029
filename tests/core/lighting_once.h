/*
 * lighting_once: what a chart reads of a light, written again as one integral, and a solve for a
 * single light.
 * Layer: tests. Threads: any. Ownership: arrays are the caller's.
 */
#ifndef LS_TESTS_CORE_LIGHTING_ONCE_H
#define LS_TESTS_CORE_LIGHTING_ONCE_H

#include "core/lighting.h"
#include "core/spectrum.h"

/** targets[n_patches][n_channels] of constant radiance @light. */
static inline void chart_reads(const struct ls_spectrum *reflectance, size_t n_patches,
                               const struct ls_spectrum *sensitivity, size_t n_channels,
                               const struct ls_spectrum *light, double *targets)
{
    for (size_t k = 0; k < n_patches * n_channels; k++)
        targets[k] =
            ls_spectrum_dot3(light, &reflectance[k / n_channels], &sensitivity[k % n_channels]);
}

static inline enum ls_err lighting_once(const struct ls_lighting *lighting, const double *targets,
                                        size_t n_targets, double *alpha,
                                        struct ls_lighting_solution *out)
{
    struct ls_lighting_solver *solver;
    enum ls_err err = ls_lighting_solver_create(lighting, n_targets, &solver, NULL);
    if (!err)
        err = ls_lighting_solver_run(solver, targets, alpha, out, NULL);
    ls_lighting_solver_destroy(solver);
    return err;
}

#endif
