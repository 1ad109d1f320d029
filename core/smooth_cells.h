/*
 * smooth_cells: from an environment to one weight per light, with cells that overlap smoothly.
 * Layer: core. Threads: any (no state). Ownership: all arrays are the caller's.
 *
 * As core/envlights.h, but a direction is shared by the three lights around it in proportion to its
 * barycentric coordinates (d = a A + b B + c C, a + b + c scaled to 1) in the spherical Delaunay
 * triangulation, so a sun that moves fades from light to light. The shares of a direction are >= 0
 * and add up to 1 to rounding, so the sum of weights is the integral of the map (1e-12 relative)
 * whatever the map; a constant 1 gives 4 pi, a sun of one texel keeps its energy.
 *
 * Lights within 1e-4 rad share equally. Where the dome has a hole (no light within 35 degrees, or
 * within twice the mean spacing, of one of the six axes), a point there is triangulated too and its
 * share is given to the lights nearest to it; so any lights do, one included.
 *
 * A map is sampled at the centres of equal-angle parts of its texels, at most 0.5 degrees each; a
 * weight is within 1e-3 of a light's own of the exact integral. Rotation turns the lights, never
 * the map. n and directions as there, plus LS_ERR_BUG if no triangulation was found.
 */
#ifndef LS_CORE_SMOOTH_CELLS_H
#define LS_CORE_SMOOTH_CELLS_H

#include "core/environment.h"
#include "core/error.h"

#include <stddef.h>

/** weights[n][3]. */
LS_MUST_CHECK enum ls_err ls_smooth_cells_map(const float (*directions)[3], size_t n,
                                              const double *rotation, const struct ls_map *map,
                                              double *weights, struct ls_diag *diag);

/** weights[n][lobes->n]. */
LS_MUST_CHECK enum ls_err ls_smooth_cells_lobes(const float (*directions)[3], size_t n,
                                                const double *rotation,
                                                const struct ls_lobes *lobes, double *weights,
                                                struct ls_diag *diag);

#endif
