#include "clients/calibrate_probe.h"

#include "core/merge.h"

#include <math.h>
#include <stdlib.h>

/* A highlight is found for every light but those behind the sphere. */
static const double least_measured = 0.3;
static const double most_sigma = 0.05; /* of a measured a: else the half vector says it better */

struct work {
    const struct ls_calibrate_take *take;
    const struct ls_grey *grey;
    struct ls_gloss *out;
    uint32_t vertical, horizontal;
    struct ls_calibrate_region region;
    float *v; /* of the region: the light's V picture, waiting for its H */
    float *h;
    uint8_t *on_ball;
    bool saturated;
    double model2;
    struct ls_diag why;
};

void ls_gloss_finish(struct ls_gloss *gloss)
{
    free(gloss->a_v);
    free(gloss->a_h);
    free(gloss->sigma);
    *gloss = (struct ls_gloss){0};
}

static bool hits(const struct ls_pinhole *camera, const struct ls_sphere *sphere, double x,
                 double y)
{
    double ray[3], along = 0, far2 = 0;
    ls_pinhole_ray(camera, x, y, ray);
    for (int k = 0; k < 3; k++) {
        double to = sphere->centre_m[k] - camera->eye_m[k];
        along += to * ray[k];
        far2 += to * to;
    }
    return far2 - along * along < sphere->radius_m * sphere->radius_m;
}

static void find_ball(struct work *w)
{
    for (uint32_t y = 0; y < w->region.height; y++)
        for (uint32_t x = 0; x < w->region.width; x++)
            w->on_ball[y * w->region.width + x] =
                hits(&w->take->camera, &w->grey->cameras[0].sphere, w->region.x + x + 0.5,
                     w->region.y + y + 0.5);
}

/* The region of a picture, gained. */
static void cut(struct work *w, const float *e, const uint8_t *validity, double k, float *out)
{
    uint32_t width = w->take->document->width;
    for (uint32_t y = 0; y < w->region.height; y++)
        for (uint32_t x = 0; x < w->region.width; x++) {
            size_t from = (size_t)(w->region.y + y) * width + w->region.x + x;
            size_t to = (size_t)y * w->region.width + x;
            out[to] = (float)(k * (double)e[from]);
            w->saturated |= w->on_ball[to] && validity[from] == LS_VALIDITY_SATURATED;
        }
}

/* What the half vector says of the light: on a middling subject, and where this ball shows it. */
static enum ls_err model(const struct work *w, uint32_t light, struct ls_polarisation *assumed,
                         struct ls_polarisation *ball, struct ls_diag *diag)
{
    const float *p = w->take->document->position_m[light];
    struct ls_polarisation_path path;
    double point[3];
    for (int k = 0; k < 3; k++) {
        path.light[k] = (double)p[k];
        path.camera[k] = w->take->camera.eye_m[k];
        path.camera_up[k] = w->take->camera.up[k];
    }
    enum ls_err err = ls_polarisation_assume(&path, assumed, diag);
    if (!err)
        err = ls_polarisation_highlight(&path, w->grey->cameras[0].sphere.radius_m, point, diag);
    return err ? err : ls_polarisation_reflect(&path, point, LS_POLARISATION_INDEX, ball, diag);
}

static bool measure(struct work *w, uint32_t light, struct ls_polarisation_measured *out)
{
    double k =
        0.5 * (w->grey->gains[w->vertical].k[light] + w->grey->gains[w->horizontal].k[light]);
    struct ls_field_noise noise = w->take->noise;
    noise.read_variance *= k * k;
    noise.shot *= k;
    const struct ls_polarisation_probe probe = {.v = w->v,
                                                .h = w->h,
                                                .on_ball = w->on_ball,
                                                .width = w->region.width,
                                                .height = w->region.height,
                                                .noise = noise};
    if (w->saturated)
        return false;
    return !ls_polarisation_measure(&probe, out, &w->why) && out->sigma < most_sigma;
}

static enum ls_err conclude_light(struct work *w, uint32_t light, struct ls_diag *diag)
{
    struct ls_gloss *out = w->out;
    struct ls_polarisation a, ball;
    struct ls_polarisation_measured measured;
    enum ls_err err = model(w, light, &a, &ball, diag);
    if (err)
        return err;
    out->n_saturated += w->saturated;
    if (measure(w, light, &measured)) {
        w->model2 += (measured.a.v - ball.v) * (measured.a.v - ball.v);
        a = measured.a;
        out->sigma[light] = measured.sigma;
        out->n_measured++;
    }
    out->a_v[light] = a.v;
    out->a_h[light] = a.h;
    out->n_inseparable += !ls_polarisation_separable(a);
    return LS_OK;
}

static enum ls_err use_picture(void *user, const struct ls_lit_picture *picture, const float *e,
                               const uint8_t *validity, struct ls_diag *diag)
{
    struct work *w = user;
    uint32_t light = (uint32_t)picture->light;
    if (picture->channel == w->vertical) {
        w->saturated = false;
        cut(w, e, validity, w->grey->gains[w->vertical].k[light], w->v);
        return LS_OK;
    }
    cut(w, e, validity, w->grey->gains[w->horizontal].k[light], w->h);
    return conclude_light(w, light, diag);
}

static enum ls_err conclude(struct work *w)
{
    struct ls_gloss *out = w->out;
    struct ls_diag *diag = &w->take->context->diag;
    if (out->n_measured < least_measured * out->n_lights && out->n_saturated * 2 > out->n_lights)
        return ls_fail(
            diag, LS_ERR_NOT_FOUND,
            "the highlights of %u of %u lights are saturated even in the shortest exposure: "
            "use shorter exposures",
            out->n_saturated, out->n_lights);
    if (out->n_measured < least_measured * out->n_lights)
        return ls_fail(
            diag, LS_ERR_NOT_FOUND,
            "only %u of %u lights show a highlight on what stands in the middle (%.200s): "
            "put the black glossy sphere there",
            out->n_measured, out->n_lights, w->why.text);
    out->model_rms = sqrt(w->model2 / out->n_measured);
    return LS_OK;
}

static enum ls_err choose(struct work *w, const struct ls_lit_picture **pictures)
{
    struct ls_diag *diag = &w->take->context->diag;
    if (!ls_take_document_polarisers(w->take->document, &w->vertical, &w->horizontal))
        return ls_fail(
            diag, LS_ERR_STATE,
            "the rig has no vertical and horizontal polariser: leave the black sphere out");
    for (uint32_t i = 0; i < w->out->n_lights; i++) {
        pictures[2 * i] = ls_calibrate_find(w->take, w->vertical, (int32_t)i, NULL);
        pictures[2 * i + 1] = ls_calibrate_find(w->take, w->horizontal, (int32_t)i, NULL);
        if (!pictures[2 * i] || !pictures[2 * i + 1])
            return ls_fail(diag, LS_ERR_STATE,
                           "take %s does not show every light of the rig in both polarisations: "
                           "photograph the black sphere with kind \"each\"",
                           w->take->id);
    }
    return LS_OK;
}

static enum ls_err run(struct work *w, const struct ls_lit_picture **pictures)
{
    size_t px = (size_t)w->region.width * w->region.height;
    w->v = calloc(px, sizeof *w->v);
    w->h = calloc(px, sizeof *w->h);
    w->on_ball = calloc(px, 1);
    if (!w->v || !w->h || !w->on_ball)
        return ls_fail(&w->take->context->diag, LS_ERR_NOMEM, "out of memory");
    find_ball(w);
    enum ls_err err =
        ls_calibrate_fetch(w->take, pictures, 2 * w->out->n_lights, w->region, use_picture, w);
    return err ? err : conclude(w);
}

enum ls_err ls_calibrate_gloss(const struct ls_calibrate_take *take, const struct ls_grey *grey,
                               struct ls_gloss *out)
{
    uint32_t n = take->document->n_lights;
    struct work w = {.take = take, .grey = grey, .out = out};
    LS_CLEANUP_FREE const struct ls_lit_picture **pictures =
        calloc(2 * (size_t)n, sizeof *pictures);
    *out = (struct ls_gloss){.n_lights = n,
                             .a_v = calloc(n, sizeof *out->a_v),
                             .a_h = calloc(n, sizeof *out->a_h),
                             .sigma = calloc(n, sizeof *out->sigma)};
    if (!pictures || !out->a_v || !out->a_h || !out->sigma)
        return ls_fail(&take->context->diag, LS_ERR_NOMEM, "out of memory");
    w.region = ls_calibrate_around(take, &grey->cameras[0].outline);
    enum ls_err err = choose(&w, pictures);
    if (!err)
        err = run(&w, pictures);
    free(w.v);
    free(w.h);
    free(w.on_ball);
    return err;
}
