/*
 * sweep: the noise-free mosaics of one light after another over a region, for whoever compares a
 * whole field with the truth. What does not depend on the light is prepared once: the bounced light
 * of the whole scene, and what the region's pixels see.
 * Layer: sim. Threads: a sweep is read only once created; a region belongs to one thread.
 * Ownership: the scene outlives the sweep, the sweep its regions.
 *
 * Values are those of sim_truth_field at each pixel's own colour, and of sim_truth_specular, bit
 * for bit.
 */
#ifndef LS_SIM_SWEEP_H
#define LS_SIM_SWEEP_H

#include "core/error.h"
#include "sim/scene.h"
#include "sim/truth.h"

#include <stdint.h>

struct sim_sweep;
struct sim_sweep_region;

/** For @n channels of one camera. Errors: LS_ERR_INVALID (camera, channel), LS_ERR_UNSUPPORTED
 * (only traced scenes can be swept), LS_ERR_NOMEM. (transfer full). */
LS_MUST_CHECK enum ls_err sim_sweep_create(const struct sim_scene *scene, uint32_t camera,
                                           const uint32_t *channels, uint32_t n,
                                           struct sim_sweep **out, struct ls_diag *diag);
void sim_sweep_destroy(struct sim_sweep *sweep);

/** Prepare a region, about 150 bytes and 12 (n + 1) per pixel,
 * 36 (n + 1) behind a colour filter and a blur. Errors: LS_ERR_INVALID (not inside
 * the sensor), LS_ERR_NOMEM. (transfer full). */
LS_MUST_CHECK enum ls_err sim_sweep_open(const struct sim_sweep *sweep,
                                         const struct sim_region *region,
                                         struct sim_sweep_region **out, struct ls_diag *diag);
void sim_sweep_close(struct sim_sweep_region *region);

/** R of @light < n_lights: mosaic[channel][height][width], and the share of specular light in white
 * (the scene's first channel), green or mono, specular[height][width]. */
void sim_sweep_light(struct sim_sweep_region *region, uint32_t light, float *mosaic,
                     float *specular);

#endif
