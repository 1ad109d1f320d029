#include "daemon/take_facts.h"

#include <jansson.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { MAX_CONDITIONS = 65536, FULL_LEVEL = 65535 };

int ls_take_facts_channel(const struct ls_take_facts *facts, const char *name)
{
    for (uint32_t i = 0; i < facts->n_channels; i++)
        if (strcmp(facts->channels[i].name, name) == 0)
            return (int)i;
    return -1;
}

void ls_take_facts_destroy(struct ls_take_facts *facts)
{
    if (!facts)
        return;
    ls_calibration_destroy(facts->calibration);
    for (uint32_t i = 0; i < facts->n_conditions; i++)
        free(facts->conditions[i].lights);
    free(facts->position_m);
    free(facts->conditions);
    free(facts);
}

static enum ls_err wrong(struct ls_diag *diag, const char *key, const char *expected)
{
    return ls_fail(diag, LS_ERR_INVALID, "take.json: %s: expected %s", key, expected);
}

static enum ls_err read_positions(struct ls_take_facts *facts, const json_t *rig,
                                  struct ls_diag *diag)
{
    const json_t *list = json_object_get(json_object_get(rig, "lights"), "position_m");
    size_t n = json_array_size(list);
    if (n < 1 || n > LS_MAX_LIGHTS)
        return wrong(diag, "rig.lights.position_m", "1 to 4096 positions");
    facts->position_m = calloc(n, sizeof *facts->position_m);
    if (!facts->position_m)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    facts->n_lights = (uint32_t)n;
    for (size_t i = 0; i < n; i++)
        for (size_t a = 0; a < 3; a++) {
            const json_t *v = json_array_get(json_array_get(list, i), a);
            facts->position_m[i][a] = (float)json_number_value(v);
            if (!json_is_number(v) || !isfinite(facts->position_m[i][a]))
                return wrong(diag, "rig.lights.position_m", "three numbers per light");
        }
    return LS_OK;
}

static enum ls_err read_channels(struct ls_take_facts *facts, const json_t *rig,
                                 struct ls_diag *diag)
{
    const json_t *list = json_object_get(rig, "channels");
    size_t n = json_array_size(list);
    if (n < 1 || n > LS_MAX_CHANNELS)
        return wrong(diag, "rig.channels", "1 to 16 channels");
    facts->n_channels = (uint32_t)n;
    for (size_t i = 0; i < n; i++) {
        const json_t *item = json_array_get(list, i);
        const char *name = json_string_value(json_object_get(item, "name"));
        const char *kind = json_string_value(json_object_get(item, "kind"));
        if (!name || strlen(name) >= sizeof facts->channels[i].name || !kind)
            return wrong(diag, "rig.channels", "name and kind of each");
        snprintf(facts->channels[i].name, sizeof facts->channels[i].name, "%s", name);
        facts->channels[i].polariser = strcmp(kind, "polariser") == 0;
    }
    return LS_OK;
}

static double number_or_nan(const json_t *value)
{
    return json_is_number(value) ? json_number_value(value) : NAN;
}

static enum ls_err read_camera(struct ls_take_facts *facts, const json_t *rig, uint32_t camera,
                               struct ls_diag *diag)
{
    const json_t *item = json_array_get(json_object_get(rig, "cameras"), camera);
    if (!item)
        return ls_fail(diag, LS_ERR_NOT_FOUND, "camera %u: the take has %zu", camera,
                       json_array_size(json_object_get(rig, "cameras")));
    const struct ls_pixel_format *format =
        ls_pixel_by_name(json_string_value(json_object_get(item, "pixel_format")));
    if (!format)
        return wrong(diag, "rig.cameras.pixel_format", "a GenICam name");
    for (size_t a = 0; a < 3; a++)
        facts->camera_position_m[a] =
            (float)json_number_value(json_array_get(json_object_get(item, "position_m"), a));
    facts->cfa = format->cfa;
    facts->full_scale_dn = json_number_value(json_object_get(item, "full_scale_dn"));
    facts->electrons_per_dn = json_number_value(json_object_get(item, "electrons_per_dn"));
    facts->read_noise_dn = json_number_value(json_object_get(item, "read_noise_dn"));
    facts->black_dn = number_or_nan(json_object_get(item, "black_dn"));
    facts->range_low = number_or_nan(json_array_get(json_object_get(item, "range"), 0));
    facts->range_high = number_or_nan(json_array_get(json_object_get(item, "range"), 1));
    if (!(facts->full_scale_dn > 0) || !(facts->electrons_per_dn > 0) ||
        !(facts->read_noise_dn >= 0))
        return wrong(diag, "rig.cameras", "positive full_scale_dn, electrons_per_dn");
    return LS_OK;
}

static void read_controller(struct ls_take_facts *facts, const json_t *rig)
{
    json_int_t levels =
        json_integer_value(json_object_get(json_object_get(rig, "controller"), "pwm_levels"));
    facts->pwm_levels = levels > 0 && levels <= UINT32_MAX ? (uint32_t)levels : 0;
}

/* Lit together as one part of the dome; other lists of lights belong to bases. */
static enum ls_fact_kind kind_of_segment(const char *pattern)
{
    if (pattern && (strcmp(pattern, "headlight") == 0 || strncmp(pattern, "headlight-", 10) == 0))
        return LS_FACT_HEADLIGHT;
    if (pattern && strcmp(pattern, "multiplex") == 0)
        return LS_FACT_MULTIPLEX;
    bool part =
        !pattern || strncmp(pattern, "segments-", 9) == 0 || strncmp(pattern, "lights-", 7) == 0;
    return part ? LS_FACT_SEGMENT : LS_FACT_OTHER;
}

static enum ls_fact_kind kind_of(const char *word, const char *pattern)
{
    if (word && strcmp(word, "dark") == 0)
        return LS_FACT_DARK;
    if (word && strcmp(word, "one") == 0)
        return LS_FACT_ONE;
    if (word && strcmp(word, "sphere") == 0)
        return LS_FACT_SPHERE;
    return word && strcmp(word, "segment") == 0 ? kind_of_segment(pattern) : LS_FACT_OTHER;
}

static int by_row(const void *a, const void *b)
{
    uint32_t x = *(const uint32_t *)a, y = *(const uint32_t *)b;
    return x < y ? -1 : x > y;
}

static enum ls_err read_lights(const struct ls_take_facts *facts, const json_t *item,
                               struct ls_condition_fact *out, struct ls_diag *diag)
{
    const json_t *list = json_object_get(item, "lights");
    size_t n = json_array_size(list);
    if (n < 1 || n > facts->n_lights)
        return wrong(diag, "plan.conditions.lights", "rows of the rig");
    out->lights = calloc(n, sizeof *out->lights);
    if (!out->lights)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    out->n_lights = (uint32_t)n;
    for (size_t i = 0; i < n; i++) {
        json_int_t light = json_integer_value(json_array_get(list, i));
        if (!json_is_integer(json_array_get(list, i)) || light < 0 || light >= facts->n_lights)
            return wrong(diag, "plan.conditions.lights", "rows of the rig");
        out->lights[i] = (uint32_t)light;
    }
    qsort(out->lights, n, sizeof *out->lights, by_row);
    for (size_t i = 1; i < n; i++)
        if (out->lights[i] == out->lights[i - 1])
            return wrong(diag, "plan.conditions.lights", "each light once");
    return LS_OK;
}

static enum ls_err read_lit(const struct ls_take_facts *facts, const json_t *item,
                            struct ls_condition_fact *out, struct ls_diag *diag)
{
    const char *channel = json_string_value(json_object_get(item, "channel"));
    json_int_t light = json_integer_value(json_object_get(item, "light"));
    json_int_t level = json_integer_value(json_object_get(item, "level"));
    int index = channel ? ls_take_facts_channel(facts, channel) : -1;
    if (index < 0 || level < 1 || level > FULL_LEVEL)
        return wrong(diag, "plan.conditions", "channel of the rig and level 1 to 65535");
    bool row = json_is_integer(json_object_get(item, "light"));
    if (out->kind == LS_FACT_ONE && (!row || light < 0 || light >= facts->n_lights))
        return wrong(diag, "plan.conditions.light", "a row of the rig");
    out->light = (uint32_t)light;
    out->channel = (uint32_t)index;
    out->duty = (double)level / FULL_LEVEL;
    if (out->kind == LS_FACT_SEGMENT || out->kind == LS_FACT_HEADLIGHT ||
        out->kind == LS_FACT_MULTIPLEX)
        return read_lights(facts, item, out, diag);
    return LS_OK;
}

/* Plans that do not name their patterns. */
static void name_pattern(struct ls_condition_fact *out)
{
    if (out->pattern[0])
        return;
    if (out->kind == LS_FACT_SPHERE)
        snprintf(out->pattern, sizeof out->pattern, "sphere");
    else if (out->kind == LS_FACT_SEGMENT)
        snprintf(out->pattern, sizeof out->pattern, "lights-%u", out->n_lights & 0xffff);
}

static enum ls_err read_condition(const struct ls_take_facts *facts, const json_t *item,
                                  struct ls_condition_fact *out, struct ls_diag *diag)
{
    const char *id = json_string_value(json_object_get(item, "id"));
    const char *pattern = json_string_value(json_object_get(item, "pattern"));
    if (!id || strlen(id) >= sizeof out->id)
        return wrong(diag, "plan.conditions.id", "a name");
    if (pattern && strlen(pattern) >= sizeof out->pattern)
        return wrong(diag, "plan.conditions.pattern", "at most 15 letters");
    snprintf(out->id, sizeof out->id, "%s", id);
    snprintf(out->pattern, sizeof out->pattern, "%s", pattern ? pattern : "");
    out->kind = kind_of(json_string_value(json_object_get(item, "kind")), pattern);
    if (json_is_true(json_object_get(item, "reference")))
        out->kind = LS_FACT_OTHER;
    out->watch = json_is_true(json_object_get(item, "watch"));
    out->repeats = (uint32_t)json_integer_value(json_object_get(item, "repeats"));
    out->part = (uint32_t)json_integer_value(json_object_get(item, "part"));
    out->parts = (uint32_t)json_integer_value(json_object_get(item, "parts"));
    if (out->kind == LS_FACT_OTHER || out->kind == LS_FACT_DARK)
        return LS_OK;
    enum ls_err err = read_lit(facts, item, out, diag);
    name_pattern(out);
    return err;
}

static enum ls_err read_plan(struct ls_take_facts *facts, const json_t *doc, struct ls_diag *diag)
{
    const json_t *list = json_object_get(json_object_get(doc, "plan"), "conditions");
    size_t n = json_array_size(list);
    enum ls_err err = LS_OK;
    if (n < 1 || n > MAX_CONDITIONS)
        return wrong(diag, "plan.conditions", "1 to 65536 conditions");
    facts->conditions = calloc(n, sizeof *facts->conditions);
    if (!facts->conditions)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    facts->n_conditions = (uint32_t)n;
    for (size_t i = 0; i < n && !err; i++)
        err = read_condition(facts, json_array_get(list, i), &facts->conditions[i], diag);
    return err;
}

static enum ls_err read_exposures(struct ls_take_facts *facts, const json_t *doc,
                                  struct ls_diag *diag)
{
    const json_t *list = json_object_get(doc, "exposure_s");
    size_t n = json_array_size(list);
    facts->reference_exposure_s = json_number_value(json_object_get(doc, "reference_exposure_s"));
    if (!(facts->reference_exposure_s > 0) || !isfinite(facts->reference_exposure_s))
        return wrong(diag, "reference_exposure_s", "a positive number");
    if (n < 1 || n > LS_MAX_EXPOSURES)
        return wrong(diag, "exposure_s", "1 to 8 exposures");
    facts->n_exposures = (uint32_t)n;
    for (size_t i = 0; i < n; i++) {
        facts->exposure_s[i] = json_number_value(json_array_get(list, i));
        if (!(facts->exposure_s[i] > 0))
            return wrong(diag, "exposure_s", "positive numbers");
    }
    return LS_OK;
}

static enum ls_err read_calibration(struct ls_take_facts *facts, const json_t *doc,
                                    struct ls_diag *diag)
{
    const json_t *calibration = json_object_get(doc, "calibration");
    if (!calibration || json_is_null(calibration))
        return LS_OK;
    char *text = json_dumps(calibration, JSON_COMPACT | JSON_REAL_PRECISION(17));
    if (!text)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    enum ls_err err = ls_calibration_parse(text, strlen(text), &facts->calibration, diag);
    free(text);
    if (!err && facts->calibration->n_lights != facts->n_lights)
        return ls_fail(diag, LS_ERR_INVALID, "take.json: the calibration has %u lights, the rig %u",
                       facts->calibration->n_lights, facts->n_lights);
    return err;
}

enum ls_err ls_take_facts_read(const char *take_json, uint32_t camera, struct ls_take_facts **out,
                               struct ls_diag *diag)
{
    json_error_t error;
    json_t *doc = json_loads(take_json, JSON_REJECT_DUPLICATES, &error);
    if (!doc)
        return ls_fail(diag, LS_ERR_INVALID, "take.json:%d: %s", error.line, error.text);
    const json_t *rig = json_object_get(doc, "rig");
    struct ls_take_facts *facts = calloc(1, sizeof *facts);
    enum ls_err err = facts ? LS_OK : ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    if (!err)
        err = read_positions(facts, rig, diag);
    if (!err)
        err = read_channels(facts, rig, diag);
    if (!err)
        err = read_camera(facts, rig, camera, diag);
    if (!err)
        read_controller(facts, rig);
    if (!err)
        err = read_plan(facts, doc, diag);
    if (!err)
        err = read_exposures(facts, doc, diag);
    if (!err)
        err = read_calibration(facts, doc, diag);
    json_decref(doc);
    if (err)
        ls_take_facts_destroy(facts);
    else
        *out = facts;
    return err;
}
