#include "core/sphere_outline.h"

#include "core/sample.h"
#include "core/vec3.h"

#include <stdlib.h>
#include <string.h>

enum {
    TRIES = 300,      /* triples: enough for half outliers, 1 - (7/8)^300 */
    MAX_STEPS = 4096, /* of half a pixel along a ray */
};
static const double least_share = 0.6; /* of the rays that must agree */
static const double near_px = 2;       /* agreement with a triple */
static const double most_rms_px = 1.5;

struct edge {
    double ray[3]; /* unit */
};

/* Mean of 2 x 2 pixels around a point, bilinear between such means; NaN outside. */
static double level_at(const struct ls_pinhole *c, const float *picture, double x, double y)
{
    double u = floor(x - 1), v = floor(y - 1), fu = x - 1 - u, fv = y - 1 - v;
    if (!(u >= 0 && v >= 0 && u + 2 < c->width && v + 2 < c->height))
        return NAN;
    const double across[3] = {1 - fu, 1, fu}, down[3] = {1 - fv, 1, fv};
    double sum = 0;
    for (int j = 0; j < 3; j++)
        for (int i = 0; i < 3; i++)
            sum += across[i] * down[j] *
                   (double)picture[((size_t)v + (size_t)j) * c->width + (size_t)u + (size_t)i];
    return sum / 4;
}

struct search {
    const struct ls_pinhole *camera;
    const float *picture;
    double x, y;              /* from where */
    double nearest, farthest; /* px */
    double level;             /* of the sphere */
    double profile[MAX_STEPS];
};

/* Mean of the profile over steps [from, to]. */
static double mean_of(const double *profile, int from, int to)
{
    double sum = 0;
    for (int k = from; k <= to; k++)
        sum += profile[k];
    return sum / (to - from + 1);
}

/* The step where the level falls by most within 4 px of its first fall by 0.4 of the sphere's. */
static int find_fall(const struct search *s, int n)
{
    int first = -1, best = -1;
    double most = 0.4 * s->level;
    for (int k = (int)(2 * s->nearest); k + 6 < n && (first < 0 || k < first + 8); k++) {
        if (k < 6)
            continue;
        double fall = mean_of(s->profile, k - 6, k - 2) - mean_of(s->profile, k + 2, k + 6);
        if (!(fall >= most))
            continue;
        if (first < 0)
            first = k;
        most = fall;
        best = k;
    }
    return best;
}

/* Distance at which the profile crosses the middle of its two sides near step k; -1 if it does
 * not. */
static double crossing(const struct search *s, int k, int n)
{
    if (k < 10 || k + 10 >= n)
        return -1;
    double middle = 0.5 * (mean_of(s->profile, k - 10, k - 5) + mean_of(s->profile, k + 5, k + 10));
    for (int j = k - 6; j < k + 6; j++) {
        double a = s->profile[j], b = s->profile[j + 1];
        if (a >= middle && b < middle)
            return 0.5 * (j + (a - middle) / (a - b));
    }
    return -1;
}

static int find_edge(struct search *s, int index, struct edge *edge)
{
    double angle = 2 * M_PI * (index + 0.5) / LS_OUTLINE_RAYS, dx = cos(angle), dy = sin(angle);
    int n = 0, most = (int)fmin(MAX_STEPS, 2 * s->farthest);
    for (; n < most; n++) {
        s->profile[n] = level_at(s->camera, s->picture, s->x + 0.5 * n * dx, s->y + 0.5 * n * dy);
        if (!isfinite(s->profile[n]))
            break;
    }
    int k = find_fall(s, n);
    double r = k < 0 ? -1 : crossing(s, k, n);
    if (r < 0)
        return 0;
    ls_pinhole_ray(s->camera, s->x + r * dx, s->y + r * dy, edge->ray);
    return 1;
}

static uint32_t find_edges(struct search *s, struct edge *edges)
{
    uint32_t n = 0;
    for (int k = 0; k < LS_OUTLINE_RAYS; k++)
        n += find_edge(s, k, &edges[n]) ? 1 : 0;
    return n;
}

/* ---- the cone ---- */

struct cone {
    double axis[3], angle;
};

static int cone_of(double w[3], struct cone *cone)
{
    double length = ls_unit3(w);
    if (!(length > 1 && length < 10))
        return 0;
    memcpy(cone->axis, w, sizeof cone->axis);
    cone->angle = acos(1 / length);
    return 1;
}

/* Weighted least squares of r . w = 1; weights NULL = 1. */
static int fit_cone(const struct edge *edges, const double *weight, uint32_t n, struct cone *cone)
{
    double m[6] = {0}, b[3] = {0}, w[3];
    for (uint32_t j = 0; j < n; j++) {
        const double *r = edges[j].ray;
        double q = weight ? weight[j] : 1;
        int at = 0;
        for (int row = 0; row < 3; row++) {
            b[row] += q * r[row];
            for (int col = row; col < 3; col++)
                m[at++] += q * r[row] * r[col];
        }
    }
    return !ls_solve3(m, b, w) && cone_of(w, cone);
}

/* From the cone, in pixels. */
static double distance_px(const struct ls_pinhole *camera, const struct cone *cone,
                          const struct edge *edge)
{
    double chord[3];
    ls_along3(edge->ray, cone->axis, -1, chord);
    return (2 * asin(fmin(1, 0.5 * ls_length3(chord))) - cone->angle) / camera->pitch;
}

static uint32_t agreeing(const struct ls_pinhole *camera, const struct cone *cone,
                         const struct edge *edges, uint32_t n, double *weight)
{
    uint32_t count = 0;
    for (uint32_t j = 0; j < n; j++) {
        weight[j] = fabs(distance_px(camera, cone, &edges[j])) < near_px;
        count += weight[j] > 0;
    }
    return count;
}

/* The triple that most edges agree with. */
static uint32_t consensus(const struct ls_pinhole *camera, const struct edge *edges, uint32_t n,
                          struct cone *best)
{
    double weight[LS_OUTLINE_RAYS];
    uint32_t most = 0, state = 1;
    for (int t = 0; t < TRIES && n >= 3; t++) {
        struct edge three[3];
        struct cone cone;
        for (int k = 0; k < 3; k++) {
            state = state * 1664525u + 1013904223u;
            three[k] = edges[(n * (uint32_t)k + (state >> 8) % n) / 3];
        }
        if (!fit_cone(three, NULL, 3, &cone))
            continue;
        uint32_t count = agreeing(camera, &cone, edges, n, weight);
        if (count > most) {
            most = count;
            *best = cone;
        }
    }
    return most;
}

/* Tukey's biweight around the consensus; rms and number of those with any weight. */
static uint32_t polish(const struct ls_pinhole *camera, const struct edge *edges, uint32_t n,
                       struct cone *cone, double *rms_px)
{
    double weight[LS_OUTLINE_RAYS], sum = 0;
    uint32_t used = 0;
    for (int round = 0; round < 6; round++) {
        float off[LS_OUTLINE_RAYS];
        for (uint32_t j = 0; j < n; j++)
            off[j] = (float)fabs(distance_px(camera, cone, &edges[j]));
        double reach = 4.685 * fmax(0.1, 1.4826 * (double)ls_median(off, n));
        sum = 0;
        used = 0;
        for (uint32_t j = 0; j < n; j++) {
            double d = distance_px(camera, cone, &edges[j]), u = d / reach;
            weight[j] = fabs(u) < 1 ? (1 - u * u) * (1 - u * u) : 0;
            used += weight[j] > 0;
            sum += weight[j] > 0 ? d * d : 0;
        }
        if (!fit_cone(edges, weight, n, cone))
            return 0;
    }
    *rms_px = used ? sqrt(sum / used) : INFINITY;
    return used;
}

/* ---- the whole ---- */

/* Median of the picture around the start. */
static double inner_level(const struct search *s, double reach)
{
    float values[17 * 17];
    size_t n = 0;
    for (int j = -8; j <= 8; j++)
        for (int i = -8; i <= 8; i++) {
            double v = level_at(s->camera, s->picture, s->x + i * reach / 8, s->y + j * reach / 8);
            if (isfinite(v))
                values[n++] = (float)v;
        }
    return n ? (double)ls_median(values, n) : NAN;
}

static enum ls_err search_from(struct search *s, double radius_px, struct cone *cone,
                               struct ls_outline *out, struct ls_diag *diag)
{
    struct edge edges[LS_OUTLINE_RAYS];
    s->level = inner_level(s, 0.25 * radius_px);
    if (!(s->level > 0))
        return ls_fail(
            diag, LS_ERR_NOT_FOUND,
            "sphere: the picture is dark around (%.0f, %.0f) px, where the sphere should "
            "be: is it in its place, and were the lights on?",
            s->x, s->y);
    uint32_t n = find_edges(s, edges);
    uint32_t agreed = consensus(s->camera, edges, n, cone);
    if (agreed < least_share * LS_OUTLINE_RAYS)
        return ls_fail(diag, LS_ERR_NOT_FOUND,
                       "sphere: no outline around (%.0f, %.0f) px: %u of %d rays found an edge, %u "
                       "of them agree; is the sphere whole in the picture, %.0f px in radius, "
                       "before a darker background?",
                       s->x, s->y, n, LS_OUTLINE_RAYS, agreed, radius_px);
    out->n_used = polish(s->camera, edges, n, cone, &out->rms_px);
    if (out->n_used < least_share * LS_OUTLINE_RAYS || !(out->rms_px < most_rms_px))
        return ls_fail(
            diag, LS_ERR_NOT_FOUND,
            "sphere: the outline around (%.0f, %.0f) px is none: %u points with an error "
            "of %.2f px, expected at least %.0f within %.1f px",
            s->x, s->y, out->n_used, out->rms_px, least_share * LS_OUTLINE_RAYS, most_rms_px);
    return LS_OK;
}

static void place(const struct ls_pinhole *camera, const struct cone *cone, double radius_m,
                  struct ls_sphere *found)
{
    found->radius_m = radius_m;
    ls_along3(camera->eye_m, cone->axis, radius_m / sin(cone->angle), found->centre_m);
}

enum ls_err ls_sphere_locate(const struct ls_pinhole *camera, const float *picture,
                             const struct ls_sphere *nominal, struct ls_sphere *found,
                             struct ls_outline *outline, struct ls_diag *diag)
{
    struct ls_outline at;
    struct cone cone = {{0}, 0};
    enum ls_err err = ls_sphere_outline(camera, nominal, &at, diag);
    LS_CLEANUP_FREE struct search *s = malloc(sizeof *s);
    if (!err && !s)
        err = ls_fail(diag, LS_ERR_NOMEM, "out of memory for an outline");
    for (int round = 0; round < 2 && !err; round++) {
        s->camera = camera;
        s->picture = picture;
        s->x = at.x_px;
        s->y = at.y_px;
        s->nearest = (round ? 0.8 : 0.1) * at.radius_px;
        s->farthest = (round ? 1.2 : 2.2) * at.radius_px + 8;
        err = search_from(s, at.radius_px, &cone, outline, diag);
        if (err)
            break;
        place(camera, &cone, nominal->radius_m, found);
        err = ls_sphere_outline(camera, found, &at, diag);
    }
    if (err)
        return err;
    outline->x_px = at.x_px;
    outline->y_px = at.y_px;
    outline->radius_px = at.radius_px;
    return LS_OK;
}

enum ls_err ls_sphere_outline(const struct ls_pinhole *camera, const struct ls_sphere *sphere,
                              struct ls_outline *out, struct ls_diag *diag)
{
    enum { POINTS = 64 };
    double a[3], e1[3], e2[3], x[POINTS], y[POINTS];
    ls_along3(sphere->centre_m, camera->eye_m, -1, a);
    double distance = ls_unit3(a), sine = sphere->radius_m / distance;
    if (!(sine > 0 && sine < 0.95) || !(ls_dot3(a, camera->forward) > 0.2))
        return ls_fail(diag, LS_ERR_INVALID,
                       "sphere of %g m at (%g, %g, %g): the camera at (%g, %g, %g) cannot see it",
                       sphere->radius_m, sphere->centre_m[0], sphere->centre_m[1],
                       sphere->centre_m[2], camera->eye_m[0], camera->eye_m[1], camera->eye_m[2]);
    ls_cross3(a, camera->up, e1);
    ls_unit3(e1);
    ls_cross3(a, e1, e2);
    *out = (struct ls_outline){0};
    for (int k = 0; k < POINTS; k++) {
        double p[3], angle = 2 * M_PI * k / POINTS, t = sine / sqrt(1 - sine * sine);
        ls_along3(a, e1, t * cos(angle), p);
        ls_along3(p, e2, t * sin(angle), p);
        ls_along3(camera->eye_m, p, 1, p);
        ls_pinhole_project(camera, p, &x[k], &y[k]);
        out->x_px += x[k] / POINTS;
        out->y_px += y[k] / POINTS;
    }
    for (int k = 0; k < POINTS; k++)
        out->radius_px += hypot(x[k] - out->x_px, y[k] - out->y_px) / POINTS;
    if (!isfinite(out->radius_px))
        return ls_fail(diag, LS_ERR_INVALID, "sphere: it lies partly behind the camera");
    return LS_OK;
}
