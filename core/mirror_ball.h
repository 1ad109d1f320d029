/*
 * mirror_ball: the picture of a mirror ball as a lat-long map of what it reflects.
 * Layer: core. Threads: any (no state). Ownership: all arrays are the caller's.
 *
 * A camera far from a ball sees at distance r from the ball's centre (in radii) the light from
 * theta off the direction towards the camera, r = sin(theta / 2): the normal there halves the angle
 * between the two. So every pixel of the disc stands for the same solid angle, 4 / radius_px^2 sr
 * (r dr = sin(theta) dtheta / 4), and energy is kept by sampling alone.
 *
 * Near the rim the whole surrounding of the direction away from the camera is squeezed into less
 * than a pixel: the blind cone. It is filled: at angle d from its axis, b its half-angle, the
 * radiance is (d / b) x what the rim of the cone shows at that azimuth + (1 - d / b) x the mean of
 * the rim; the rim is sampled at b. Filled texels are marked.
 *
 * What is not corrected: the camera's own image in the middle, the ball's Fresnel reflection
 * towards the rim, and the polarisation a metal adds. A polariser before the camera attenuates
 * polarised parts of the environment differently; whoever used one notes it (core/captured.h).
 */
#ifndef LS_CORE_MIRROR_BALL_H
#define LS_CORE_MIRROR_BALL_H

#include "core/error.h"

#include <stdbool.h>
#include <stdint.h>

/** A map takes 79 radius_px^2 samples, whatever its size: the largest ball takes 3e8 of them. */
enum { LS_MIRROR_BALL_MAX_RADIUS_PX = 2048 };

/** A picture and where the ball is in it. Pixel (x, y) covers [x, x + 1) x [y, y + 1), y down. */
struct ls_mirror_ball {
    const float *rgb; /* [height][width][3], linear radiance times reflectivity, camera-raw */
    uint32_t width, height;
    double centre_px[2], radius_px; /* radius 2 .. MAX; the disc must lie in the picture */
    double to_camera[3];            /* from the ball, stage frame, any length; not straight up */
    double reflectivity[3];         /* (0, 1], of red, green, blue */
    double blind_rad;               /* half-angle of the blind cone, (0, pi / 2] */
};

struct ls_mirror_ball_report {
    double filled_sr; /* of the map, sum of marked texels */
    double peak;      /* largest sample of the ball over its reflectivity: is it clipped? */
};

/** The cone that the last @pixels of the radius show: 2 acos(1 - pixels / radius_px), at least 1
 * degree. RT-safe. */
double ls_mirror_ball_blind(double radius_px, double pixels);

/**
 * map[height][width][3], radiance in camera-raw, in the convention of core/environment.h;
 * @filled[height][width]: 1 where the blind cone was filled in; may be NULL. Each texel is the mean
 * over parts small against texel and pixel of the picture, bilinearly interpolated; the sum over
 * the sphere is that over the disc (times 4 / radius_px^2) within 1 % for a single bright pixel,
 * 1e-3 for ordinary pictures, the blind cone aside. Errors: LS_ERR_INVALID (geometry, reflectivity,
 * sizes; a value of the disc that is not finite, with its place), LS_ERR_LIMIT (a larger ball),
 * LS_ERR_NOMEM.
 */
LS_MUST_CHECK enum ls_err ls_mirror_ball_map(const struct ls_mirror_ball *ball, uint32_t width,
                                             uint32_t height, float *map, uint8_t *filled,
                                             struct ls_mirror_ball_report *report,
                                             struct ls_diag *diag);

#endif
