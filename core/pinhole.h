/*
 * pinhole: a camera as the rig file describes it: where it stands, where it looks, and what its
 * pixels see.
 * Layer: core. Threads: any; pure. Ownership: values.
 *
 * Square pixels, no distortion, the optical axis in the middle of the picture. Pixel coordinates:
 * (0, 0) is the top left corner of the picture, the middle of its first pixel (0.5, 0.5); y grows
 * downwards. The camera stands upright: its up is as near to the stage's y as its axis allows.
 */
#ifndef LS_CORE_PINHOLE_H
#define LS_CORE_PINHOLE_H

#include "core/error.h"

#include <stdint.h>

struct ls_pinhole {
    double eye_m[3], right[3], up[3], forward[3]; /* stage frame; the last three unit, orthogonal */
    double pitch;                                 /* side of a pixel over the focal length */
    uint32_t width, height;                       /* px */
};

/** @focal_length_mm and @sensor_width_mm as in the rig file. LS_ERR_INVALID with a sentence: not
 * finite, position and look-at coincide, a size not positive. */
LS_MUST_CHECK enum ls_err ls_pinhole_aim(const double position_m[3], const double look_at_m[3],
                                         double focal_length_mm, double sensor_width_mm,
                                         uint32_t width, uint32_t height, struct ls_pinhole *out,
                                         struct ls_diag *diag);

/** Unit direction from the eye through a point of the picture, px. RT-safe. */
void ls_pinhole_ray(const struct ls_pinhole *camera, double x, double y, double d[3]);

/** Where a point of the stage lands, px; NaN for one behind the camera. RT-safe. */
void ls_pinhole_project(const struct ls_pinhole *camera, const double point_m[3], double *x,
                        double *y);

#endif
