#include "core/calibration.h"
#include "core/calibration_json.h"

#include <jansson.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* ---- spectral tables ---- */

/* @rows = 0: one row, `values` itself. */
static enum ls_err table(const json_t *value, const char *path, uint32_t rows,
                         struct ls_spectral_table *out, struct ls_diag *diag)
{
    char at[160], row_at[160];
    enum ls_err err;
    if (!json_is_object(value))
        return ls_json_wrong(diag, path, "an object", value);
    if ((err = ls_json_member(value, path, "start_nm", 1, 1e5, &out->start_nm, diag)) ||
        (err = ls_json_member(value, path, "step_nm", 1e-3, 1e4, &out->step_nm, diag)))
        return err;
    const json_t *values = json_object_get(value, "values");
    ls_json_child(at, path, "values");
    if (rows && (err = ls_json_array(values, at, rows, diag)))
        return err;
    const json_t *first = rows ? json_array_get(values, 0) : values;
    if ((err = ls_json_bounded(first, at, LS_CALIBRATION_MAX_SAMPLES, diag)))
        return err;
    if (json_array_size(first) < 2)
        return ls_fail(diag, LS_ERR_INVALID, "calibration: %s: expected at least 2 samples", at);
    out->n = (uint32_t)json_array_size(first);
    out->rows = rows ? rows : 1;
    out->v = calloc((size_t)out->n * out->rows, sizeof *out->v);
    if (!out->v)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for spectra");
    for (uint32_t r = 0; r < out->rows && !err; r++)
        err = ls_json_floats(rows ? json_array_get(values, r) : values,
                             rows ? ls_json_element(row_at, at, r) : at, out->n, -1e9, 1e9,
                             out->v + (size_t)r * out->n, diag);
    return err;
}

/* ---- lights, channels, per-light numbers ---- */

static enum ls_err lights(const json_t *root, struct ls_calibration *c, struct ls_diag *diag)
{
    const json_t *value = json_object_get(root, "lights");
    enum ls_err err = ls_json_vectors(json_object_get(value, "position_m"), "lights.position_m",
                                      c->n_lights, c->position_m, diag);
    if (!err)
        err = ls_json_directions(json_object_get(value, "direction"), "lights.direction",
                                 c->n_lights, c->direction, diag);
    if (!err)
        err = ls_json_floats(json_object_get(value, "omega_sr"), "lights.omega_sr", c->n_lights, 0,
                             12.6, c->omega_sr, diag);
    return err;
}

static enum ls_err channel(const json_t *value, uint32_t s, struct ls_calibration *c,
                           struct ls_diag *diag)
{
    char path[160], at[160], kind[16];
    ls_json_element(path, "channels", s);
    struct ls_calibration_channel *out = &c->channels[s];
    enum ls_err err;
    char name[sizeof out->name];
    if ((err = ls_json_string(json_object_get(value, "name"), ls_json_child(at, path, "name"),
                              sizeof name, name, diag)) ||
        (err = ls_json_string(json_object_get(value, "kind"), ls_json_child(at, path, "kind"),
                              sizeof kind, kind, diag)))
        return err;
    if (ls_calibration_channel(c, name) >= 0)
        return ls_fail(diag, LS_ERR_INVALID, "calibration: %s.name: \"%s\" stands twice", path,
                       name);
    memcpy(out->name, name, sizeof name);
    out->polariser = !strcmp(kind, "polariser");
    if (!out->polariser && strcmp(kind, "spectrum"))
        return ls_fail(diag, LS_ERR_INVALID,
                       "calibration: %s.kind: expected spectrum or polariser, found \"%s\"", path,
                       kind);
    const json_t *spectrum = json_object_get(value, "spectrum");
    return spectrum ? table(spectrum, ls_json_child(at, path, "spectrum"), 0, &out->spectrum, diag)
                    : LS_OK;
}

static enum ls_err channels(const json_t *root, struct ls_calibration *c, struct ls_diag *diag)
{
    const json_t *list = json_object_get(root, "channels");
    enum ls_err err = LS_OK;
    for (uint32_t s = 0; s < c->n_channels && !err; s++)
        err = channel(json_array_get(list, s), s, c, diag);
    return err;
}

static enum ls_err by_channel(const json_t *root, const char *key, struct ls_calibration *c,
                              size_t n, double low, double high, float *out, size_t stride,
                              struct ls_diag *diag)
{
    char at[160];
    const json_t *object = json_object_get(root, key);
    enum ls_err err =
        json_is_object(object) ? LS_OK : ls_json_wrong(diag, key, "an object", object);
    for (uint32_t s = 0; s < c->n_channels && !err; s++) {
        const char *name = c->channels[s].name;
        err = ls_json_floats(json_object_get(object, name), ls_json_child(at, key, name), n, low,
                             high, out + s * stride, diag);
    }
    return err;
}

/* ---- patterns ---- */

static enum ls_err pattern(const json_t *value, uint32_t i, const struct ls_calibration *c,
                           struct ls_calibration_pattern *out, struct ls_diag *diag)
{
    char path[160], at[160], name[16];
    ls_json_element(path, "pattern_factors", i);
    enum ls_err err;
    if ((err = ls_json_string(json_object_get(value, "channel"), ls_json_child(at, path, "channel"),
                              sizeof name, name, diag)) ||
        (err = ls_json_string(json_object_get(value, "pattern"), ls_json_child(at, path, "pattern"),
                              sizeof out->pattern, out->pattern, diag)) ||
        (err = ls_json_member(value, path, "duty", 1e-6, 1, &out->duty, diag)) ||
        (err = ls_json_member(value, path, "factor", 1e-3, 1e3, &out->factor, diag)))
        return err;
    int s = ls_calibration_channel(c, name);
    if (s < 0)
        return ls_fail(diag, LS_ERR_INVALID,
                       "calibration: %s.channel: \"%s\" is none of the channels", path, name);
    out->channel = (uint32_t)s;
    return json_object_get(value, "sigma")
               ? ls_json_member(value, path, "sigma", 0, 1e3, &out->sigma, diag)
               : LS_OK;
}

static enum ls_err patterns(const json_t *root, struct ls_calibration *c, struct ls_diag *diag)
{
    const json_t *list = json_object_get(root, "pattern_factors");
    enum ls_err err = ls_json_bounded(list, "pattern_factors", LS_CALIBRATION_MAX_PATTERNS, diag);
    if (err)
        return err;
    uint32_t n = (uint32_t)json_array_size(list);
    c->patterns = calloc(n + 1, sizeof *c->patterns);
    if (!c->patterns)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for pattern factors");
    c->n_patterns = n;
    for (uint32_t i = 0; i < n && !err; i++)
        err = pattern(json_array_get(list, i), i, c, &c->patterns[i], diag);
    return err;
}

/* ---- chart ---- */

static enum ls_err chart(const json_t *root, struct ls_calibration *c, struct ls_diag *diag)
{
    char at[160];
    const json_t *value = json_object_get(root, "chart");
    if (!value)
        return LS_OK;
    const json_t *names = json_object_get(value, "names");
    enum ls_err err = ls_json_bounded(names, "chart.names", LS_CALIBRATION_MAX_PATCHES, diag);
    if (err)
        return err;
    if (!json_array_size(names))
        return ls_fail(diag, LS_ERR_INVALID, "calibration: chart.names: expected at least one");
    c->n_patches = (uint32_t)json_array_size(names);
    c->patch_names = calloc(c->n_patches, sizeof *c->patch_names);
    if (!c->patch_names)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for chart names");
    for (uint32_t i = 0; i < c->n_patches && !err; i++)
        err = ls_json_string(json_array_get(names, i), ls_json_element(at, "chart.names", i),
                             sizeof *c->patch_names, c->patch_names[i], diag);
    if (!err)
        err = table(json_object_get(value, "reflectance"), "chart.reflectance", c->n_patches,
                    &c->reflectance, diag);
    return err;
}

static enum ls_err chart_light(const json_t *root, struct ls_calibration *c, struct ls_diag *diag)
{
    char patch_at[160], at[160];
    const json_t *value = json_object_get(root, "L");
    if (!value)
        return LS_OK;
    if (!c->n_patches)
        return ls_fail(diag, LS_ERR_INVALID, "calibration: L: there is no chart");
    enum ls_err err = ls_json_array(value, "L", c->n_patches, diag);
    if (err)
        return err;
    c->L = calloc((size_t)c->n_patches * c->n_colours * c->n_channels, sizeof *c->L);
    if (!c->L)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for L");
    for (uint32_t p = 0; p < c->n_patches && !err; p++) {
        const json_t *rows = json_array_get(value, p);
        err = ls_json_array(rows, ls_json_element(patch_at, "L", p), c->n_colours, diag);
        for (uint32_t k = 0; k < c->n_colours && !err; k++)
            err = ls_json_floats(json_array_get(rows, k), ls_json_element(at, patch_at, k),
                                 c->n_channels, -1e6, 1e6,
                                 c->L + (p * c->n_colours + k) * c->n_channels, diag);
    }
    return err;
}

/* ---- camera ---- */

static enum ls_err hot_pixels(const json_t *value, struct ls_calibration_camera *camera,
                              struct ls_diag *diag)
{
    char path[160], at[160];
    enum ls_err err = ls_json_bounded(value, "camera.hot_pixels", LS_CALIBRATION_MAX_HOT, diag);
    if (err)
        return err;
    uint32_t n = (uint32_t)json_array_size(value);
    camera->hot = calloc((size_t)n + 1, sizeof *camera->hot);
    if (!camera->hot)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for hot pixels");
    camera->n_hot = n;
    for (uint32_t i = 0; i < n && !err; i++) {
        const json_t *pair = json_array_get(value, i);
        err = ls_json_array(pair, ls_json_element(path, "camera.hot_pixels", i), 2, diag);
        for (uint32_t k = 0; k < 2 && !err; k++) {
            double x = 0;
            err = ls_json_number(json_array_get(pair, k), ls_json_element(at, path, k), 0, 1e6, &x,
                                 diag);
            if (!err && x != floor(x))
                err = ls_fail(diag, LS_ERR_INVALID, "calibration: %s: expected a whole number", at);
            camera->hot[i][k] = (uint32_t)x;
        }
    }
    return err;
}

static enum ls_err constants(const json_t *value, struct ls_calibration_camera *camera,
                             struct ls_diag *diag)
{
    const struct {
        const char *key;
        double low, high, *out;
    } numbers[] = {
        {"full_scale_dn", 1, 65535, &camera->full_scale_dn},
        {"black_dn", 0, 65535, &camera->black_dn},
        {"electrons_per_dn", 1e-6, 1e6, &camera->electrons_per_dn},
        {"read_noise_dn", 0, 65535, &camera->read_noise_dn},
        {"exposure_offset_us", -1e6, 1e6, &camera->exposure_offset_us},
    };
    enum ls_err err = LS_OK;
    for (size_t i = 0; i < sizeof numbers / sizeof *numbers && !err; i++)
        err = ls_json_member(value, "camera", numbers[i].key, numbers[i].low, numbers[i].high,
                             numbers[i].out, diag);
    return err;
}

static enum ls_err range(const json_t *value, struct ls_calibration_camera *camera,
                         struct ls_diag *diag)
{
    float r[2] = {0};
    enum ls_err err =
        ls_json_floats(json_object_get(value, "range"), "camera.range", 2, 0, 1, r, diag);
    if (!err && !(r[0] < r[1]))
        err = ls_fail(diag, LS_ERR_INVALID, "calibration: camera.range: expected low < high");
    camera->range_low = r[0];
    camera->range_high = r[1];
    return err;
}

static enum ls_err filter(const json_t *value, const struct ls_calibration *c,
                          struct ls_calibration_camera *camera, struct ls_diag *diag)
{
    static const char *const known[] = {"mono", "RG", "GR", "GB", "BG"};
    enum ls_err err = ls_json_string(json_object_get(value, "cfa"), "camera.cfa",
                                     sizeof camera->cfa, camera->cfa, diag);
    if (err)
        return err;
    for (size_t i = 0; i < sizeof known / sizeof *known; i++)
        if (!strcmp(camera->cfa, known[i]) && (i == 0) == (c->n_colours == 1))
            return LS_OK;
    return ls_fail(diag, LS_ERR_INVALID,
                   "calibration: camera.cfa: expected %s for %u colours per p, found \"%s\"",
                   c->n_colours == 1 ? "mono" : "RG, GR, GB or BG", c->n_colours, camera->cfa);
}

static enum ls_err camera(const json_t *root, struct ls_calibration *c, struct ls_diag *diag)
{
    const json_t *value = json_object_get(root, "camera");
    struct ls_calibration_camera *out = &c->camera;
    if (!json_is_object(value))
        return ls_json_wrong(diag, "camera", "an object", value);
    enum ls_err err = constants(value, out, diag);
    if (!err)
        err = range(value, out, diag);
    if (!err)
        err = filter(value, c, out, diag);
    if (!err)
        err = ls_json_string(json_object_get(value, "pixel_format"), "camera.pixel_format",
                             sizeof out->pixel_format, out->pixel_format, diag);
    if (!err)
        err = hot_pixels(json_object_get(value, "hot_pixels"), out, diag);
    const json_t *sensitivities = json_object_get(value, "sensitivities");
    if (!err && sensitivities)
        err = table(sensitivities, "camera.sensitivities", c->n_colours, &out->sensitivity, diag);
    return err;
}

static enum ls_err matrix(const json_t *root, struct ls_calibration *c, struct ls_diag *diag)
{
    char at[160];
    const json_t *value = json_object_get(root, "M");
    if (!value)
        return LS_OK;
    enum ls_err err = ls_json_array(value, "M", 3, diag);
    for (uint32_t r = 0; r < 3 && !err; r++) {
        const json_t *row = json_array_get(value, r);
        err = ls_json_array(row, ls_json_element(at, "M", r), 3, diag);
        for (uint32_t k = 0; k < 3 && !err; k++)
            err = ls_json_number(json_array_get(row, k), at, -1e6, 1e6, &c->m[r][k], diag);
    }
    c->has_m = !err;
    return err;
}

/* ---- the whole ---- */

static enum ls_err sizes(const json_t *root, uint32_t *n_lights, uint32_t *n_channels,
                         uint32_t *n_colours, struct ls_diag *diag)
{
    double format = 0;
    enum ls_err err = ls_json_member(root, "", "format", -1e9, 1e9, &format, diag);
    if (err)
        return err;
    if (format != 1)
        return ls_fail(diag, LS_ERR_UNSUPPORTED,
                       "calibration: format: expected 1, found %g: written by another version?",
                       format);
    const json_t *where = json_object_get(json_object_get(root, "lights"), "position_m");
    const json_t *list = json_object_get(root, "channels");
    if ((err = ls_json_bounded(where, "lights.position_m", LS_CALIBRATION_MAX_LIGHTS, diag)) ||
        (err = ls_json_bounded(list, "channels", LS_CALIBRATION_MAX_CHANNELS, diag)))
        return err;
    const char *first = json_string_value(json_object_get(json_array_get(list, 0), "name"));
    const json_t *p = first ? json_object_get(json_object_get(root, "p"), first) : NULL;
    *n_lights = (uint32_t)json_array_size(where);
    *n_channels = (uint32_t)json_array_size(list);
    *n_colours = json_array_size(p) == 1 ? 1 : 3;
    if (!*n_lights || !*n_channels)
        return ls_fail(diag, LS_ERR_INVALID, "calibration: %s: expected at least one",
                       *n_lights ? "channels" : "lights.position_m");
    return LS_OK;
}

static enum ls_err fill(const json_t *root, struct ls_calibration *c, struct ls_diag *diag)
{
    enum ls_err err = channels(root, c, diag);
    if (!err)
        err = lights(root, c, diag);
    if (!err)
        err = by_channel(root, "k", c, c->n_lights, 1e-6, 1e6, c->k, c->n_lights, diag);
    if (!err)
        err = by_channel(root, "sigma_k", c, c->n_lights, 0, 1e6, c->sigma_k, c->n_lights, diag);
    if (!err)
        err = by_channel(root, "p", c, c->n_colours, 0, 1e6, c->p[0], 3, diag);
    if (!err)
        err = patterns(root, c, diag);
    if (!err)
        err = ls_json_member(root, "", "scale", 1e-30, 1e30, &c->scale, diag);
    if (!err)
        err = chart(root, c, diag);
    if (!err)
        err = chart_light(root, c, diag);
    if (!err)
        err = camera(root, c, diag);
    if (!err)
        err = matrix(root, c, diag);
    if (!err)
        err = ls_calibration_parse_optional(root, c, diag);
    return err;
}

enum ls_err ls_calibration_parse(const char *text, size_t size, struct ls_calibration **out,
                                 struct ls_diag *diag)
{
    json_error_t where;
    uint32_t n_lights = 0, n_channels = 0, n_colours = 0;
    json_t *root = json_loadb(text, size, JSON_REJECT_DUPLICATES, &where);
    if (!root)
        return ls_fail(diag, LS_ERR_INVALID, "calibration: line %d: %.200s", where.line,
                       where.text);
    struct ls_calibration *c = NULL;
    enum ls_err err = sizes(root, &n_lights, &n_channels, &n_colours, diag);
    if (!err)
        err = ls_calibration_create(n_lights, n_channels, n_colours, &c, diag);
    if (!err)
        err = fill(root, c, diag);
    json_decref(root);
    if (err)
        ls_calibration_destroy(c);
    else
        *out = c;
    return err;
}
