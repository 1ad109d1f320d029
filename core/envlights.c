#include "core/envlights.h"

#include "core/vec3.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

enum { MAX_LIGHTS = 16384, MAX_DEPTH = 48 };
static const double coincident_rad = 1e-6;
/* where a cell's border stops being followed: one border across a box is cut straight, a corner of
 * three cells is not cut */
static const double border_rad = 4e-3, corner_rad = 4e-4;

/** The distinct directions of the lights, in the environment's frame. */
struct sites {
    size_t n, n_lights;
    double (*d)[3];   /* unit */
    uint32_t *of;     /* [n_lights], the site of a light */
    uint32_t *shares; /* [n], lights at the site */
};

static void sites_finish(struct sites *sites)
{
    free(sites->d);
    free(sites->of);
    free(sites->shares);
}

/* R' d: where the light stands in a map turned by R */
static void unrotate(const double *rotation, const double in[3], double out[3])
{
    for (int k = 0; k < 3; k++)
        out[k] = rotation ? rotation[k] * in[0] + rotation[3 + k] * in[1] + rotation[6 + k] * in[2]
                          : in[k];
}

static void add_light(struct sites *sites, const double d[3])
{
    size_t light = sites->n_lights++;
    for (size_t s = 0; s < sites->n; s++) {
        if (ls_distance3(sites->d[s], d) < coincident_rad) {
            sites->of[light] = (uint32_t)s;
            sites->shares[s]++;
            return;
        }
    }
    memcpy(sites->d[sites->n], d, sizeof sites->d[0]);
    sites->shares[sites->n] = 1;
    sites->of[light] = (uint32_t)sites->n++;
}

static enum ls_err sites_init(struct sites *sites, const float (*directions)[3], size_t n,
                              const double *rotation, struct ls_diag *diag)
{
    *sites = (struct sites){0};
    if (n < 1 || n > MAX_LIGHTS)
        return ls_fail(diag, LS_ERR_INVALID, "weights: %zu lights: expected 1..%d", n, MAX_LIGHTS);
    sites->d = calloc(n, sizeof *sites->d);
    sites->of = calloc(n, sizeof *sites->of);
    sites->shares = calloc(n, sizeof *sites->shares);
    if (!sites->d || !sites->of || !sites->shares)
        return ls_fail(diag, LS_ERR_NOMEM, "weights: out of memory");
    for (size_t i = 0; i < n; i++) {
        double in[3] = {(double)directions[i][0], (double)directions[i][1],
                        (double)directions[i][2]};
        double d[3], length = sqrt(ls_dot3(in, in));
        if (!(length > 1e-30 && length < INFINITY))
            return ls_fail(diag, LS_ERR_INVALID,
                           "weights: light %zu has no direction: (%g, %g, %g)", i, in[0], in[1],
                           in[2]);
        for (int k = 0; k < 3; k++)
            in[k] /= length;
        unrotate(rotation, in, d);
        add_light(sites, d);
    }
    return LS_OK;
}

static void spread(const struct sites *sites, const double *per_site, size_t columns,
                   double *weights)
{
    for (size_t i = 0; i < sites->n_lights; i++) {
        size_t s = sites->of[i];
        for (size_t c = 0; c < columns; c++)
            weights[i * columns + c] = per_site[s * columns + c] / sites->shares[s];
    }
}

static uint32_t nearest(const struct sites *sites, const uint32_t *candidates, size_t n,
                        const double d[3])
{
    uint32_t best = candidates[0];
    double most = -INFINITY;
    for (size_t k = 0; k < n; k++) {
        double cosine = ls_dot3(sites->d[candidates[k]], d);
        if (cosine > most || (cosine == most && candidates[k] < best)) {
            most = cosine;
            best = candidates[k];
        }
    }
    return best;
}

/* Of @in, those whose cell can meet the cone of half-angle @radius about @centre: all but the ones
 * beaten everywhere in it by the site nearest to its centre. */
static size_t prune(const struct sites *sites, const uint32_t *in, size_t n, const double centre[3],
                    double radius, uint32_t *out)
{
    uint32_t best = nearest(sites, in, n, centre);
    double reach = radius < M_PI_2 ? sin(radius) : 2;
    size_t kept = 0;
    for (size_t k = 0; k < n; k++) {
        const double *a = sites->d[best], *b = sites->d[in[k]];
        double ahead = ls_dot3(centre, a) - ls_dot3(centre, b);
        if (in[k] == best || ahead <= reach * ls_distance3(a, b))
            out[kept++] = in[k];
    }
    return kept;
}

/**
 * A walk down a quadtree of the sphere, handing whole boxes to cells. Columns of boxes are
 * longitudes; rows are polar angles of a map, or the part of a lobe's energy inside a polar angle.
 */
struct walk {
    const struct sites *sites;
    const struct ls_map *map;   /* NULL = constant 1, one texel, one column */
    const struct ls_lobe *lobe; /* NULL, or what to integrate instead; its axis is the pole */
    uint32_t width, height, columns;
    double *per_site; /* [n][columns] */
};

/** A box of the map, in texels; inside one texel the corners are fractions. */
struct box {
    double x0, y0, x1, y1;
};

static double polar_angle(const struct walk *walk, double y)
{
    if (walk->lobe)
        return 2 * asin(sqrt(0.5 * ls_lobe_quantile(walk->lobe, y)));
    return M_PI * y / walk->height;
}

static double solid_angle(const struct walk *walk, double x0, double y0, double x1, double y1)
{
    double t0 = M_PI * y0 / walk->height, t1 = M_PI * y1 / walk->height;
    /* cos t0 - cos t1, without cancellation */
    return 2 * M_PI * (x1 - x0) / walk->width * 2 * sin(0.5 * (t0 + t1)) * sin(0.5 * (t1 - t0));
}

static void give(const struct walk *walk, const struct box *box, uint32_t site, double share)
{
    double *sum = walk->per_site + (size_t)site * walk->columns;
    if (walk->lobe) {
        sum[0] += share * ls_lobe_energy(walk->lobe) * (box->x1 - box->x0) * (box->y1 - box->y0);
        return;
    }
    if (!walk->map) {
        sum[0] += share * solid_angle(walk, box->x0, box->y0, box->x1, box->y1);
        return;
    }
    for (uint32_t y = (uint32_t)box->y0; y < box->y1; y++) {
        double y0 = fmax(box->y0, y), y1 = fmin(box->y1, (double)y + 1);
        for (uint32_t x = (uint32_t)box->x0; x < box->x1; x++) {
            double sr = solid_angle(walk, fmax(box->x0, x), y0, fmin(box->x1, (double)x + 1), y1);
            const float *rgb = walk->map->rgb + 3 * ((size_t)y * walk->width + x);
            for (int c = 0; c < 3; c++)
                sum[c] += share * sr * (double)rgb[c];
        }
    }
}

/** A box on the sphere: its centre and half-extents; no point of it is farther from the centre
 * than both together (along the parallel of the centre, then along a meridian). */
struct patch {
    double centre[3], half_width, half_height, radius;
};

static void patch_of(const struct walk *walk, const struct box *box, struct patch *patch)
{
    double t0 = polar_angle(walk, box->y0), t1 = polar_angle(walk, box->y1);
    double theta = 0.5 * (t0 + t1);
    ls_latlong_direction(0.5 * (box->x0 + box->x1) / walk->width, theta / M_PI, patch->centre);
    patch->half_width = M_PI * (box->x1 - box->x0) / walk->width * sin(theta);
    patch->half_height = 0.5 * (t1 - t0);
    patch->radius = patch->half_width + patch->half_height;
}

/* the part of a rectangle on the positive side of a line at signed distance @t from its centre,
 * @p and @q the rectangle's half-extents along the line's normal */
static double part_ahead(double t, double p, double q)
{
    if (t < 0)
        return 1 - part_ahead(-t, p, q);
    if (t >= p + q)
        return 1;
    if (t <= fabs(p - q))
        return 0.5 + 0.5 * t / fmax(p, q);
    return 1 - (p + q - t) * (p + q - t) / (8 * p * q);
}

/* a small box across the border of two cells */
static void give_two(const struct walk *walk, const struct box *box, const struct patch *patch,
                     const uint32_t site[2])
{
    const double *centre = patch->centre;
    const double *a = walk->sites->d[site[0]], *b = walk->sites->d[site[1]];
    double apart = ls_distance3(a, b), ring = hypot(centre[0], centre[2]), across[3];
    for (int k = 0; k < 3; k++)
        across[k] = (a[k] - b[k]) / apart;
    double east = ring > 0 ? (across[2] * centre[0] - across[0] * centre[2]) / ring : 1;
    double along = ls_dot3(across, centre);
    double south = sqrt(fmax(0, 1 - east * east - along * along));
    double share = part_ahead(along, fabs(east) * patch->half_width, south * patch->half_height);
    give(walk, box, site[0], share);
    give(walk, box, site[1], 1 - share);
}

static double middle(double a, double b)
{
    return b - a > 1 ? floor(0.5 * (a + b)) : 0.5 * (a + b);
}

/* parts of a lobe too faint to be followed: its far tail */
static bool negligible(const struct walk *walk, const struct box *box)
{
    return walk->lobe && (box->x1 - box->x0) * (box->y1 - box->y0) < 1e-10;
}

static void descend(const struct walk *walk, struct box box, uint32_t *candidates, size_t n,
                    int depth)
{
    struct patch patch;
    uint32_t *mine = candidates + n; /* the survivors follow their parent's on one stack */
    patch_of(walk, &box, &patch);
    size_t kept = prune(walk->sites, candidates, n, patch.centre, patch.radius, mine);
    bool whole_texel = box.x1 - box.x0 > 1 || box.y1 - box.y0 > 1;
    if (kept == 1) {
        give(walk, &box, mine[0], 1);
        return;
    }
    if (kept == 2 && patch.radius < border_rad && !whole_texel) {
        give_two(walk, &box, &patch, mine);
        return;
    }
    if (depth == MAX_DEPTH || (patch.radius < corner_rad && !whole_texel) ||
        negligible(walk, &box)) {
        give(walk, &box, nearest(walk->sites, mine, kept, patch.centre), 1);
        return;
    }
    /* across the longer side, so that boxes near the poles stay compact */
    bool split_x = patch.half_width > patch.half_height;
    if (whole_texel)
        split_x = box.x1 - box.x0 > 1 && (split_x || box.y1 - box.y0 <= 1);
    struct box second = box;
    if (split_x)
        second.x0 = box.x1 = middle(box.x0, box.x1);
    else
        second.y0 = box.y1 = middle(box.y0, box.y1);
    descend(walk, box, mine, kept, depth + 1);
    descend(walk, second, mine, kept, depth + 1);
}

static enum ls_err run(struct walk *walk, struct ls_diag *diag)
{
    size_t n = walk->sites->n;
    LS_CLEANUP_FREE uint32_t *stack = calloc(n * (MAX_DEPTH + 3), sizeof *stack);
    if (!stack)
        return ls_fail(diag, LS_ERR_NOMEM, "weights: out of memory");
    for (size_t s = 0; s < n; s++)
        stack[s] = (uint32_t)s;
    struct box all = {0, 0, walk->width, walk->height};
    descend(walk, all, stack, n, 0);
    return LS_OK;
}

static enum ls_err integrate(const struct sites *sites, const struct ls_map *map, double *weights,
                             struct ls_diag *diag)
{
    uint32_t columns = map ? 3 : 1;
    LS_CLEANUP_FREE double *per_site = calloc(sites->n * columns, sizeof *per_site);
    if (!per_site)
        return ls_fail(diag, LS_ERR_NOMEM, "weights: out of memory");
    struct walk walk = {.sites = sites,
                        .map = map,
                        .columns = columns,
                        .per_site = per_site,
                        .width = map ? map->width : 1,
                        .height = map ? map->height : 1};
    enum ls_err err = run(&walk, diag);
    if (!err)
        spread(sites, per_site, columns, weights);
    return err;
}

enum ls_err ls_envlights_omega(const float (*directions)[3], size_t n, double *omega_sr,
                               struct ls_diag *diag)
{
    struct sites sites;
    enum ls_err err = sites_init(&sites, directions, n, NULL, diag);
    if (!err)
        err = integrate(&sites, NULL, omega_sr, diag);
    sites_finish(&sites);
    return err;
}

enum ls_err ls_envlights_map(const float (*directions)[3], size_t n, const double *rotation,
                             const struct ls_map *map, double *weights, struct ls_diag *diag)
{
    struct sites sites;
    enum ls_err err = ls_map_check(map, diag);
    if (err)
        return err;
    err = sites_init(&sites, directions, n, rotation, diag);
    if (!err)
        err = integrate(&sites, map, weights, diag);
    sites_finish(&sites);
    return err;
}

void ls_rotation_y(double radians, double rotation[9])
{
    double c = cos(radians), s = sin(radians);
    const double m[9] = {c, 0, s, 0, 1, 0, -s, 0, c};
    memcpy(rotation, m, sizeof m);
}

/* --- lobes --- */

static void into_frame(const struct sites *sites, const double pole[3], double (*d)[3])
{
    double x[3], z[3];
    ls_frame_about(pole, x, z);
    for (size_t s = 0; s < sites->n; s++) {
        d[s][0] = ls_dot3(sites->d[s], x);
        d[s][1] = ls_dot3(sites->d[s], pole);
        d[s][2] = ls_dot3(sites->d[s], z);
    }
}

static enum ls_err integrate_lobes(const struct sites *sites, const struct ls_lobes *lobes,
                                   double *weights, struct ls_diag *diag)
{
    enum ls_err err = LS_OK;
    LS_CLEANUP_FREE double *per_site = calloc(sites->n * lobes->n + 1, sizeof *per_site);
    LS_CLEANUP_FREE double(*d)[3] = calloc(sites->n, sizeof *d);
    if (!per_site || !d)
        return ls_fail(diag, LS_ERR_NOMEM, "weights: out of memory");
    for (size_t l = 0; !err && l < lobes->n; l++) {
        struct sites turned = *sites;
        struct walk walk = {.sites = &turned,
                            .lobe = &lobes->item[l],
                            .columns = (uint32_t)lobes->n,
                            .per_site = per_site + l,
                            .width = 1,
                            .height = 1};
        turned.d = d;
        into_frame(sites, lobes->item[l].direction, d);
        err = run(&walk, diag);
    }
    if (!err)
        spread(sites, per_site, lobes->n, weights);
    return err;
}

enum ls_err ls_envlights_lobes(const float (*directions)[3], size_t n, const double *rotation,
                               const struct ls_lobes *lobes, double *weights, struct ls_diag *diag)
{
    struct sites sites;
    enum ls_err err = sites_init(&sites, directions, n, rotation, diag);
    if (!err)
        err = integrate_lobes(&sites, lobes, weights, diag);
    sites_finish(&sites);
    return err;
}
