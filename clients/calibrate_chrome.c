#include "clients/calibrate_probe.h"

#include "core/chrome_ball.h"

#include <math.h>
#include <stdlib.h>

/* A mirror shows every light but those behind it; with less than this share it is none. */
static const double least_seen = 0.3;

struct work {
    const struct ls_calibrate_take *take;
    const struct ls_grey *grey;
    struct ls_sphere_view *view;
    double reflectance;
    struct ls_chrome *out;
    double sum2, shading2;
    uint32_t n_compared, n_shading;
    double *rho; /* [colour * n_lights + which], found */
    uint32_t n_rho[3];
    struct ls_diag why; /* the last highlight that was not found */
};

static double angle_deg(const double a[3], const double b[3])
{
    double cross[3] = {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2],
                       a[0] * b[1] - a[1] * b[0]};
    double dot = a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    return atan2(hypot(hypot(cross[0], cross[1]), cross[2]), dot) * 180 / M_PI;
}

static void compare(struct work *w, uint32_t light, const double direction[3])
{
    const float *v = w->take->document->direction[light];
    const double nominal[3] = {(double)v[0], (double)v[1], (double)v[2]};
    double off = angle_deg(direction, nominal);
    w->out->n_seen++;
    if (w->grey->flags[light])
        return; /* at the ball's rim, or behind it */
    w->sum2 += off * off;
    w->n_compared++;
    w->out->worst_deg = fmax(w->out->worst_deg, off);
    if (!(w->grey->sigma_direction_deg[light] > 0))
        return;
    off = angle_deg(direction, w->grey->direction[light]);
    w->shading2 += off * off;
    w->n_shading++;
}

static void add_reflectivity(struct work *w, uint32_t light, const double position[3],
                             const float *e, const uint8_t *validity)
{
    double strength[3], rho[3], sigma[3];
    ls_grey_strength(w->grey, light, w->grey->white, 0, strength);
    if (ls_chrome_reflectivity(w->view, position, e, validity, strength, w->reflectance, rho, sigma,
                               NULL))
        return;
    w->out->n_mirror++;
    for (uint32_t c = 0; c < w->grey->n_colours; c++)
        if (sigma[c] > 0 && isfinite(rho[c]))
            w->rho[c * w->grey->n_lights + w->n_rho[c]++] = rho[c];
}

static enum ls_err use_light(void *user, const struct ls_lit_picture *picture, const float *e,
                             const uint8_t *validity, struct ls_diag *diag)
{
    struct work *w = user;
    struct ls_highlight highlight;
    uint32_t light = (uint32_t)picture->light;
    const float *p = w->take->document->position_m[light];
    const double position[3] = {(double)p[0], (double)p[1], (double)p[2]};
    double distance = hypot(hypot(position[0], position[1]), position[2]);
    enum ls_err err = ls_chrome_highlight(w->view, e, distance, &highlight, &w->why);
    if (err == LS_ERR_NOT_FOUND)
        return LS_OK;
    if (err)
        return ls_fail(diag, err, "%s: %.300s", picture->id, w->why.text);
    compare(w, light, highlight.direction);
    add_reflectivity(w, light, position, e, validity);
    return LS_OK;
}

static int ascending(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* Of one light the mosaic samples a small highlight badly; the middle of many is what counts. */
static double middle(double *v, uint32_t n, double *spread)
{
    qsort(v, n, sizeof *v, ascending);
    *spread = n ? 0.5 * (v[n * 5 / 6] - v[n / 6]) : 0;
    return n ? v[n / 2] : 0;
}

static enum ls_err conclude(struct work *w)
{
    struct ls_chrome *out = w->out;
    uint32_t n = w->take->document->n_lights;
    if (out->n_seen < least_seen * n)
        return ls_fail(
            &w->take->context->diag, LS_ERR_NOT_FOUND,
            "only %u of %u lights show a highlight on what stands in the middle (%.200s): "
            "put the chrome ball there",
            out->n_seen, n, w->why.text);
    out->rms_deg = w->n_compared ? sqrt(w->sum2 / w->n_compared) : 0;
    out->shading_deg = w->n_shading ? sqrt(w->shading2 / w->n_shading) : 0;
    for (uint32_t c = 0; c < w->grey->n_colours; c++)
        out->reflectivity[c] = middle(w->rho + (size_t)c * n, w->n_rho[c], &out->spread[c]);
    return LS_OK;
}

enum ls_err ls_calibrate_chrome(const struct ls_calibrate_take *take, const struct ls_grey *grey,
                                double reflectance, struct ls_chrome *out)
{
    struct work w = {.take = take, .grey = grey, .reflectance = reflectance, .out = out};
    struct ls_diag *diag = &take->context->diag;
    uint32_t n = take->document->n_lights, white = grey->white;
    LS_CLEANUP_FREE const struct ls_lit_picture **lights = calloc(n, sizeof *lights);
    *out = (struct ls_chrome){0};
    if (!lights)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    for (uint32_t i = 0; i < n; i++) {
        lights[i] = ls_calibrate_find(take, white, (int32_t)i, NULL);
        if (!lights[i])
            return ls_fail(
                diag, LS_ERR_STATE,
                "take %s does not show every light of the rig in %s: photograph the chrome "
                "ball with kind \"each\"",
                take->id, take->document->channels[white].name);
    }
    LS_CLEANUP_FREE double *rho = calloc(3 * (size_t)n, sizeof *rho);
    w.rho = rho;
    if (!rho)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    enum ls_err err = ls_sphere_view_create(&take->camera, take->document->cfa,
                                            &grey->cameras[0].sphere, NULL, 0, &w.view, diag);
    if (!err)
        err = ls_calibrate_fetch(
            take, lights, n, ls_calibrate_around(take, &grey->cameras[0].outline), use_light, &w);
    if (!err)
        err = conclude(&w);
    ls_sphere_view_destroy(w.view);
    return err;
}
