/*
 * segments: the lights of a dome in groups of neighbours, each photographed as one picture.
 * Layer: core. Threads: any (no state). Ownership: all arrays are the caller's.
 *
 * The partition depends on the directions, their order and n_segments alone: whoever plans a take
 * and whoever fits its pictures may each compute it, and a take records it. Sizes differ by one
 * light at most, so that segments draw alike currents and are exposed alike. It starts from
 * recursive halving along the principal axis and exchanges pairs of lights between groups as long
 * as that lowers the sum of squared distances to the groups' centres (k-means with fixed sizes).
 * Holes in the dome and coincident lights are nothing special.
 */
#ifndef LS_CORE_SEGMENTS_H
#define LS_CORE_SEGMENTS_H

#include "core/error.h"

#include <stdint.h>

enum {
    LS_SEGMENTS_MAX_LIGHTS = 8192,
    LS_HEADLIGHT_LIGHTS = 3, /* a head light: the lights nearest the camera */
};

/**
 * Partition @n_lights directions (finite, not zero; any length) into @n_segments groups:
 * segment[i] in [0, n_segments), every group of floor or ceil of n_lights / n_segments lights.
 * One segment is the full sphere, n_lights segments are the single lights. Bit-identical on every
 * machine. Takes 2 ms for 346 lights, 2 s for 4096. Errors: LS_ERR_INVALID (n_lights,
 * n_segments outside [1, n_lights], a direction), LS_ERR_LIMIT (more than LS_SEGMENTS_MAX_LIGHTS),
 * LS_ERR_NOMEM.
 */
LS_MUST_CHECK enum ls_err ls_segments_partition(const float (*directions)[3], uint32_t n_lights,
                                                uint32_t n_segments, uint32_t *segment,
                                                struct ls_diag *diag);

/**
 * Unit mean direction of each group of a partition, by ls_segments_partition or not; that of its
 * first light where the mean vanishes. centre[n_segments]. LS_ERR_INVALID: a number outside
 * [0, n_segments), an empty group, a direction.
 */
LS_MUST_CHECK enum ls_err ls_segments_centres(const float (*directions)[3], uint32_t n_lights,
                                              const uint32_t *segment, uint32_t n_segments,
                                              double (*centre)[3], struct ls_diag *diag);

#endif
