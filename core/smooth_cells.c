#include "core/smooth_cells.h"

#include "core/sphere_mesh.h"
#include "core/vec3.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

enum { MAX_LIGHTS = 16384, AXES = 6, RINGS = 512, SECTORS = 256 };
static const double coincident = 1e-4, part_rad = M_PI / 360;
/* any half of the sphere holds an axis within 54.7 degrees of its pole: with a point within 35
 * degrees of every axis the origin is inside the hull */
static const double hole_rad = 35 * M_PI / 180, hole_spacings = 2, hole_share = 1.15;

/** The points of the triangulation: lights first, then the middles of holes. */
struct points {
    size_t n_lights, n_sites, n; /* n = n_sites + holes */
    double (*d)[3];
    uint32_t *site;   /* [n_lights] */
    uint32_t *shares; /* [n_sites] */
    struct ls_sphere_mesh *mesh;
};

static double angle(const double a[3], const double b[3])
{
    return 2 * asin(fmin(1, 0.5 * ls_distance3(a, b)));
}

static void points_finish(struct points *points)
{
    free(points->d);
    free(points->site);
    free(points->shares);
    ls_sphere_mesh_destroy(points->mesh);
}

static void add_light(struct points *points, const double d[3])
{
    size_t light = points->n_lights++, s = 0;
    while (s < points->n_sites && ls_distance3(points->d[s], d) >= coincident)
        s++;
    if (s == points->n_sites) {
        memcpy(points->d[s], d, sizeof points->d[0]);
        points->n_sites++;
    }
    points->site[light] = (uint32_t)s;
    points->shares[s]++;
}

static enum ls_err add_lights(struct points *points, const float (*directions)[3], size_t n,
                              struct ls_diag *diag)
{
    for (size_t i = 0; i < n; i++) {
        double d[3] = {(double)directions[i][0], (double)directions[i][1],
                       (double)directions[i][2]};
        double length = sqrt(ls_dot3(d, d));
        if (!(length > 1e-30 && length < INFINITY))
            return ls_fail(diag, LS_ERR_INVALID,
                           "weights: light %zu has no direction: (%g, %g, %g)", i, d[0], d[1],
                           d[2]);
        for (int k = 0; k < 3; k++)
            d[k] /= length;
        add_light(points, d);
    }
    return LS_OK;
}

static double nearest_rad(const struct points *points, const double d[3])
{
    double best = INFINITY;
    for (size_t s = 0; s < points->n_sites; s++)
        best = fmin(best, angle(points->d[s], d));
    return best;
}

static void add_holes(struct points *points)
{
    double spacing = sqrt(4 * M_PI / (double)points->n_sites);
    points->n = points->n_sites;
    for (int axis = 0; axis < AXES; axis++) {
        double d[3] = {0, 0, 0};
        d[axis / 2] = axis % 2 ? -1 : 1;
        if (nearest_rad(points, d) > fmin(hole_rad, hole_spacings * spacing))
            memcpy(points->d[points->n++], d, sizeof d);
    }
}

static enum ls_err points_init(struct points *points, const float (*directions)[3], size_t n,
                               struct ls_diag *diag)
{
    *points = (struct points){0};
    if (n < 1 || n > MAX_LIGHTS)
        return ls_fail(diag, LS_ERR_INVALID, "weights: %zu lights: expected 1..%d", n, MAX_LIGHTS);
    points->d = calloc(n + AXES, sizeof *points->d);
    points->site = calloc(n, sizeof *points->site);
    points->shares = calloc(n, sizeof *points->shares);
    if (!points->d || !points->site || !points->shares)
        return ls_fail(diag, LS_ERR_NOMEM, "weights: out of memory");
    enum ls_err err = add_lights(points, directions, n, diag);
    if (err)
        return err;
    add_holes(points);
    return ls_sphere_mesh_create((const double(*)[3])points->d, points->n, &points->mesh, diag);
}

/* what the middle of a hole got goes to the lights nearest to it */
static void fill_hole(const struct points *points, const double *hole, const double *value,
                      size_t columns, double *per_point)
{
    double reach = hole_share * nearest_rad(points, hole), sum = 0;
    for (size_t s = 0; s < points->n_sites; s++)
        sum += fmax(0, reach - angle(points->d[s], hole));
    for (size_t s = 0; s < points->n_sites; s++) {
        double share = fmax(0, reach - angle(points->d[s], hole)) / sum;
        for (size_t c = 0; c < columns; c++)
            per_point[s * columns + c] += share * value[c];
    }
}

static void spread(const struct points *points, double *per_point, size_t columns, double *weights)
{
    for (size_t h = points->n_sites; h < points->n; h++)
        fill_hole(points, points->d[h], per_point + h * columns, columns, per_point);
    for (size_t i = 0; i < points->n_lights; i++) {
        size_t s = points->site[i];
        for (size_t c = 0; c < columns; c++)
            weights[i * columns + c] = per_point[s * columns + c] / points->shares[s];
    }
}

/* R d: where a direction of the environment is seen */
static void rotate(const double *rotation, const double in[3], double out[3])
{
    for (int k = 0; k < 3; k++)
        out[k] = rotation ? ls_dot3(rotation + 3 * k, in) : in[k];
}

/** Where the energy goes: to the three points around each direction. */
struct sink {
    const struct points *points;
    const double *rotation;
    size_t columns;
    double *per_point; /* [n][columns] */
    uint32_t face;
};

static void give(struct sink *sink, const double d[3], size_t column, const double *value,
                 size_t n_values)
{
    uint32_t vertex[3];
    double turned[3], share[3];
    rotate(sink->rotation, d, turned);
    ls_sphere_mesh_locate(sink->points->mesh, turned, &sink->face, vertex, share);
    for (int k = 0; k < 3; k++)
        for (size_t c = 0; c < n_values; c++)
            sink->per_point[vertex[k] * sink->columns + column + c] += share[k] * value[c];
}

static uint32_t parts(double rad)
{
    return (uint32_t)fmax(1, ceil(rad / part_rad - 1e-9));
}

/* one part of a texel: a strip of it in x, another in y */
struct strip {
    double v0, v1; /* of the map, [0, 1] */
    double du;
};

static void give_strip(struct sink *sink, const struct ls_map *map, const struct strip *strip,
                       uint32_t y, uint32_t per_texel)
{
    double t0 = M_PI * strip->v0, t1 = M_PI * strip->v1;
    double sr = 2 * M_PI * strip->du * 2 * sin(0.5 * (t0 + t1)) * sin(0.5 * (t1 - t0));
    for (uint32_t x = 0; x < map->width; x++) {
        const float *rgb = map->rgb + 3 * ((size_t)y * map->width + x);
        const double value[3] = {sr * (double)rgb[0], sr * (double)rgb[1], sr * (double)rgb[2]};
        if (rgb[0] == 0 && rgb[1] == 0 && rgb[2] == 0)
            continue;
        for (uint32_t k = 0; k < per_texel; k++) {
            double d[3], u = (x + (k + 0.5) / per_texel) / map->width;
            ls_latlong_direction(u, 0.5 * (strip->v0 + strip->v1), d);
            give(sink, d, 0, value, 3);
        }
    }
}

static void give_map(struct sink *sink, const struct ls_map *map)
{
    uint32_t down = parts(M_PI / map->height), across = parts(2 * M_PI / map->width);
    for (uint32_t y = 0; y < map->height; y++)
        for (uint32_t k = 0; k < down; k++) {
            struct strip strip = {.v0 = (y + (double)k / down) / map->height,
                                  .v1 = (y + (k + 1.0) / down) / map->height,
                                  .du = 1.0 / map->width / across};
            give_strip(sink, map, &strip, y, across);
        }
}

/* in parts of equal energy */
static void give_lobe(struct sink *sink, const struct ls_lobe *lobe, size_t column)
{
    double x[3], y[3], value = ls_lobe_energy(lobe) / RINGS / SECTORS;
    ls_frame_about(lobe->direction, x, y);
    for (int r = 0; r < RINGS; r++) {
        double below = ls_lobe_quantile(lobe, (r + 0.5) / RINGS); /* 1 - cos */
        double cosine = 1 - below, sine = sqrt(below * (2 - below));
        for (int s = 0; s < SECTORS; s++) {
            double d[3], a = 2 * M_PI * (s + 0.5) / SECTORS;
            for (int k = 0; k < 3; k++)
                d[k] = cosine * lobe->direction[k] + sine * (cos(a) * x[k] + sin(a) * y[k]);
            give(sink, d, column, &value, 1);
        }
    }
}

static enum ls_err integrate(const float (*directions)[3], size_t n, const double *rotation,
                             const struct ls_map *map, const struct ls_lobes *lobes,
                             double *weights, struct ls_diag *diag)
{
    struct points points;
    size_t columns = map ? 3 : lobes->n;
    enum ls_err err = points_init(&points, directions, n, diag);
    LS_CLEANUP_FREE double *per_point = err ? NULL : calloc(points.n * columns + 1, sizeof(double));
    if (!err && !per_point)
        err = ls_fail(diag, LS_ERR_NOMEM, "weights: out of memory");
    if (!err) {
        struct sink sink = {&points, rotation, columns, per_point, 0};
        if (map)
            give_map(&sink, map);
        for (size_t l = 0; lobes && l < lobes->n; l++)
            give_lobe(&sink, &lobes->item[l], l);
        spread(&points, per_point, columns, weights);
    }
    points_finish(&points);
    return err;
}

enum ls_err ls_smooth_cells_map(const float (*directions)[3], size_t n, const double *rotation,
                                const struct ls_map *map, double *weights, struct ls_diag *diag)
{
    enum ls_err err = ls_map_check(map, diag);
    return err ? err : integrate(directions, n, rotation, map, NULL, weights, diag);
}

enum ls_err ls_smooth_cells_lobes(const float (*directions)[3], size_t n, const double *rotation,
                                  const struct ls_lobes *lobes, double *weights,
                                  struct ls_diag *diag)
{
    return integrate(directions, n, rotation, NULL, lobes, weights, diag);
}
