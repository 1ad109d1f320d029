#include "sim/truth.h"

#include "core/segments.h"
#include "core/solve.h"
#include "sim/world.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { SEGMENTS = 14 }; /* what a calibration usually photographs */

static const char *const patch_names[SIM_CHART_PATCHES] = {
    "dark skin", "light skin",    "blue sky",     "foliage",   "blue flower",  "bluish green",
    "orange",    "purplish blue", "moderate red", "purple",    "yellow green", "orange yellow",
    "blue",      "green",         "red",          "yellow",    "magenta",      "cyan",
    "white",     "neutral 8",     "neutral 6.5",  "neutral 5", "neutral 3.5",  "black"};

/* ---- samples ---- */

/* Where the corners of a flat surface's middle part land, @edge of its size off its edges. */
static void project(const struct sim_scene *scene, uint32_t camera, uint16_t surface, double edge,
                    double x[4], double y[4])
{
    const struct sim_surface *s = &scene->subject.surface[surface];
    for (int k = 0; k < 4; k++) {
        double u = s->u0 + (s->u1 - s->u0) * (k & 1 ? 1 - edge : edge);
        double v = s->v0 + (s->v1 - s->v0) * (k & 2 ? 1 - edge : edge);
        struct sim_vec point, normal;
        sim_body_point(&scene->subject.body[s->body], s->part, u, v, &point, &normal);
        sim_view_project(&scene->view[camera], point, &x[k], &y[k]);
    }
}

/* Keep [@low, @high] @reach off the surface's edges; without room there, the middle pixel. */
static void keep_off(double *low, double *high, double first, double last, uint32_t reach)
{
    double middle = floor((first + last) / 2);
    *low = fmax(*low, first + reach);
    *high = fmin(*high, last - reach);
    if (reach && ceil(*low) >= floor(*high)) {
        *low = middle;
        *high = middle + 1;
    }
}

/* The rectangle of pixels inside the middle part of a flat surface that see it alone. */
static void frame(const struct sim_scene *scene, uint32_t camera, uint16_t surface,
                  struct sim_sample *out)
{
    const struct sim_view *view = &scene->view[camera];
    double x[4], y[4], rim_x[4], rim_y[4];
    project(scene, camera, surface, 0.2, x, y);
    project(scene, camera, surface, 0, rim_x, rim_y);
    double left = fmax(x[0], x[2]), right = fmin(x[1], x[3]);
    double top = fmax(y[2], y[3]), bottom = fmin(y[0], y[1]);
    keep_off(&left, &right, fmax(rim_x[0], rim_x[2]), fmin(rim_x[1], rim_x[3]), view->blur.reach);
    keep_off(&top, &bottom, fmax(rim_y[2], rim_y[3]), fmin(rim_y[0], rim_y[1]), view->blur.reach);
    double last_x = view->width - 1.0, last_y = view->height - 1.0;
    out->x = (uint32_t)fmax(0, fmin(last_x, ceil(left)));
    out->y = (uint32_t)fmax(0, fmin(last_y, ceil(top)));
    out->width = (uint32_t)fmax(1, fmin(last_x + 1, floor(right)) - out->x);
    out->height = (uint32_t)fmax(1, fmin(last_y + 1, floor(bottom)) - out->y);
}

enum ls_err sim_truth_samples(const struct sim_scene *scene, uint32_t camera,
                              struct sim_sample *out, struct ls_diag *diag)
{
    const struct sim_subject *s = &scene->subject;
    if (s->chart == SIM_NO_SURFACE)
        return ls_fail(diag, LS_ERR_UNSUPPORTED, "scene %s has no samples", scene->config.scene);
    if (camera >= scene->config.n_cameras)
        return ls_fail(diag, LS_ERR_INVALID, "camera %u: the scene has %u", camera,
                       scene->config.n_cameras);
    memset(out, 0, SIM_SAMPLES * sizeof *out);
    for (uint16_t k = 0; k < SIM_SAMPLES; k++) {
        uint16_t fabric = (uint16_t)(k - SIM_CHART_PATCHES);
        if (k < SIM_CHART_PATCHES) {
            frame(scene, camera, (uint16_t)(s->chart + k), &out[k]);
            snprintf(out[k].name, sizeof out[k].name, "%s", patch_names[k]);
            snprintf(out[k].group, sizeof out[k].group, "chart");
        } else if (fabric < SIM_FABRICS) {
            frame(scene, camera, (uint16_t)(s->fabrics + fabric), &out[k]);
            snprintf(out[k].name, sizeof out[k].name, "fabric %d", fabric + 1);
            snprintf(out[k].group, sizeof out[k].group, "fabric");
        } else {
            frame(scene, camera, s->velvet, &out[k]);
            snprintf(out[k].name, sizeof out[k].name, "velvet");
            snprintf(out[k].group, sizeof out[k].group, "velvet");
        }
    }
    return LS_OK;
}

/* ---- calibration ---- */

static enum ls_err fill_table(const struct ls_spectrum *const *rows, uint32_t n,
                              struct ls_spectral_table *out)
{
    *out = (struct ls_spectral_table){
        .start_nm = LS_SPECTRUM_FIRST_NM, .step_nm = LS_SPECTRUM_STEP_NM, .rows = n};
    out->v = calloc((size_t)n * LS_SPECTRUM_N, sizeof *out->v);
    if (!out->v)
        return LS_ERR_NOMEM;
    out->n = LS_SPECTRUM_N;
    for (uint32_t r = 0; r < n; r++)
        for (int i = 0; i < LS_SPECTRUM_N; i++)
            out->v[r * LS_SPECTRUM_N + (uint32_t)i] = (float)rows[r]->v[i];
    return LS_OK;
}

static void fill_lights(const struct sim_scene *scene, struct ls_calibration *c)
{
    const struct sim_geometry *g = &scene->geometry;
    memcpy(c->position_m, g->position_m, g->n_lights * sizeof *g->position_m);
    memcpy(c->direction, g->direction, g->n_lights * sizeof *g->direction);
    memcpy(c->omega_sr, g->omega_sr, g->n_lights * sizeof *g->omega_sr);
    for (uint32_t s = 0; s < c->n_channels; s++)
        for (uint32_t i = 0; i < g->n_lights; i++)
            c->k[s * g->n_lights + i] = (float)(1 / sim_scene_gain(scene, i, s));
}

/* A polariser's spectrum as lit through: what reaches a depolariser and comes back, one half. */
static enum ls_err fill_channels(const struct sim_scene *scene, uint32_t camera,
                                 struct ls_calibration *c)
{
    const struct sim_response *r = &scene->response[camera];
    for (uint32_t s = 0; s < c->n_channels; s++) {
        struct ls_calibration_channel *out = &c->channels[s];
        struct ls_spectrum spectrum = scene->source[s].spectrum;
        const struct ls_spectrum *row = &spectrum;
        for (int i = 0; i < LS_SPECTRUM_N; i++)
            spectrum.v[i] *= r->diffuse[s];
        snprintf(out->name, sizeof out->name, "%s", scene->config.channels[s].name);
        out->polariser = scene->source[s].kind != SIM_CHANNEL_SPECTRUM;
        if (fill_table(&row, 1, &out->spectrum))
            return LS_ERR_NOMEM;
        for (uint32_t k = 0; k < c->n_colours; k++)
            c->p[s][k] = r->diffuse[s] * sim_response_of(r, s, k, SIM_MAT_FLAT);
    }
    return LS_OK;
}

static void add_pattern(const struct sim_scene *scene, const char *name, double n_lit, double duty,
                        struct ls_calibration *c)
{
    double driven = sim_scene_quantise(scene, duty);
    for (uint32_t s = 0; s < c->n_channels && driven > 0; s++) {
        struct ls_calibration_pattern *out = &c->patterns[c->n_patterns++];
        *out = (struct ls_calibration_pattern){.channel = s, .duty = duty};
        out->factor = duty * sim_scene_droop(scene, s, n_lit) / driven;
        snprintf(out->pattern, sizeof out->pattern, "%s", name);
    }
}

/* The level of a controller of 16 bits that is nearest below an even share of full, as a duty. */
static double share(uint32_t lights)
{
    return floor(65535.0 / lights) / 65535;
}

static enum ls_err fill_patterns(const struct sim_scene *scene, const double *duties, uint32_t n,
                                 struct ls_calibration *c)
{
    uint32_t lights = scene->geometry.n_lights, each = (lights + SEGMENTS - 1) / SEGMENTS;
    char segments[16];
    snprintf(segments, sizeof segments, "segments-%d", SEGMENTS);
    c->patterns = calloc(((size_t)n + 2) * c->n_channels, sizeof *c->patterns);
    if (!c->patterns)
        return LS_ERR_NOMEM;
    for (uint32_t d = 0; d < n; d++)
        add_pattern(scene, "sphere", lights, duties[d], c);
    if (lights >= SEGMENTS)
        add_pattern(scene, segments, (double)lights / SEGMENTS, share(each), c);
    if (lights >= LS_HEADLIGHT_LIGHTS)
        add_pattern(scene, "headlight", LS_HEADLIGHT_LIGHTS, share(LS_HEADLIGHT_LIGHTS), c);
    return LS_OK;
}

/* L of a Lambertian chart alone at the centre: what the virtual sphere's cells add up to. */
static enum ls_err fill_chart(const struct sim_scene *scene, uint32_t camera,
                              struct ls_calibration *c)
{
    const struct sim_response *r = &scene->response[camera];
    const struct ls_spectrum *rows[SIM_CHART_PATCHES];
    size_t n = (size_t)SIM_CHART_PATCHES * c->n_colours * c->n_channels;
    c->patch_names = calloc(SIM_CHART_PATCHES, sizeof *c->patch_names);
    c->L = calloc(n, sizeof *c->L);
    if (!c->patch_names || !c->L)
        return LS_ERR_NOMEM;
    c->n_patches = SIM_CHART_PATCHES;
    for (uint32_t p = 0; p < SIM_CHART_PATCHES; p++) {
        rows[p] = &scene->library.material[SIM_MAT_CHART + p];
        snprintf(c->patch_names[p], sizeof *c->patch_names, "%s", patch_names[p]);
        for (uint32_t k = 0; k < c->n_colours; k++)
            for (uint32_t s = 0; s < c->n_channels; s++)
                c->L[(p * c->n_colours + k) * c->n_channels + s] =
                    r->diffuse[s] * sim_response_of(r, s, k, SIM_MAT_CHART + p);
    }
    return fill_table(rows, SIM_CHART_PATCHES, &c->reflectance);
}

static enum ls_err fill_camera(const struct sim_scene *scene, uint32_t camera,
                               const struct ls_pixel_format *format, struct ls_calibration *c)
{
    const struct sim_view_config *v = &scene->config.views[camera];
    const struct sim_sensor *sensor = &scene->sensor[camera];
    struct ls_calibration_camera *out = &c->camera;
    uint32_t max_dn = ls_pixel_max_dn(format);
    const struct ls_spectrum *rows[3];
    for (uint32_t k = 0; k < c->n_colours; k++)
        rows[k] = &scene->camera[camera][k];
    out->black_dn = sim_sensor_black_dn(sensor, max_dn);
    out->full_scale_dn = max_dn;
    out->electrons_per_dn = v->full_well_e / max_dn;
    out->read_noise_dn = v->read_noise_e / out->electrons_per_dn;
    out->exposure_offset_us = v->exposure_offset_us;
    out->range_low = 0.10;
    out->range_high = 0.85;
    snprintf(out->cfa, sizeof out->cfa, "%s", v->cfa);
    snprintf(out->pixel_format, sizeof out->pixel_format, "%s", format->name);
    out->hot = calloc(sensor->n_hot + 1, sizeof *out->hot);
    if (!out->hot)
        return LS_ERR_NOMEM;
    out->n_hot = sensor->n_hot;
    memcpy(out->hot, sensor->hot, sensor->n_hot * sizeof *out->hot);
    c->scale = 1 / sim_world_rate(v);
    return fill_table(rows, c->n_colours, &out->sensitivity);
}

/* As the chrome ball shows it under white. */
static void fill_mirror(const struct sim_scene *scene, uint32_t camera, struct ls_calibration *c)
{
    const struct sim_response *r = &scene->response[camera];
    c->has_mirror = true;
    for (uint32_t k = 0; k < c->n_colours; k++)
        c->mirror_reflectivity[k] = (double)(sim_response_of(r, 0, k, SIM_MAT_CHROME) /
                                             sim_response_of(r, 0, k, SIM_MAT_FLAT));
}

/* Least squares over the chart in daylight: what the camera reads against linear Rec. 709. */
static enum ls_err fill_matrix(const struct sim_scene *scene, uint32_t camera,
                               struct ls_calibration *c, struct ls_diag *diag)
{
    struct ls_spectrum d65, rec709[3];
    double raw[SIM_CHART_PATCHES][3], wanted[SIM_CHART_PATCHES];
    enum ls_err err = ls_daylight(6503.616, &d65);
    ls_rec709_functionals(rec709);
    const struct ls_spectrum *sensitivity = scene->camera[camera];
    const struct ls_spectrum *material = &scene->library.material[SIM_MAT_CHART];
    double green = ls_spectrum_dot(&d65, &sensitivity[1]);
    double white = 0.2126 * ls_spectrum_dot(&d65, &rec709[0]) +
                   0.7152 * ls_spectrum_dot(&d65, &rec709[1]) +
                   0.0722 * ls_spectrum_dot(&d65, &rec709[2]);
    for (int p = 0; p < SIM_CHART_PATCHES; p++)
        for (int k = 0; k < 3; k++)
            raw[p][k] = ls_spectrum_dot3(&d65, &material[p], &sensitivity[k]) / green;
    struct ls_system system = {.rows = SIM_CHART_PATCHES, .cols = 3, .a = raw[0], .b = wanted};
    for (int r = 0; r < 3 && !err; r++) {
        for (int p = 0; p < SIM_CHART_PATCHES; p++)
            wanted[p] = ls_spectrum_dot3(&d65, &material[p], &rec709[r]) / white;
        err = ls_solve(&system, LS_SOLVE_LEAST_SQUARES, c->m[r], NULL, diag);
    }
    c->has_m = !err;
    return err;
}

static enum ls_err fill(const struct sim_scene *scene, uint32_t camera,
                        const struct ls_pixel_format *format, const double *duties,
                        uint32_t n_duties, struct ls_calibration *c, struct ls_diag *diag)
{
    fill_lights(scene, c);
    if (fill_channels(scene, camera, c) || fill_patterns(scene, duties, n_duties, c) ||
        fill_camera(scene, camera, format, c))
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for a calibration");
    if (scene->kind == SIM_WORLD_REPLAY)
        return LS_OK;
    fill_mirror(scene, camera, c);
    if (fill_chart(scene, camera, c))
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for a calibration");
    return c->n_colours == 3 ? fill_matrix(scene, camera, c, diag) : LS_OK;
}

enum ls_err sim_truth_calibration(const struct sim_scene *scene, uint32_t camera,
                                  const char *pixel_format, const double *duties, uint32_t n_duties,
                                  struct ls_calibration **out, struct ls_diag *diag)
{
    const struct ls_pixel_format *format = ls_pixel_by_name(pixel_format);
    if (camera >= scene->config.n_cameras)
        return ls_fail(diag, LS_ERR_INVALID, "camera %u: the scene has %u", camera,
                       scene->config.n_cameras);
    if (!format)
        return ls_fail(diag, LS_ERR_INVALID, "pixel format \"%s\" is unknown", pixel_format);
    struct ls_calibration *c = NULL;
    enum ls_err err = ls_calibration_create(scene->geometry.n_lights, scene->config.n_channels,
                                            scene->colours[camera], &c, diag);
    if (!err)
        err = fill(scene, camera, format, duties, n_duties, c, diag);
    if (err)
        ls_calibration_destroy(c);
    else
        *out = c;
    return err;
}
