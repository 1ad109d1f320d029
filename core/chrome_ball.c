#include "core/chrome_ball.h"

#include "core/merge.h"
#include "core/sample.h"
#include "core/vec3.h"

#include <stdlib.h>
#include <string.h>

static const double rim = 0.97;         /* of the ball's radius */
static const double half = 0.5;         /* of the peak above the ball's middle level */
static const double least_contrast = 3; /* of the peak to that level */
static const double core_cos = 0.5;     /* 60 degrees: summed as highlight */

/* A window of corners between pixels that holds the ball. */
struct window {
    const struct ls_sphere_view *ball;
    const float *picture;
    uint32_t x0, y0, width, height;
    float *level; /* mean of the four pixels around a corner; NaN off the ball */
    uint8_t *on;  /* 1: ball, 2: in the patch, 3: its edge is off the ball */
    uint32_t n_ball;
};

static int reflected(const struct ls_sphere_view *ball, double px, double py, double part,
                     double x[3], double n[3], double r[3])
{
    double d[3];
    ls_pinhole_ray(&ball->camera, px, py, d);
    if (!ls_sphere_hit(&ball->camera, &ball->sphere, px, py, part, x, n))
        return 0;
    ls_along3(d, n, -2 * ls_dot3(d, n), r);
    return 1;
}

static void fill(struct window *w)
{
    const struct ls_pinhole *c = &w->ball->camera;
    for (uint32_t j = 0; j < w->height; j++)
        for (uint32_t i = 0; i < w->width; i++) {
            double x[3], n[3];
            uint32_t px = w->x0 + i, py = w->y0 + j; /* the corner's lower right pixel */
            size_t at = (size_t)j * w->width + i;
            w->level[at] = NAN;
            if (!ls_sphere_hit(c, &w->ball->sphere, px, py, rim, x, n))
                continue;
            const float *p = w->picture + (size_t)py * c->width + px;
            w->level[at] =
                0.25f * (p[0] + p[-1] + p[-(ptrdiff_t)c->width] + p[-(ptrdiff_t)c->width - 1]);
            if (!isfinite(w->level[at]))
                continue;
            w->on[at] = 1;
            w->n_ball++;
        }
}

static double middle(const struct window *w, float *room)
{
    uint32_t n = 0, size = w->width * w->height, step = w->n_ball / 4096 + 1, seen = 0;
    for (uint32_t k = 0; k < size; k++)
        if (w->on[k] && seen++ % step == 0)
            room[n++] = w->level[k];
    return (double)ls_median(room, n);
}

static uint32_t find_peak(const struct window *w)
{
    uint32_t best = UINT32_MAX;
    for (uint32_t k = 0; k < w->width * w->height; k++)
        if (w->on[k] && (best == UINT32_MAX || w->level[k] > w->level[best]))
            best = k;
    return best;
}

/* Everything connected with the peak at or above @least, as a list; *rim_met: it leaves the ball.
 */
static uint32_t grow(struct window *w, uint32_t peak, double least, uint32_t *list, int *rim_met)
{
    uint32_t n = 0, done = 0;
    list[n++] = peak;
    w->on[peak] = 2;
    while (done < n) {
        uint32_t at = list[done++], x = at % w->width, y = at / w->width;
        const int64_t next[4] = {x ? (int64_t)at - 1 : -1, x + 1 < w->width ? (int64_t)at + 1 : -1,
                                 y ? (int64_t)at - w->width : -1,
                                 y + 1 < w->height ? (int64_t)at + w->width : -1};
        for (int k = 0; k < 4; k++) {
            if (next[k] < 0 || !w->on[next[k]])
                *rim_met = 1;
            else if (w->on[next[k]] == 1 && (double)w->level[next[k]] >= least) {
                w->on[next[k]] = 2;
                list[n++] = (uint32_t)next[k];
            }
        }
    }
    return n;
}

/* Where the ray from x along r is @distance from the stage's centre. */
static void aim(const double x[3], const double r[3], double distance, double direction[3])
{
    memcpy(direction, r, 3 * sizeof *r);
    if (isfinite(distance)) {
        double b = ls_dot3(x, r), h = b * b - ls_dot3(x, x) + distance * distance;
        ls_along3(x, r, -b + sqrt(fmax(0, h)), direction);
    }
    ls_unit3(direction);
}

static enum ls_err centroid(const struct window *w, const uint32_t *list, uint32_t n, double least,
                            double distance, struct ls_highlight *out, struct ls_diag *diag)
{
    double sum = 0, r_sum[3] = {0}, x[3], normal[3], r[3];
    *out = (struct ls_highlight){.n = n};
    for (uint32_t k = 0; k < n; k++) {
        double px = w->x0 + list[k] % w->width, py = w->y0 + list[k] / w->width;
        double weight = (double)w->level[list[k]] - least + 1e-3 * fabs(least);
        if (!reflected(w->ball, px, py, 1, x, normal, r))
            continue;
        sum += weight;
        out->x_px += weight * px;
        out->y_px += weight * py;
        ls_along3(r_sum, r, weight, r_sum);
    }
    out->x_px /= sum;
    out->y_px /= sum;
    ls_unit3(r_sum);
    if (!reflected(w->ball, out->x_px, out->y_px, 1, x, normal, r))
        return ls_fail(diag, LS_ERR_NOT_FOUND, "chrome ball: its highlight is none");
    aim(x, r_sum, distance, out->direction);
    struct ls_outline outline;
    enum ls_err err = ls_sphere_outline(&w->ball->camera, &w->ball->sphere, &outline, diag);
    double d[3];
    ls_pinhole_ray(&w->ball->camera, out->x_px, out->y_px, d);
    out->sigma_deg = err ? 0 : 180 / M_PI / outline.radius_px / fmax(0.05, -ls_dot3(d, normal));
    return err;
}

static enum ls_err find(struct window *w, double distance, struct ls_highlight *out,
                        struct ls_diag *diag)
{
    LS_CLEANUP_FREE uint32_t *list = malloc(((size_t)w->width * w->height + 1) * sizeof *list);
    float room[2 * 4096 + 8];
    if (!list)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for a highlight");
    fill(w);
    if (w->n_ball < 50)
        return ls_fail(diag, LS_ERR_NOT_FOUND,
                       "chrome ball: only %u points of it were measured, expected at least 50",
                       w->n_ball);
    uint32_t peak = find_peak(w);
    double level = fmax(0, middle(w, room)), top = (double)w->level[peak];
    if (!(top > 0) || top < least_contrast * level)
        return ls_fail(diag, LS_ERR_NOT_FOUND,
                       "chrome ball: no highlight: its brightest point is %.3g where the ball's "
                       "middle is %.3g; was the light on, and is the ball a mirror?",
                       top, level);
    int rim_met = 0;
    double least = level + half * (top - level);
    uint32_t n = grow(w, peak, least, list, &rim_met);
    if (rim_met || n > w->n_ball / 4)
        return ls_fail(diag, LS_ERR_NOT_FOUND, "chrome ball: the highlight %s",
                       rim_met ? "touches the ball's rim, so that only a part of it is seen"
                               : "covers a quarter of the ball: this is no mirror");
    return centroid(w, list, n, least, distance, out, diag);
}

enum ls_err ls_chrome_highlight(const struct ls_sphere_view *ball, const float *picture,
                                double distance_m, struct ls_highlight *out, struct ls_diag *diag)
{
    struct ls_outline o;
    enum ls_err err = ls_sphere_outline(&ball->camera, &ball->sphere, &o, diag);
    if (err)
        return err;
    if (!(distance_m > ball->sphere.radius_m + ls_length3(ball->sphere.centre_m)))
        return ls_fail(diag, LS_ERR_INVALID, "chrome ball: a light %g m away is inside of it",
                       distance_m);
    double reach = 1.1 * o.radius_px + 2, wide = ball->camera.width, high = ball->camera.height;
    struct window w = {.ball = ball, .picture = picture};
    w.x0 = (uint32_t)fmax(1, fmin(wide - 1, o.x_px - reach));
    w.y0 = (uint32_t)fmax(1, fmin(high - 1, o.y_px - reach));
    w.width = (uint32_t)fmax(1, fmin(wide, o.x_px + reach) - w.x0);
    w.height = (uint32_t)fmax(1, fmin(high, o.y_px + reach) - w.y0);
    LS_CLEANUP_FREE float *level = calloc((size_t)w.width * w.height, sizeof *level);
    LS_CLEANUP_FREE uint8_t *on = calloc((size_t)w.width * w.height, sizeof *on);
    if (!level || !on)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for a highlight");
    w.level = level;
    w.on = on;
    return find(&w, distance_m, out, diag);
}

/* ---- reflectivity ---- */

/* Solid angle by which the reflected direction moves against that to the light across a pixel; 0
 * near the rim. */
static double spread_of(const struct ls_sphere_view *ball, const double position[3], double px,
                        double py)
{
    double x[3], n[3], r[4][3], to[3], a[3], b[3], across[3];
    static const double at[4][2] = {{-0.5, 0}, {0.5, 0}, {0, -0.5}, {0, 0.5}};
    for (int k = 0; k < 4; k++) {
        if (!reflected(ball, px + at[k][0], py + at[k][1], 1, x, n, r[k]))
            return 0;
        ls_along3(position, x, -1, to);
        ls_unit3(to);
        ls_along3(r[k], to, -1, r[k]);
    }
    ls_along3(r[1], r[0], -1, a);
    ls_along3(r[3], r[2], -1, b);
    ls_cross3(a, b, across);
    return ls_length3(across);
}

struct flux {
    double sum[3], solid[3], square[3]; /* of E dOmega, dOmega, dOmega^2 in the highlight */
    double back[3], back2[3];           /* beyond it */
    uint32_t n_back[3], n[3];
    int saturated;
};

static void collect(const struct ls_sphere_view *ball, const double position[3], const float *e,
                    const uint8_t *validity, struct flux *f)
{
    for (uint32_t k = 0; k < ball->n; k++) {
        const struct ls_sphere_pixel *p = &ball->pixels[k];
        double px = p->index % ball->camera.width + 0.5, py = p->index / ball->camera.width + 0.5;
        double x[3], n[3], r[3], to[3], v = (double)e[p->index];
        if (!isfinite(v) || !reflected(ball, px, py, 1, x, n, r))
            continue;
        ls_along3(position, x, -1, to);
        ls_unit3(to);
        int c = p->colour;
        if (ls_dot3(r, to) < core_cos) {
            f->back[c] += v;
            f->back2[c] += v * v;
            f->n_back[c]++;
            continue;
        }
        double solid = spread_of(ball, position, px, py);
        f->saturated |= validity && (validity[p->index] == LS_VALIDITY_SATURATED ||
                                     validity[p->index] == LS_VALIDITY_GAP);
        f->sum[c] += v * solid;
        f->solid[c] += solid;
        f->square[c] += solid * solid;
        f->n[c]++;
    }
}

/* Part of the sphere's pixels that one colour has. */
static double share(const struct ls_sphere_view *ball, int colour)
{
    double cells = (double)ball->step * ball->step;
    return (ball->n_colours == 1 ? 1 : colour == 1 ? 0.5 : 0.25) / cells;
}

static enum ls_err check_light(const struct ls_sphere_view *ball, const double position[3],
                               double *irradiance, struct ls_diag *diag)
{
    double eye[3], to[3], r2 = ls_dot3(position, position), axis[3];
    memcpy(axis, position, sizeof axis);
    ls_along3(ball->camera.eye_m, ball->sphere.centre_m, -1, eye);
    ls_along3(position, ball->sphere.centre_m, -1, to);
    ls_unit3(eye);
    ls_unit3(axis);
    double d = ls_unit3(to);
    if (!(d > 1.01 * ball->sphere.radius_m) || !(ls_dot3(eye, to) > 0))
        return ls_fail(diag, LS_ERR_NOT_FOUND,
                       "chrome ball: the light stands behind it; take one nearer to the camera");
    /* where the mirror reflects it: about the surface along the half vector */
    double h[3], x[3], l[3];
    ls_along3(eye, to, 1, h);
    ls_unit3(h);
    ls_along3(ball->sphere.centre_m, h, ball->sphere.radius_m, x);
    ls_along3(position, x, -1, l);
    double distance = ls_unit3(l);
    *irradiance = r2 * ls_dot3(axis, l) / (distance * distance);
    return LS_OK;
}

enum ls_err ls_chrome_reflectivity(const struct ls_sphere_view *ball, const double position[3],
                                   const float *e, const uint8_t *validity, const double *strength,
                                   double grey_reflectance, double reflectivity[3], double sigma[3],
                                   struct ls_diag *diag)
{
    struct flux f = {.saturated = 0};
    double irradiance = 0;
    enum ls_err err = check_light(ball, position, &irradiance, diag);
    if (err)
        return err;
    collect(ball, position, e, validity, &f);
    if (f.saturated)
        return ls_fail(diag, LS_ERR_NOT_FOUND,
                       "chrome ball: its highlight is saturated; expose shorter");
    for (uint32_t c = 0; c < ball->n_colours; c++) {
        double unit = strength[c] / grey_reflectance * irradiance * share(ball, (int)c);
        if (!(unit > 0) || f.n[c] < 20 || f.n_back[c] < 20)
            return ls_fail(diag, LS_ERR_NOT_FOUND,
                           "chrome ball: colour %u: %u points in the highlight's surroundings, %u "
                           "beyond, strength %g on the grey sphere: not enough",
                           c, f.n[c], f.n_back[c], strength[c]);
        double mean = f.back[c] / f.n_back[c];
        double noise2 = fmax(0, f.back2[c] / f.n_back[c] - mean * mean);
        reflectivity[c] = (f.sum[c] - mean * f.solid[c]) / unit;
        sigma[c] = sqrt(noise2 * (f.square[c] + f.solid[c] * f.solid[c] / f.n_back[c])) / unit;
        if (!(reflectivity[c] > 0) || !isfinite(reflectivity[c]))
            return ls_fail(diag, LS_ERR_NOT_FOUND, "chrome ball: nothing is reflected in colour %u",
                           c);
    }
    return LS_OK;
}
