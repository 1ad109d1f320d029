/*
 * geometry: where the lights of the simulated dome stand.
 * Layer: sim. Threads: any; no shared state. Ownership: the caller frees with sim_geometry_finish.
 *
 * Positions are in the stage frame: right-handed, y up, metres, the primary camera on +z. A file of
 * positions declares its own axes and unit and is converted on load. Coincident lights are legal:
 * a light is its row.
 */
#ifndef LS_SIM_GEOMETRY_H
#define LS_SIM_GEOMETRY_H

#include "core/error.h"

#include <stdint.h>

enum {
    SIM_MAX_LIGHTS = 4096,
};

struct sim_geometry {
    uint32_t n_lights;
    float (*position_m)[3];
    float (*direction)[3]; /* unit, from the centre towards the light */
    float *omega_sr;       /* solid angle of the cell: directions nearest to this light, shared
                              equally by coincident lights */
};

/**
 * The generated sphere: @n_lights on a sphere of @radius_m. 346 lights are the reference: 30 on the
 * equator, 12 degrees apart and one of them on +z, rings every 10 degrees of latitude, one light at
 * the top and none below -70 degrees; row 0 is the top, rings run downwards. For other counts: the
 * first @n_lights of a spherical Fibonacci spiral. (transfer full) on success.
 */
LS_MUST_CHECK enum ls_err sim_geometry_sphere(uint32_t n_lights, double radius_m,
                                              struct sim_geometry *out, struct ls_diag *diag);

/**
 * Read a file of positions (format, @axes and @unit: core/positions.h).
 * Errors: LS_ERR_NOT_FOUND, LS_ERR_INVALID naming file and line, LS_ERR_LIMIT. (transfer full).
 */
LS_MUST_CHECK enum ls_err sim_geometry_load(const char *path, const char *axes, const char *unit,
                                            struct sim_geometry *out, struct ls_diag *diag);

/** Index of the light nearest in angle to unit direction @d; ties go to the lowest index. */
uint32_t sim_geometry_nearest(const struct sim_geometry *geometry, const float d[3]);

/** Direction @index of @n evenly spread over the sphere (spherical Fibonacci); 4 pi / n each. */
void sim_geometry_fibonacci(uint32_t index, uint32_t n, float d[3]);

void sim_geometry_finish(struct sim_geometry *geometry);

#endif
