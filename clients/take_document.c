#include "clients/take_document.h"

#include "core/envlights.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

void ls_take_document_destroy(struct ls_take_document *document)
{
    if (!document)
        return;
    ls_calibration_destroy(document->calibration);
    free(document->position_m);
    free(document->direction);
    free(document->omega_sr);
    free(document);
}

static enum ls_err wrong(struct ls_diag *diag, const char *key)
{
    return ls_fail(diag, LS_ERR_INVALID, "take.json: %s is missing or not what this client knows",
                   key);
}

static enum ls_err read_lights(struct ls_take_document *d, const json_t *rig, struct ls_diag *diag)
{
    const json_t *list = json_object_get(json_object_get(rig, "lights"), "position_m");
    size_t n = json_array_size(list);
    if (n < 1 || n > LS_DOCUMENT_LIGHTS)
        return wrong(diag, "rig.lights.position_m");
    d->position_m = calloc(n, sizeof *d->position_m);
    d->direction = calloc(n, sizeof *d->direction);
    d->omega_sr = calloc(n, sizeof *d->omega_sr);
    if (!d->position_m || !d->direction || !d->omega_sr)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    d->n_lights = (uint32_t)n;
    for (size_t i = 0; i < n; i++) {
        double p[3], length = 0;
        for (size_t a = 0; a < 3; a++) {
            p[a] = json_number_value(json_array_get(json_array_get(list, i), a));
            length += p[a] * p[a];
        }
        if (!(length > 0) || !isfinite(length))
            return wrong(diag, "rig.lights.position_m");
        for (size_t a = 0; a < 3; a++) {
            d->position_m[i][a] = (float)p[a];
            d->direction[i][a] = (float)(p[a] / sqrt(length));
        }
    }
    return ls_envlights_omega((const float(*)[3])d->direction, n, d->omega_sr, diag);
}

static enum ls_err read_channels(struct ls_take_document *d, const json_t *rig,
                                 struct ls_diag *diag)
{
    const json_t *list = json_object_get(rig, "channels");
    size_t n = json_array_size(list);
    if (n < 1 || n > LS_DOCUMENT_CHANNELS)
        return wrong(diag, "rig.channels");
    d->n_channels = (uint32_t)n;
    for (size_t i = 0; i < n; i++) {
        const json_t *item = json_array_get(list, i);
        const char *name = json_string_value(json_object_get(item, "name"));
        const char *kind = json_string_value(json_object_get(item, "kind"));
        if (!name || !kind || strlen(name) >= sizeof d->channels[i].name)
            return wrong(diag, "rig.channels");
        snprintf(d->channels[i].name, sizeof d->channels[i].name, "%s", name);
        d->channels[i].spectrum = strcmp(kind, "spectrum") == 0;
    }
    return LS_OK;
}

static bool is_headlight(const char *kind, const char *pattern)
{
    return strcmp(kind, "segment") == 0 && pattern && strncmp(pattern, "headlight", 9) == 0;
}

/* Part of a division of the dome, as the daemon counts them; other lists of lights belong to bases.
 */
static bool is_segment(const char *kind, const char *pattern)
{
    return strcmp(kind, "segment") == 0 && (!pattern || strncmp(pattern, "segments-", 9) == 0 ||
                                            strncmp(pattern, "lights-", 7) == 0);
}

/* Stands for each light. */
static bool is_multiplexed(const char *kind, const char *pattern)
{
    return strcmp(kind, "segment") == 0 && pattern && strcmp(pattern, "multiplex") == 0;
}

static void read_conditions(struct ls_take_document *d, const json_t *doc)
{
    const json_t *list = json_object_get(json_object_get(doc, "plan"), "conditions");
    size_t index;
    json_t *item;
    json_array_foreach(list, index, item)
    {
        const char *kind = json_string_value(json_object_get(item, "kind"));
        const char *channel = json_string_value(json_object_get(item, "channel"));
        const char *pattern = json_string_value(json_object_get(item, "pattern"));
        for (uint32_t c = 0; kind && channel && c < d->n_channels; c++) {
            if (strcmp(d->channels[c].name, channel) != 0)
                continue;
            bool one = strcmp(kind, "one") == 0;
            d->channels[c].each |= one || is_multiplexed(kind, pattern);
            if (one)
                d->channels[c].duty =
                    (float)json_integer_value(json_object_get(item, "level")) / 65535;
            d->channels[c].sphere |=
                strcmp(kind, "sphere") == 0 && !json_is_true(json_object_get(item, "reference"));
            d->channels[c].headlight |= is_headlight(kind, pattern);
            d->channels[c].segments |= is_segment(kind, pattern);
        }
    }
}

static void copy_text(const json_t *item, const char *key, char out[64])
{
    const char *text = json_string_value(json_object_get(item, key));
    snprintf(out, 64, "%s", text ? text : "");
}

static void copy_vector(const json_t *item, const char *key, float out[3])
{
    for (size_t a = 0; a < 3; a++)
        out[a] = (float)json_number_value(json_array_get(json_object_get(item, key), a));
}

/* take.json has ISO 8601; OpenEXR's capDate has colons and a space. */
static void copy_date(const json_t *doc, char out[40])
{
    const char *utc = json_string_value(json_object_get(doc, "utc"));
    int v[6];
    if (utc &&
        sscanf(utc, "%4d-%2d-%2dT%2d:%2d:%2d", &v[0], &v[1], &v[2], &v[3], &v[4], &v[5]) == 6)
        snprintf(out, 40, "%04d:%02d:%02d %02d:%02d:%02d", v[0], v[1], v[2], v[3], v[4], v[5]);
}

static enum ls_err read_camera(struct ls_take_document *d, const json_t *rig, uint32_t camera,
                               struct ls_diag *diag)
{
    const json_t *cameras = json_object_get(rig, "cameras");
    const json_t *item = json_array_get(cameras, camera);
    size_t n = json_array_size(cameras);
    if (n > 0 && camera >= n)
        return ls_fail(diag, LS_ERR_INVALID, "camera %u: the take has cameras 0 to %zu", camera,
                       n - 1);
    const char *name = json_string_value(json_object_get(item, "pixel_format"));
    const struct ls_pixel_format *format = name ? ls_pixel_by_name(name) : NULL;
    if (!format)
        return wrong(diag, "rig.cameras.pixel_format");
    copy_text(item, "vendor", d->camera.vendor);
    copy_text(item, "model", d->camera.model);
    copy_text(item, "serial", d->camera.serial);
    copy_text(item, "lens", d->camera.lens);
    d->camera.aperture = (float)json_number_value(json_object_get(item, "aperture"));
    d->camera.iso_speed = (float)json_number_value(json_object_get(item, "iso_speed"));
    copy_vector(item, "position_m", d->camera.position_m);
    copy_vector(item, "look_at_m", d->camera.look_at_m);
    d->cfa = format->cfa;
    d->mono = format->cfa == LS_CFA_NONE;
    d->width = (uint32_t)json_integer_value(json_object_get(item, "width"));
    d->height = (uint32_t)json_integer_value(json_object_get(item, "height"));
    return LS_OK;
}

static enum ls_err read_calibration(struct ls_take_document *d, const json_t *doc,
                                    struct ls_diag *diag)
{
    const json_t *calibration = json_object_get(doc, "calibration");
    if (!json_is_object(calibration))
        return LS_OK;
    char *text = json_dumps(calibration, JSON_COMPACT | JSON_REAL_PRECISION(17));
    if (!text)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    enum ls_err err = ls_calibration_parse(text, strlen(text), &d->calibration, diag);
    free(text);
    if (!err && d->calibration->n_lights != d->n_lights)
        return wrong(diag, "calibration.lights");
    for (uint32_t i = 0; !err && i < d->n_lights; i++)
        d->omega_sr[i] = (double)d->calibration->omega_sr[i];
    return err;
}

static enum ls_err read_document(struct ls_take_document *d, const json_t *doc, uint32_t camera,
                                 struct ls_diag *diag)
{
    const json_t *rig = json_object_get(doc, "rig");
    d->reference_exposure_s = json_number_value(json_object_get(doc, "reference_exposure_s"));
    const json_t *exposures = json_object_get(doc, "exposure_s");
    d->longest_exposure_s =
        json_number_value(json_array_get(exposures, json_array_size(exposures) - 1));
    copy_date(doc, d->date);
    enum ls_err err = read_lights(d, rig, diag);
    if (!err)
        err = read_channels(d, rig, diag);
    if (!err)
        err = read_camera(d, rig, camera, diag);
    if (!err)
        err = read_calibration(d, doc, diag);
    read_conditions(d, doc);
    return err;
}

enum ls_err ls_take_document_parse(const char *text, size_t n, uint32_t camera,
                                   struct ls_take_document **out, struct ls_diag *diag)
{
    json_error_t error;
    json_t *doc = json_loadb(text, n, JSON_REJECT_DUPLICATES, &error);
    if (!doc)
        return ls_fail(diag, LS_ERR_INVALID, "take.json:%d: %s", error.line, error.text);
    struct ls_take_document *d = calloc(1, sizeof *d);
    enum ls_err err =
        d ? read_document(d, doc, camera, diag) : ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    json_decref(doc);
    if (err)
        ls_take_document_destroy(d);
    else
        *out = d;
    return err;
}

static uint32_t polariser_called(const struct ls_take_document *d, const char *name)
{
    uint32_t c = 0;
    while (c < d->n_channels && (d->channels[c].spectrum || strcmp(d->channels[c].name, name) != 0))
        c++;
    return c;
}

bool ls_take_document_polarisers(const struct ls_take_document *d, uint32_t *vertical,
                                 uint32_t *horizontal)
{
    uint32_t found[LS_DOCUMENT_CHANNELS] = {0}, n = 0;
    for (uint32_t c = 0; c < d->n_channels; c++)
        if (!d->channels[c].spectrum)
            found[n++] = c;
    *vertical = polariser_called(d, "V");
    *horizontal = polariser_called(d, "H");
    if (*vertical == d->n_channels || *horizontal == d->n_channels) {
        *vertical = found[0];
        *horizontal = found[1];
    }
    return n >= 2;
}

int ls_take_document_get(struct ls_command_context *context, const char *take, uint32_t camera,
                         struct ls_take_document **out)
{
    char *text = NULL;
    int code = ls_command_open(context);
    if (!code)
        code = ls_command_answered(
            context, lightstage_take_show(context->stage, take, &text, &context->error));
    if (code)
        return code;
    enum ls_err err = ls_take_document_parse(text, strlen(text), camera, out, &context->diag);
    lightstage_text_free(text);
    if (err)
        return ls_command_failed(context, err);
    snprintf((*out)->id, sizeof(*out)->id, "%s", take);
    return LS_EXIT_OK;
}
