/*
 * blur: what the optics make of a point: a Gaussian that stands for lens, optical low-pass filter
 * and the photosites' aperture, applied to the radiance at every pixel before the colour filter
 * takes its part of it.
 * Layer: sim. Threads: any. Ownership: the caller's buffers.
 *
 * The kernel is separable and cut off at reach = floor(3 sigma + 1/2) pixels: beyond lies at most
 * 0.3 % of the Gaussian's weight per axis. What is left is scaled to a sum of 1, so energy and
 * constants are kept. A sigma of 0 has reach 0 and changes no bit. Sums run in one order whatever
 * the rectangle: down the column first, from the middle outwards, then along the row.
 */
#ifndef LS_SIM_BLUR_H
#define LS_SIM_BLUR_H

#include "core/pixel.h"

#include <stdint.h>

enum { SIM_BLUR_REACH = 6 };

#define SIM_BLUR_MAX_PX 2.0 /* sigma whose reach that is */

struct sim_blur {
    uint32_t reach;
    float tap[SIM_BLUR_REACH + 1]; /* by distance */
};

/** Radiance in @n planes [height][width], of a rectangle and reach pixels around it. */
struct sim_planes {
    float *v; /* [n][height][width] */
    uint32_t n, width, height;
};

/** @sigma_px: 0..SIM_BLUR_MAX_PX. */
void sim_blur_build(double sigma_px, struct sim_blur *out);

/** Plane @k blurred: out[height - 2 reach][width - 2 reach]. */
void sim_blur_plane(const struct sim_blur *blur, const struct sim_planes *planes, uint32_t k,
                    float *out);

/** The same of each pixel's own colour, the planes being R, G, B; the rectangle's first pixel is
 * (@x, @y) on the sensor. A single plane is blurred as it is. */
void sim_blur_mosaic(const struct sim_blur *blur, const struct sim_planes *planes, enum ls_cfa cfa,
                     uint32_t x, uint32_t y, float *out);

/** Put @width x @height values at (@x, @y) of plane @k; @value: rows of @width. */
void sim_planes_put(const struct sim_planes *planes, uint32_t k, uint32_t x, uint32_t y,
                    uint32_t width, uint32_t height, const float *value);

#endif
