#include "clients/calibrate_take.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { MAX_PICTURES = 65536, FULL_LEVEL = 65535, MAX_WEIGHTS_BYTES = 1 << 28 };

void ls_calibrate_take_close(struct ls_calibrate_take *take)
{
    if (!take)
        return;
    for (uint32_t i = 0; i < take->n_pictures; i++)
        free(take->pictures[i].weights);
    free(take->pictures);
    ls_take_document_destroy(take->document);
    free(take);
}

static enum ls_err wrong(struct ls_diag *diag, const char *key)
{
    return ls_fail(diag, LS_ERR_INVALID, "take.json: %s is missing or not what this client knows",
                   key);
}

int ls_calibrate_channel(const struct ls_calibrate_take *take, const char *name)
{
    for (uint32_t c = 0; name && c < take->document->n_channels; c++)
        if (!strcmp(take->document->channels[c].name, name))
            return (int)c;
    return -1;
}

/* ---- plan ---- */

/* As a take names it that says what several lights are and not what they are called. */
static void name_pattern(const json_t *item, char *out, size_t size)
{
    const json_t *lights = json_object_get(item, "lights");
    const char *pattern = json_string_value(json_object_get(item, "pattern"));
    if (pattern || !lights)
        snprintf(out, size, "%s", pattern ? pattern : "sphere");
    else
        snprintf(out, size, "lights-%zu", json_array_size(lights));
}

/* Weights of a pattern: every light, or those listed, each at its level over the nominal one. */
static enum ls_err read_weights(struct ls_calibrate_take *take, const json_t *item, double level,
                                struct ls_lit_picture *out, struct ls_diag *diag)
{
    const json_t *lights = json_object_get(item, "lights"),
                 *levels = json_object_get(item, "levels");
    uint32_t n_lights = take->document->n_lights;
    if (json_array_size(lights) > n_lights)
        return wrong(diag, "plan.conditions.lights");
    take->weights_bytes += n_lights * sizeof *out->weights;
    if (take->weights_bytes > MAX_WEIGHTS_BYTES)
        return ls_fail(diag, LS_ERR_LIMIT, "take.json: too many pictures of several lights");
    out->weights = calloc(n_lights, sizeof *out->weights);
    if (!out->weights)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    for (uint32_t i = 0; !lights && i < n_lights; i++)
        out->weights[i] = 1;
    for (size_t k = 0; k < json_array_size(lights); k++) {
        json_int_t light = json_integer_value(json_array_get(lights, k));
        if (light < 0 || light >= n_lights)
            return wrong(diag, "plan.conditions.lights");
        out->weights[light] =
            levels ? (float)(json_number_value(json_array_get(levels, k)) / level) : 1;
    }
    return LS_OK;
}

static enum ls_err read_picture(struct ls_calibrate_take *take, const json_t *item,
                                struct ls_diag *diag)
{
    const char *id = json_string_value(json_object_get(item, "id"));
    const char *channel = json_string_value(json_object_get(item, "channel"));
    const char *pattern = json_string_value(json_object_get(item, "pattern"));
    const json_t *light = json_object_get(item, "light");
    double level = json_number_value(json_object_get(item, "level"));
    int index = ls_calibrate_channel(take, channel);
    if (!channel || json_is_true(json_object_get(item, "reference")))
        return LS_OK; /* a dark; or a sphere that only watches for drift */
    struct ls_lit_picture *out = &take->pictures[take->n_pictures];
    if (!id || strlen(id) >= sizeof out->id || index < 0 || !(level >= 1) || level > FULL_LEVEL)
        return wrong(diag, "plan.conditions");
    if (pattern && strlen(pattern) >= sizeof out->pattern)
        return wrong(diag, "plan.conditions.pattern");
    *out = (struct ls_lit_picture){.channel = (uint32_t)index, .duty = level / FULL_LEVEL};
    take->n_pictures++;
    snprintf(out->id, sizeof out->id, "%s", id);
    if (!light)
        name_pattern(item, out->pattern, sizeof out->pattern);
    out->light = light ? (int32_t)json_integer_value(light) : -1;
    if (light && (out->light < 0 || (uint32_t)out->light >= take->document->n_lights))
        return wrong(diag, "plan.conditions.light");
    return light ? LS_OK : read_weights(take, item, level, out, diag);
}

static enum ls_err read_plan(struct ls_calibrate_take *take, const json_t *doc,
                             struct ls_diag *diag)
{
    const json_t *list = json_object_get(json_object_get(doc, "plan"), "conditions");
    size_t n = json_array_size(list);
    if (n < 1 || n > MAX_PICTURES)
        return wrong(diag, "plan.conditions");
    take->pictures = calloc(n, sizeof *take->pictures);
    enum ls_err err = take->pictures ? LS_OK : ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    for (size_t i = 0; i < n && !err; i++)
        err = read_picture(take, json_array_get(list, i), diag);
    return err;
}

/* ---- camera ---- */

static double number(const json_t *item, const char *key)
{
    const json_t *value = json_object_get(item, key);
    return json_is_number(value) ? json_number_value(value) : NAN;
}

/* Of a dim pixel, where the whole bracket counts: var(E) = sigma^2 / sum t^2, and shot noise of E
 * adds E sum t^3 / (sum t^2)^2. */
static enum ls_err read_exposures(struct ls_calibrate_take *take, const json_t *doc,
                                  struct ls_diag *diag)
{
    const json_t *list = json_object_get(doc, "exposure_s");
    double t2 = 0, t3 = 0, shortest = INFINITY, full = take->full_scale_dn;
    double sigma2 = take->read_noise_dn * take->read_noise_dn + 1.0 / 12;
    for (size_t i = 0; i < json_array_size(list); i++) {
        double t = json_number_value(json_array_get(list, i));
        shortest = fmin(shortest, t);
        t2 += t * t;
        t3 += t * t * t;
    }
    if (!(shortest > 0) || !isfinite(t3))
        return wrong(diag, "exposure_s");
    take->noise = (struct ls_field_noise){.read_variance = sigma2 / (full * full * t2),
                                          .shot = t3 / (full * take->electrons_per_dn * t2 * t2)};
    return LS_OK;
}

static enum ls_err read_camera(struct ls_calibrate_take *take, const json_t *doc,
                               struct ls_diag *diag)
{
    const json_t *item =
        json_array_get(json_object_get(json_object_get(doc, "rig"), "cameras"), take->camera_row);
    const struct ls_take_document *d = take->document;
    const char *format = json_string_value(json_object_get(item, "pixel_format"));
    const json_t *range = json_object_get(item, "range"),
                 *sensor = json_object_get(item, "sensor_mm");
    double position[3], look_at[3];
    for (int k = 0; k < 3; k++) {
        position[k] = (double)d->camera.position_m[k];
        look_at[k] = (double)d->camera.look_at_m[k];
    }
    take->full_scale_dn = number(item, "full_scale_dn");
    take->black_dn = number(item, "black_dn");
    take->electrons_per_dn = number(item, "electrons_per_dn");
    take->read_noise_dn = number(item, "read_noise_dn");
    take->exposure_offset_us = number(item, "exposure_offset_us");
    take->range_low = json_number_value(json_array_get(range, 0));
    take->range_high = json_number_value(json_array_get(range, 1));
    if (!(take->full_scale_dn > 0) || !(take->electrons_per_dn > 0) ||
        !(take->read_noise_dn >= 0) || !(take->black_dn >= 0) || !(take->range_high > 0) ||
        isnan(take->exposure_offset_us) || !format)
        return wrong(diag, "rig.cameras");
    snprintf(take->pixel_format, sizeof take->pixel_format, "%s", format);
    snprintf(take->cfa, sizeof take->cfa, "%s", d->mono ? "mono" : ls_cfa_name(d->cfa));
    return ls_pinhole_aim(position, look_at, number(item, "focal_length_mm"),
                          json_number_value(json_array_get(sensor, 0)), d->width, d->height,
                          &take->camera, diag);
}

/* ---- opening ---- */

enum ls_err ls_calibrate_take_parse(struct ls_command_context *context, const char *id,
                                    const char *text, size_t n, uint32_t camera,
                                    struct ls_calibrate_take **out, struct ls_diag *diag)
{
    struct ls_calibrate_take *take = calloc(1, sizeof *take);
    if (!take)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    take->context = context;
    take->camera_row = camera;
    snprintf(take->id, sizeof take->id, "%s", id);
    json_t *doc = json_loadb(text, n, 0, NULL);
    enum ls_err err = ls_take_document_parse(text, n, camera, &take->document, diag);
    if (!err)
        err = read_camera(take, doc, diag);
    if (!err)
        err = read_exposures(take, doc, diag);
    if (!err)
        err = read_plan(take, doc, diag);
    json_decref(doc);
    if (err)
        ls_calibrate_take_close(take);
    else
        *out = take;
    return err;
}

enum ls_err ls_calibrate_take_open(struct ls_command_context *context, const char *id,
                                   uint32_t camera, struct ls_calibrate_take **out)
{
    char *text = NULL;
    enum ls_err err =
        ls_command_said(context, lightstage_take_show(context->stage, id, &text, &context->error));
    if (!err)
        err = ls_calibrate_take_parse(context, id, text, strlen(text), camera, out, &context->diag);
    lightstage_text_free(text);
    return err;
}

/* ---- looking up ---- */

const struct ls_lit_picture *ls_calibrate_find(const struct ls_calibrate_take *take,
                                               uint32_t channel, int32_t light, const char *pattern)
{
    for (uint32_t i = 0; i < take->n_pictures; i++) {
        const struct ls_lit_picture *p = &take->pictures[i];
        if (p->channel == channel &&
            (light >= 0 ? p->light == light : p->light < 0 && !strcmp(p->pattern, pattern)))
            return p;
    }
    return NULL;
}

struct ls_calibrate_region ls_calibrate_around(const struct ls_calibrate_take *take,
                                               const struct ls_outline *outline)
{
    enum { MARGIN = 8 };
    double r = outline->radius_px + MARGIN;
    double x0 = fmax(outline->x_px - r, 0), y0 = fmax(outline->y_px - r, 0);
    double x1 = fmin(outline->x_px + r, take->document->width);
    double y1 = fmin(outline->y_px + r, take->document->height);
    struct ls_calibrate_region out = {.x = (uint32_t)x0 & ~1u, .y = (uint32_t)y0 & ~1u};
    out.width = (uint32_t)ceil(fmax(x1, x0 + 2)) - out.x;
    out.height = (uint32_t)ceil(fmax(y1, y0 + 2)) - out.y;
    return out;
}
