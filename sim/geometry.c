#include "sim/geometry.h"

#include "core/positions.h"
#include "sim/file.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum {
    OMEGA_DIRECTIONS = 200000,
    MAX_FILE_BYTES = 4 << 20,
};

static void normalise(struct sim_geometry *g)
{
    for (uint32_t i = 0; i < g->n_lights; i++) {
        const float *x = g->position_m[i];
        double r = sqrt((double)x[0] * x[0] + (double)x[1] * x[1] + (double)x[2] * x[2]);
        for (int k = 0; k < 3; k++)
            g->direction[i][k] = r > 0 ? (float)(x[k] / r) : k == 2;
    }
}

static int same_direction(const float a[3], const float b[3])
{
    double dx = a[0] - b[0], dy = a[1] - b[1], dz = a[2] - b[2];
    return dx * dx + dy * dy + dz * dz < 1e-12;
}

static void share_coincident(struct sim_geometry *g)
{
    for (uint32_t i = 0; i < g->n_lights; i++) {
        if (g->omega_sr[i] == 0)
            continue;
        uint32_t same = 1;
        for (uint32_t j = i + 1; j < g->n_lights; j++)
            same += g->omega_sr[j] == 0 && same_direction(g->direction[i], g->direction[j]);
        if (same == 1)
            continue;
        float share = g->omega_sr[i] / (float)same;
        for (uint32_t j = i; j < g->n_lights; j++)
            if (same_direction(g->direction[i], g->direction[j]))
                g->omega_sr[j] = share;
    }
}

static void measure_cells(struct sim_geometry *g)
{
    for (uint32_t k = 0; k < OMEGA_DIRECTIONS; k++) {
        float d[3];
        sim_geometry_fibonacci(k, OMEGA_DIRECTIONS, d);
        g->omega_sr[sim_geometry_nearest(g, d)] += 1;
    }
    for (uint32_t i = 0; i < g->n_lights; i++)
        g->omega_sr[i] *= (float)(4 * M_PI / OMEGA_DIRECTIONS);
    share_coincident(g);
}

static enum ls_err allocate(uint32_t n, struct sim_geometry *g, struct ls_diag *diag)
{
    *g = (struct sim_geometry){.n_lights = n};
    g->position_m = calloc(n, sizeof *g->position_m);
    g->direction = calloc(n, sizeof *g->direction);
    g->omega_sr = calloc(n, sizeof *g->omega_sr);
    if (g->position_m && g->direction && g->omega_sr)
        return LS_OK;
    sim_geometry_finish(g);
    return ls_fail(diag, LS_ERR_NOMEM, "out of memory for %u lights", n);
}

static void reference_rings(float (*out)[3])
{
    /* top, then latitudes 80, 70 ... -70 degrees; rows near the equator 12 degrees apart */
    static const int count[] = {1, 5, 10, 15, 20, 24, 27, 29, 30, 30, 30, 29, 27, 24, 20, 15, 10};
    uint32_t row = 0;
    for (int ring = 0; ring < (int)(sizeof count / sizeof *count); ring++) {
        double latitude = (90 - 10 * ring) * M_PI / 180;
        double offset = ring % 2 ? 0 : 0.5;
        if (ring == 9)
            offset = 0;
        for (int j = 0; j < count[ring]; j++, row++) {
            double azimuth = 2 * M_PI * (j + offset) / count[ring];
            out[row][0] = (float)(cos(latitude) * sin(azimuth));
            out[row][1] = (float)sin(latitude);
            out[row][2] = (float)(cos(latitude) * cos(azimuth));
        }
    }
}

enum ls_err sim_geometry_sphere(uint32_t n_lights, double radius_m, struct sim_geometry *out,
                                struct ls_diag *diag)
{
    if (n_lights < 1 || n_lights > SIM_MAX_LIGHTS)
        return ls_fail(diag, LS_ERR_INVALID, "lights: expected 1 to %d, found %u", SIM_MAX_LIGHTS,
                       n_lights);
    if (!(radius_m >= 0.2 && radius_m <= 100))
        return ls_fail(diag, LS_ERR_INVALID, "radius: expected 0.2 to 100 m, found %g", radius_m);
    enum ls_err err = allocate(n_lights, out, diag);
    if (err)
        return err;
    if (n_lights == 346)
        reference_rings(out->position_m);
    else
        for (uint32_t i = 0; i < n_lights; i++)
            sim_geometry_fibonacci(i, n_lights, out->position_m[i]);
    for (uint32_t i = 0; i < n_lights; i++)
        for (int k = 0; k < 3; k++)
            out->position_m[i][k] *= (float)radius_m;
    normalise(out);
    measure_cells(out);
    return LS_OK;
}

enum ls_err sim_geometry_load(const char *path, const char *axes, const char *unit,
                              struct sim_geometry *out, struct ls_diag *diag)
{
    LS_CLEANUP_FREE char *text = NULL;
    size_t size = 0;
    struct ls_positions positions = {0};
    enum ls_err err = sim_file_read(path, MAX_FILE_BYTES, &text, &size, diag);
    if (!err)
        err = ls_positions_parse(text, size, path, axes, unit, SIM_MAX_LIGHTS, &positions, diag);
    if (err)
        return err;
    err = positions.n ? allocate(positions.n, out, diag)
                      : ls_fail(diag, LS_ERR_INVALID, "%s: holds no light", path);
    if (!err) {
        memcpy(out->position_m, positions.xyz_m, positions.n * sizeof *out->position_m);
        normalise(out);
        measure_cells(out);
    }
    ls_positions_finish(&positions);
    return err;
}

uint32_t sim_geometry_nearest(const struct sim_geometry *g, const float d[3])
{
    uint32_t best = 0;
    float best_dot = -2;
    for (uint32_t i = 0; i < g->n_lights; i++) {
        const float *l = g->direction[i];
        float dot = l[0] * d[0] + l[1] * d[1] + l[2] * d[2];
        if (dot > best_dot) {
            best_dot = dot;
            best = i;
        }
    }
    return best;
}

void sim_geometry_fibonacci(uint32_t index, uint32_t n, float d[3])
{
    double y = 1 - (2.0 * index + 1) / n;
    double r = sqrt(1 - y * y);
    double phi = fmod(index * 0.6180339887498949, 1.0) * 2 * M_PI; /* golden ratio - 1 */
    d[0] = (float)(r * sin(phi));
    d[1] = (float)y;
    d[2] = (float)(r * cos(phi));
}

void sim_geometry_finish(struct sim_geometry *g)
{
    free(g->position_m);
    free(g->direction);
    free(g->omega_sr);
    *g = (struct sim_geometry){0};
}
