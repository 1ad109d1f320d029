#include "core/mirror_ball.h"

#include "core/environment.h"
#include "core/vec3.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { RIM = 720 };                     /* samples of the blind cone's rim */
static const double reach_px = M_SQRT2; /* from a point to a pixel that is interpolated there */

/** The ball with its own axes: towards the camera, right and up in the picture. */
struct view {
    const struct ls_mirror_ball *ball;
    double ahead[3], right[3], up[3];
    double rim[RIM][3], rim_mean[3]; /* radiance by azimuth, from right towards up */
};

double ls_mirror_ball_blind(double radius_px, double pixels)
{
    double r = fmin(1, fmax(0, 1 - pixels / radius_px));
    return fmax(M_PI / 180, 2 * acos(r));
}

static enum ls_err check_geometry(const struct ls_mirror_ball *ball, struct ls_diag *diag)
{
    const double *c = ball->centre_px, r = ball->radius_px;
    if (!(r >= 2 && c[0] - r >= 0 && c[1] - r >= 0 && c[0] + r <= ball->width &&
          c[1] + r <= ball->height))
        return ls_fail(diag, LS_ERR_INVALID,
                       "mirror ball: a disc of radius %g at (%g, %g): expected one of 2 pixels or "
                       "more inside the picture of %u x %u",
                       r, c[0], c[1], ball->width, ball->height);
    if (r > LS_MIRROR_BALL_MAX_RADIUS_PX)
        return ls_fail(diag, LS_ERR_LIMIT,
                       "mirror ball: a disc of radius %g pixels: expected at most %d; reduce the "
                       "picture",
                       r, LS_MIRROR_BALL_MAX_RADIUS_PX);
    if (!(ball->blind_rad > 0 && ball->blind_rad <= M_PI_2))
        return ls_fail(diag, LS_ERR_INVALID,
                       "mirror ball: a blind cone of %g degrees: expected 0 to 90",
                       ball->blind_rad * 180 / M_PI);
    for (int k = 0; k < 3; k++)
        if (!(ball->reflectivity[k] > 0 && ball->reflectivity[k] <= 1))
            return ls_fail(diag, LS_ERR_INVALID,
                           "mirror ball: a reflectivity of %g: expected more than 0, up to 1",
                           ball->reflectivity[k]);
    return LS_OK;
}

static enum ls_err check_values(const struct ls_mirror_ball *ball, struct ls_diag *diag)
{
    double r = ball->radius_px;
    for (uint32_t y = 0; y < ball->height; y++)
        for (uint32_t x = 0; x < ball->width; x++) {
            const float *rgb = ball->rgb + 3 * ((size_t)y * ball->width + x);
            if (hypot(x + 0.5 - ball->centre_px[0], y + 0.5 - ball->centre_px[1]) > r + reach_px)
                continue;
            if (!isfinite(rgb[0]) || !isfinite(rgb[1]) || !isfinite(rgb[2]))
                return ls_fail(diag, LS_ERR_INVALID,
                               "mirror ball: pixel (%u, %u) is not a finite number", x, y);
        }
    return LS_OK;
}

static enum ls_err make_axes(struct view *view, struct ls_diag *diag)
{
    const double *c = view->ball->to_camera;
    double length = sqrt(ls_dot3(c, c)), across = hypot(c[0], c[2]);
    if (!(length > 0 && length < INFINITY && across > 1e-6 * length))
        return ls_fail(diag, LS_ERR_INVALID,
                       "mirror ball: camera direction (%g, %g, %g): expected one that is not null "
                       "nor straight up or down",
                       c[0], c[1], c[2]);
    for (int k = 0; k < 3; k++)
        view->ahead[k] = c[k] / length;
    view->right[0] = c[2] / across; /* up x ahead */
    view->right[1] = 0;
    view->right[2] = -c[0] / across;
    view->up[0] = view->ahead[1] * view->right[2]; /* ahead x right */
    view->up[1] = view->ahead[2] * view->right[0] - view->ahead[0] * view->right[2];
    view->up[2] = -view->ahead[1] * view->right[0];
    return LS_OK;
}

static double clamped(double v, double most)
{
    return fmin(fmax(v, 0), most);
}

/* the picture at (x, y) pixels, over the reflectivity */
static void sample(const struct ls_mirror_ball *ball, double x, double y, double out[3])
{
    double fx = clamped(x - 0.5, ball->width - 1.0), fy = clamped(y - 0.5, ball->height - 1.0);
    uint32_t x0 = (uint32_t)fx, y0 = (uint32_t)fy;
    uint32_t x1 = x0 + 1 < ball->width ? x0 + 1 : x0, y1 = y0 + 1 < ball->height ? y0 + 1 : y0;
    double u = fx - x0, v = fy - y0;
    const float *row0 = ball->rgb + 3 * (size_t)y0 * ball->width;
    const float *row1 = ball->rgb + 3 * (size_t)y1 * ball->width;
    for (uint32_t c = 0; c < 3; c++)
        out[c] = ((1 - v) * ((1 - u) * (double)row0[3 * x0 + c] + u * (double)row0[3 * x1 + c]) +
                  v * ((1 - u) * (double)row1[3 * x0 + c] + u * (double)row1[3 * x1 + c])) /
                 ball->reflectivity[c];
}

/* theta off the camera's direction, azimuth from right towards up */
static void sample_polar(const struct view *view, double theta, double azimuth, double out[3])
{
    const struct ls_mirror_ball *ball = view->ball;
    double r = ball->radius_px * sin(0.5 * theta);
    sample(ball, ball->centre_px[0] + r * cos(azimuth), ball->centre_px[1] - r * sin(azimuth), out);
}

static void make_rim(struct view *view)
{
    for (int k = 0; k < RIM; k++) {
        sample_polar(view, M_PI - view->ball->blind_rad, 2 * M_PI * k / RIM, view->rim[k]);
        for (int c = 0; c < 3; c++)
            view->rim_mean[c] += view->rim[k][c] / RIM;
    }
}

/* radiance from unit direction @d; true if it was filled in */
static bool radiance(const struct view *view, const double d[3], double out[3])
{
    double x = ls_dot3(d, view->right), y = ls_dot3(d, view->up), z = ls_dot3(d, view->ahead);
    double theta = atan2(hypot(x, y), z), azimuth = atan2(y, x), off = M_PI - theta;
    if (off >= view->ball->blind_rad) {
        sample_polar(view, theta, azimuth, out);
        return false;
    }
    double at = (azimuth < 0 ? azimuth + 2 * M_PI : azimuth) / (2 * M_PI) * RIM;
    int k = (int)at % RIM, next = (k + 1) % RIM;
    double u = at - floor(at), share = off / view->ball->blind_rad;
    for (int c = 0; c < 3; c++)
        out[c] = share * ((1 - u) * view->rim[k][c] + u * view->rim[next][c]) +
                 (1 - share) * view->rim_mean[c];
    return true;
}

/** A map being made: each texel in down x across parts. */
struct target {
    uint32_t width, height, down, across;
    float *map;
    uint8_t *filled;
};

static void fill_texel(const struct view *view, const struct target *target, uint32_t x, uint32_t y,
                       struct ls_mirror_ball_report *report)
{
    double sum[3] = {0}, size = 0;
    uint32_t n_filled = 0;
    for (uint32_t j = 0; j < target->down; j++)
        for (uint32_t i = 0; i < target->across; i++) {
            double d[3], value[3], v = (y + (j + 0.5) / target->down) / target->height;
            double weight = sin(M_PI * v);
            ls_latlong_direction((x + (i + 0.5) / target->across) / target->width, v, d);
            n_filled += radiance(view, d, value);
            for (int c = 0; c < 3; c++) {
                sum[c] += weight * value[c];
                report->peak = fmax(report->peak, value[c]);
            }
            size += weight;
        }
    size_t at = (size_t)y * target->width + x;
    for (int c = 0; c < 3; c++)
        target->map[3 * at + (size_t)c] = (float)(sum[c] / size);
    bool marked = 2 * n_filled >= target->down * target->across;
    if (target->filled)
        target->filled[at] = marked;
    if (marked)
        report->filled_sr +=
            2 * M_PI / target->width *
            (cos(M_PI * y / target->height) - cos(M_PI * (y + 1) / target->height));
}

/* parts no larger than a quarter of a pixel's angle */
static uint32_t parts(const struct ls_mirror_ball *ball, double texel_rad)
{
    double pixel_rad = 2 / ball->radius_px;
    return (uint32_t)fmax(1, ceil(texel_rad / (0.25 * pixel_rad)));
}

enum ls_err ls_mirror_ball_map(const struct ls_mirror_ball *ball, uint32_t width, uint32_t height,
                               float *map, uint8_t *filled, struct ls_mirror_ball_report *report,
                               struct ls_diag *diag)
{
    struct ls_mirror_ball_report unused;
    report = report ? report : &unused;
    *report = (struct ls_mirror_ball_report){0};
    if (width < 1 || height < 1 || width > 16384 || height > 16384)
        return ls_fail(diag, LS_ERR_INVALID, "mirror ball: a map of %u x %u: expected 1..16384",
                       width, height);
    LS_CLEANUP_FREE struct view *view = calloc(1, sizeof *view);
    if (!view)
        return ls_fail(diag, LS_ERR_NOMEM, "mirror ball: out of memory");
    view->ball = ball;
    enum ls_err err = check_geometry(ball, diag);
    if (!err)
        err = check_values(ball, diag);
    if (!err)
        err = make_axes(view, diag);
    if (err)
        return err;
    make_rim(view);
    const struct target target = {.width = width,
                                  .height = height,
                                  .down = parts(ball, M_PI / height),
                                  .across = parts(ball, 2 * M_PI / width),
                                  .map = map,
                                  .filled = filled};
    for (uint32_t y = 0; y < height; y++)
        for (uint32_t x = 0; x < width; x++)
            fill_texel(view, &target, x, y, report);
    return LS_OK;
}
