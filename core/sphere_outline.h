/*
 * sphere_outline: find a grey sphere's place from its outline in one picture.
 * Layer: core. Threads: any; pure. Ownership: everything is the caller's.
 *
 * The rays that graze a sphere form a circular cone: with r_j the unit rays of points on the
 * outline, a the unit direction of the centre and alpha the half angle, r_j . a = cos(alpha). So
 * w = a / cos(alpha) solves r_j . w = 1, a linear least-squares problem that is exact in
 * perspective, wherever the sphere stands in the picture; the distance is radius / sin(alpha).
 *
 * Points of the outline: along rays from a point inside, the place where the picture crosses the
 * middle between the level just inside and just outside, on the mean of each 2 x 2 pixels (which
 * holds every colour of a mosaic). A consensus of three points, then re-weighted least squares
 * (Tukey's biweight), so that lights seen beside the sphere, its stand and its shadow are
 * outvoted.
 *
 * Accuracy: about 0.3 px / sqrt(number of points) in the centre on an evenly lit sphere (0.03 px);
 * the distance follows the radius: one part in its pixels. ls_shading refines both.
 */
#ifndef LS_CORE_SPHERE_OUTLINE_H
#define LS_CORE_SPHERE_OUTLINE_H

#include "core/error.h"
#include "core/pinhole.h"

#include <stdint.h>

enum { LS_OUTLINE_RAYS = 256 };

struct ls_sphere {
    double centre_m[3], radius_m;
};

struct ls_outline {
    double x_px, y_px, radius_px; /* middle and mean radius of the outline in the picture */
    double rms_px;                /* of the points used, from the fitted cone */
    uint32_t n_used;              /* of LS_OUTLINE_RAYS */
};

/**
 * @picture: [height][width] of @camera, a mosaic or mono, of the sphere under all lights (any one
 * channel); not finite = not measured. @nominal: the radius, and a guess of the centre that must
 * lie within the sphere's picture. @found: the centre, with the nominal radius.
 * Errors: LS_ERR_NOT_FOUND with a sentence (nothing is lit; no outline; it fits badly; the sphere
 * is cut off by the picture's edge), LS_ERR_INVALID (sizes), LS_ERR_NOMEM.
 */
LS_MUST_CHECK enum ls_err ls_sphere_locate(const struct ls_pinhole *camera, const float *picture,
                                           const struct ls_sphere *nominal, struct ls_sphere *found,
                                           struct ls_outline *outline, struct ls_diag *diag);

/** Outline of a sphere whose place is known. LS_ERR_INVALID: the eye is inside or it lies behind.
 */
LS_MUST_CHECK enum ls_err ls_sphere_outline(const struct ls_pinhole *camera,
                                            const struct ls_sphere *sphere,
                                            struct ls_outline *outline, struct ls_diag *diag);

#endif
