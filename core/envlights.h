/*
 * envlights: from an environment to one weight per light.
 * Layer: core. Threads: any (no state). Ownership: all arrays are the caller's.
 *
 * The weight of a light is the integral of the environment over the light's cell: the directions
 * nearer to it than to any other light (spherical Voronoi), in radiance x sr. Cells partition the
 * sphere, so holes in the dome go to the nearest lights; coincident lights (within 1e-6 rad)
 * share their cell equally; a tie goes to the lowest light. Every solid angle of a texel is exact
 * (dphi (cos t0 - cos t1)) and every part of it goes to exactly one cell, so the sum of weights is
 * the integral of the map to rounding (1e-12 relative), whatever the map: a constant 1 gives 4 pi,
 * a sun of one texel keeps its energy. Inside a texel a cell's border is followed to 4e-3 rad and
 * cut straight there, corners to 4e-4 rad: better than 1e-4 of a cell of a 346-light dome.
 *
 * Rotation turns the lights, never the map, so it neither resamples nor drifts: @rotation is a
 * row-major matrix R that turns the environment (a direction d of the map is seen at R d), NULL =
 * identity. Directions need not be normalised; 1 <= n <= 16384.
 */
#ifndef LS_CORE_ENVLIGHTS_H
#define LS_CORE_ENVLIGHTS_H

#include "core/environment.h"
#include "core/error.h"

#include <stddef.h>

/** Right-handed rotation about y (up): positive turns the middle of the map to camera-left. */
void ls_rotation_y(double radians, double rotation[9]);

/** Solid angles of the cells, in sr; they sum to 4 pi. omega_sr[n].
 * Errors: LS_ERR_INVALID (n, a direction that is zero or not finite), LS_ERR_NOMEM. */
LS_MUST_CHECK enum ls_err ls_envlights_omega(const float (*directions)[3], size_t n,
                                             double *omega_sr, struct ls_diag *diag);

/** weights[n][3]: the map's RGB radiance integrated over each cell, in the map's own space.
 * Errors also: LS_ERR_INVALID naming the first texel that is not finite. */
LS_MUST_CHECK enum ls_err ls_envlights_map(const float (*directions)[3], size_t n,
                                           const double *rotation, const struct ls_map *map,
                                           double *weights, struct ls_diag *diag);

/**
 * weights[n][lobes->n]: each lobe's radiance (without its spectrum) integrated over each cell, so
 * that a light's spectrum is the sum over lobes of weight x spectrum. Cells are followed in the
 * lobe's own frame, in parts of its energy, so its energy 2 pi a (1 - exp(-2 k)) / k is kept at any
 * sharpness, and a lobe narrower than a cell is cut as finely as a broad one.
 */
LS_MUST_CHECK enum ls_err ls_envlights_lobes(const float (*directions)[3], size_t n,
                                             const double *rotation, const struct ls_lobes *lobes,
                                             double *weights, struct ls_diag *diag);

#endif
