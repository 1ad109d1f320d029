/*
 * shading: one picture of a Lambertian sphere under one light: the light's strength and direction.
 * Layer: core. Threads: any; a view may be shared. Ownership: everything is the caller's.
 *
 * Model. A light is a small Lambertian emitter at its position, aimed at the centre of the stage,
 * r from it. Without noise a merged pixel of colour c reads E = q(c) m with
 *     m = (1/pi) r^2 cos(emission) (n . l) / d^2,
 * l the unit vector and d the distance from the point to the light, cos(emission) = (light's
 * direction) . l; m = 1/pi for a surface at the centre that faces the light. So
 * q(i,s,c) = g(i,s) rho p(s,c) / scale with rho the sphere's reflectance (core/gains.h).
 *
 * Pixels used: n . l > 0.1 (clear of the terminator), n . v > 0.1, the normal more than 12 degrees
 * away from the half vector (clear of a highlight), validity ok or dark, finite. Where that leaves
 * fewer than 200 the limits are 0.03 and 0.05: a crescent. Estimate: weighted least squares through
 * the origin, weights of photon noise 1/(q m + 2 % of its largest), times Tukey's biweight at 6
 * robust sigmas of the residual (Maronna, Martin and Yohai, Robust Statistics, 2006), from the
 * median of E/m on. Standard errors are those of clusters: with psi the weighted residual and u_b
 * the sum of psi m over block b, var q = B/(B-1) sum u_b^2 / (sum psi' m^2)^2 (Huber's sandwich;
 * Liang and Zeger, Biometrika 73, 1986), so that a misfit which neighbouring pixels share counts as
 * what it is.
 *
 * Direction: Gauss-Newton on the same residuals over two tangent coordinates of the light's
 * direction (its distance is kept), the strengths eliminated; the light is at
 * r normalise(nominal + a e1 + b e2), with e1, e2 of ls_tangents.
 */
#ifndef LS_CORE_SHADING_H
#define LS_CORE_SHADING_H

#include "core/error.h"
#include "core/sphere_view.h"

#include <stdbool.h>
#include <stdint.h>

struct ls_shading {
    double strength[3]; /* q(c), full scale per second */
    double sigma[3];    /* its standard error; 0: this colour was not measured */
    uint32_t n[3];      /* pixels used */
    double lit;         /* lit part of the visible disc, [0, 1] */
    double rejected;    /* share of the pixels that the biweight refused */
    double misfit;      /* rms of (E - q m) / (q m) where m is above a third of its largest */
    double tilt[2];     /* d ln q / d(tangent coordinates), per rad: what an error of the
                           light's direction does to its strength */
    bool has_direction; /* the next four were fitted */
    double free_strength[3],
        free_sigma[3]; /* the direction fitted as well; its error, which all n colours share, counts
                          n-fold so that that of their mean is right */
    double offset[2];  /* tangent coordinates */
    double information[3]; /* inverse covariance of offset: aa, ab, bb, per rad^2 */
    /* of the light's tangent coordinates a b, rad, and the sphere's centre x y z, m: what
     * ls_centre_step adds up; information: aa ab ax ay az bb bx by bz xx xy xz yy yz zz */
    double place_score[5], place_information[15];
};

/**
 * @position_m: of the light, as far as known. @e: [height][width] merged mosaic, full scale / s,
 * ungained, without droop (one light); @validity: enum ls_validity per pixel, or NULL.
 * A colour with fewer than 20 usable pixels, or none of whose strength differs from 0 enough to
 * have a robust scale, gets sigma = 0. Errors: LS_ERR_INVALID (position not finite or inside the
 * sphere), LS_ERR_NOMEM. A dark picture is no error: the strengths come out near 0 with their
 * errors, and has_direction is false.
 */
LS_MUST_CHECK enum ls_err ls_shading_fit(const struct ls_sphere_view *view,
                                         const double position_m[3], const float *e,
                                         const uint8_t *validity, struct ls_shading *out,
                                         struct ls_diag *diag);

/** Two unit vectors across a unit direction, one across the other. RT-safe. */
void ls_tangents(const double direction[3], double e1[3], double e2[3]);

/** What ls_shading_settle found. */
struct ls_shading_settled {
    double chi2;       /* of the offsets per coordinate, from their median */
    double spread_deg; /* by how much a coordinate is off beyond its error, likewise */
    bool moved;        /* the fits were changed */
};

/**
 * Do the lights stand where the rig file says? A light 0.3 degrees off changes the strength one
 * camera finds by up to several percent, and no error estimate of a single picture knows. Over the
 * @n fits (all channels and cameras may be together) that see a third of the sphere lit and the
 * direction within 0.2 degrees, @out judges the offsets (all 0 without such a fit). Where chi2 > 2
 * the lights stand elsewhere, and each fit's strength and sigma become the free ones if it sees its
 * light's direction better than the spread; else its sigma grows by what that spread does to it.
 * Otherwise nothing changes, as fixed directions give the smaller errors. Errors: LS_ERR_NOMEM.
 */
LS_MUST_CHECK enum ls_err ls_shading_settle(struct ls_shading *fits, uint32_t n,
                                            struct ls_shading_settled *out, struct ls_diag *diag);

/**
 * Where the sphere really stands, seen from the shading under @n lights that stand within
 * @spread_deg (per coordinate, rms; 0 = exactly) of where they should: the Gauss-Newton step that
 * explains their residuals best, each light turned by what suits it and that spread. A hundred
 * lights half a degree off, believed exact, would move the centre by a tenth of a millimetre, and
 * lights at the side by 0.2 % of their gain. Move the sphere by @step_m, make the view anew and fit
 * again, until a step is within its error: each leaves a tenth or so of the way, and an outline's
 * centre may be 3 mm off along the view. @sigma_m: of each coordinate. LS_ERR_INVALID: fewer than
 * three lights determine it.
 */
LS_MUST_CHECK enum ls_err ls_centre_step(const struct ls_shading *fits, uint32_t n,
                                         double spread_deg, double step_m[3], double sigma_m[3],
                                         struct ls_diag *diag);

/**
 * One light's direction from what @n cameras say: offsets weighted by their information.
 * @direction: unit; @sigma_deg: of either coordinate. LS_ERR_NOT_FOUND: no camera has one.
 */
LS_MUST_CHECK enum ls_err ls_direction_combine(const double nominal[3],
                                               const struct ls_shading *fits, uint32_t n,
                                               double direction[3], double *sigma_deg,
                                               struct ls_diag *diag);

#endif
