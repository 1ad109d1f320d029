/*
 * chrome_ball: a light's direction and a mirror's reflectivity from the highlight on a metal ball.
 * Layer: core. Threads: any; pure. Ownership: everything is the caller's.
 *
 * The highlight is the brightest connected patch of the ball above half of its peak (on the mean of
 * each 2 x 2 pixels, which holds every colour of a mosaic). Each of its pixels looks, reflected at
 * its normal, in a direction; their mean, weighted by how far they stand above that half, is the
 * direction of the light from the highlight's point. A light at a known distance from the stage's
 * centre is where that ray reaches the distance; its direction is seen from the centre.
 * Accuracy: 1 px of the centroid is 2 / radius_px rad at the middle of the ball, and more towards
 * its rim.
 */
#ifndef LS_CORE_CHROME_BALL_H
#define LS_CORE_CHROME_BALL_H

#include "core/error.h"
#include "core/sphere_view.h"

#include <stdint.h>

struct ls_highlight {
    double x_px, y_px;   /* centroid */
    double direction[3]; /* unit, of the light from the stage's centre */
    double sigma_deg;    /* half a pixel of the centroid */
    uint32_t n;          /* pixels of the patch */
};

/**
 * @picture: [height][width], any unit, linear or not. @distance_m: of the light from the stage's
 * centre; INFINITY for one far away. Errors: LS_ERR_NOT_FOUND with a sentence (dark, no highlight,
 * it touches the ball's rim, or covers more than a quarter of the ball: not a mirror),
 * LS_ERR_INVALID, LS_ERR_NOMEM.
 */
LS_MUST_CHECK enum ls_err ls_chrome_highlight(const struct ls_sphere_view *ball,
                                              const float *picture, double distance_m,
                                              struct ls_highlight *out, struct ls_diag *diag);

/**
 * Reflectivity of the ball per colour under one light of known position. A mirror shows the light's
 * radiance, whose integral over the reflected directions is the irradiance across the ray:
 *     rho(c) = sum over pixels of E dOmega / ((q(c) / rho_grey) r^2 cos(emission) / d^2)
 * with dOmega the solid angle by which the reflected direction moves, across one pixel, against the
 * direction to the light (which stands near, so that it moves as well), q(c) the strength of the
 * same light on the grey sphere of reflectance rho_grey (core/shading.h) and d from the highlight.
 * Pixels that see a reflected direction within 60 degrees of the light are summed, those beyond
 * give the background that is subtracted. @e: merged mosaic; @validity or NULL. @sigma: from the
 * noise of the background; a highlight no wider than the mosaic's cells adds its sampling, so take
 * the middle of many lights. LS_ERR_NOT_FOUND: saturated highlight, light more than 90 degrees from
 * the camera, nothing measured.
 */
LS_MUST_CHECK enum ls_err ls_chrome_reflectivity(const struct ls_sphere_view *ball,
                                                 const double position_m[3], const float *e,
                                                 const uint8_t *validity, const double *strength,
                                                 double grey_reflectance, double reflectivity[3],
                                                 double sigma[3], struct ls_diag *diag);

#endif
