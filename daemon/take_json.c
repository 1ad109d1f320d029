#include "daemon/take_json.h"

#include "daemon/bracket.h"
#include "daemon/engine.h"

#include <jansson.h>
#include <stdlib.h>
#include <string.h>

enum { CONVENTIONS = 1 };

static json_t *numbers_f(const float *v, unsigned n)
{
    json_t *out = json_array();
    for (unsigned i = 0; i < n; i++)
        json_array_append_new(out, json_real(v[i]));
    return out;
}

/* The rig file's row of a controller address; plans hold addresses. */
static json_int_t row_of(const struct ls_config *config, uint16_t address)
{
    for (uint32_t i = 0; i < config->n_lights; i++)
        if (config->lights[i].address == address)
            return i;
    return -1;
}

static void add_pattern(const struct ls_plan_condition *c, const struct ls_config *config,
                        json_t *o)
{
    json_object_set_new(o, "pattern", json_string(c->pattern));
    json_object_set_new(o, "part", json_integer(c->part));
    json_object_set_new(o, "parts", json_integer(c->parts));
    if (c->lights.kind == LS_CONDITION_SPHERE)
        return;
    json_t *lights = json_array(), *levels = json_array();
    for (uint32_t i = 0; i < c->lights.n_leds; i++) {
        json_array_append_new(lights, json_integer(row_of(config, c->lights.leds[i].light)));
        json_array_append_new(levels, json_integer(c->lights.leds[i].level));
    }
    json_object_set_new(o, "lights", lights);
    if (c->lights.kind == LS_CONDITION_LIST)
        json_object_set(o, "levels", levels);
    json_decref(levels);
}

static json_t *condition_json(const struct ls_plan_condition *c, const struct ls_config *config)
{
    static const char *const kinds[] = {"dark", "one", "sphere", "segment", "list"};
    json_t *o =
        json_pack("{ss ss si si si}", "id", c->id, "kind", kinds[c->lights.kind], "repeats",
                  (int)c->repeats, "first_step", (int)c->first_step, "steps", (int)c->n_steps);
    if (c->dark)
        json_object_set_new(o, "exposure", json_integer(c->exposure));
    if (c->watch)
        json_object_set_new(o, "watch", json_true());
    if (c->reference)
        json_object_set_new(o, "reference", json_true());
    if (c->light >= 0)
        json_object_set_new(o, "light", json_integer(c->light));
    if (c->channel >= 0) {
        json_object_set_new(o, "channel", json_string(config->channels[c->channel].name));
        json_object_set_new(o, "level", json_integer(c->level));
    }
    if (c->pattern[0])
        add_pattern(c, config, o);
    return o;
}

static json_t *uncalibrated_json(const struct ls_take_document *d)
{
    json_t *ids = json_array();
    for (uint32_t i = 0; i < d->plan->n_conditions; i++) {
        const struct ls_plan_condition *c = &d->plan->conditions[i];
        if (c->pattern[0] && !(d->calibration && ls_plan_factor(c, d->config, d->calibration) > 0))
            json_array_append_new(ids, json_string(c->id));
    }
    return ids;
}

static json_t *plan_json(const struct ls_take_document *d)
{
    json_t *pulses = json_array(), *conditions = json_array();
    for (uint32_t i = 0; i < d->plan->n_exposures; i++)
        json_array_append_new(pulses, json_integer(d->plan->pulse_us[i]));
    for (uint32_t i = 0; i < d->plan->n_conditions; i++)
        json_array_append_new(conditions, condition_json(&d->plan->conditions[i], d->config));
    return json_pack("{ss ss ss si so so so}", "text", d->plan_text, "subject",
                     d->plan->subject == LS_SUBJECT_LIVE ? "live" : "still", "bracket",
                     ls_bracket_name(d->plan->bracket), "period_us", (int)d->plan->period_us,
                     "pulse_us", pulses, "conditions", conditions, "uncalibrated",
                     uncalibrated_json(d));
}

/* What was said of the lens. */
static json_t *add_lens(const struct ls_config_camera *c, json_t *o)
{
    if (c->lens)
        json_object_set_new(o, "lens", json_string(c->lens));
    if (c->aperture > 0)
        json_object_set_new(o, "aperture", json_real(c->aperture));
    if (c->iso_speed > 0)
        json_object_set_new(o, "iso_speed", json_real(c->iso_speed));
    return o;
}

static json_t *camera_json(const struct ls_config_camera *c, const struct ls_camera_info *info)
{
    const float sensor[2] = {c->sensor_width_mm, c->sensor_height_mm};
    const float range[2] = {c->range_low, c->range_high};
    json_t *o = json_pack(
        "{ss ss ss ss si si ss so so sf so so sf sf sf sf sf ss sf sf ss}", "name", c->name,
        "vendor", info->vendor, "model", info->model, "serial", info->serial, "width",
        (int)info->width, "height", (int)info->height, "pixel_format", info->pixel_format,
        "position_m", numbers_f(c->position_m, 3), "look_at_m", numbers_f(c->look_at_m, 3),
        "focal_length_mm", (double)c->focal_length_mm, "sensor_mm", numbers_f(sensor, 2), "range",
        numbers_f(range, 2), "black_dn", c->black_dn, "full_scale_dn", c->full_scale_dn,
        "electrons_per_dn", c->electrons_per_dn, "read_noise_dn", c->read_noise_dn,
        "exposure_offset_us", c->exposure_offset_us, "unverified", info->unverified, "gain",
        info->gain, "black_level", info->black_level, "exposure",
        c->driver.exposure == LS_EXPOSURE_WIDTH ? "width" : "timed");
    if (c->exposure_offset_sigma_us > 0)
        json_object_set_new(o, "exposure_offset_sigma_us", json_real(c->exposure_offset_sigma_us));
    return add_lens(c, o);
}

static json_t *channel_json(const struct ls_config_channel *c)
{
    json_t *o =
        json_pack("{ss ss}", "name", c->name, "kind", c->polariser ? "polariser" : "spectrum");
    if (!c->spectrum)
        return o;
    json_t *values = json_array();
    for (int i = 0; i < LS_SPECTRUM_N; i++)
        json_array_append_new(values, json_real(c->spectrum->v[i]));
    json_object_set_new(o, "spectrum",
                        json_pack("{si si so}", "start_nm", LS_SPECTRUM_FIRST_NM, "step_nm",
                                  LS_SPECTRUM_STEP_NM, "values", values));
    return o;
}

static json_t *rig_json(const struct ls_take_document *d)
{
    json_t *positions = json_array(), *addresses = json_array();
    json_t *channels = json_array(), *cameras = json_array();
    for (uint32_t i = 0; i < d->config->n_lights; i++) {
        json_array_append_new(positions, numbers_f(d->config->lights[i].position_m, 3));
        json_array_append_new(addresses, json_integer(d->config->lights[i].address));
    }
    for (uint32_t i = 0; i < d->config->n_channels; i++)
        json_array_append_new(channels, channel_json(&d->config->channels[i]));
    for (uint32_t i = 0; i < d->config->n_cameras; i++)
        json_array_append_new(cameras, camera_json(&d->config->cameras[i], d->cameras[i]));
    return json_pack("{ss s{so so} so so s{ss si si si}}", "name", d->config->rig_name, "lights",
                     "position_m", positions, "address", addresses, "channels", channels, "cameras",
                     cameras, "controller", "serial", d->lights->serial, "firmware",
                     (int)d->lights->firmware, "pwm_levels", (int)d->lights->pwm_levels,
                     "pwm_period_us", (int)d->lights->pwm_period_us);
}

/* Exposure times differ between cameras by their offsets; the document states the first camera's,
 * every ticket its own. */
static json_t *exposures_json(const struct ls_take_document *d)
{
    json_t *out = json_array();
    for (uint32_t i = 0; i < d->plan->n_exposures; i++) {
        const struct ls_config_camera *c = &d->config->cameras[0];
        double offset = c->driver.exposure == LS_EXPOSURE_WIDTH ? c->exposure_offset_us : 0;
        json_array_append_new(out, json_real((d->plan->pulse_us[i] + offset) * 1e-6));
    }
    return out;
}

static json_t *preflight_json(const struct ls_preflight *p)
{
    json_t *warnings = json_array();
    for (const char *line = p->warnings; *line;) {
        size_t n = strcspn(line, "\n");
        json_array_append_new(warnings, json_stringn(line, n));
        line += n + (line[n] == '\n');
    }
    return json_pack("{sf sI sf sf sf sf so}", "seconds", p->seconds, "bytes", (json_int_t)p->bytes,
                     "energy_j", p->energy_j, "peak_current_a", p->peak_current_a, "led_duty",
                     p->led_duty, "dark_noise_share", p->dark_noise_share, "warnings", warnings);
}

enum ls_err ls_take_json_make(const struct ls_take_document *d, char **text, struct ls_diag *diag)
{
    json_t *calibration = json_null();
    if (d->calibration_json) {
        json_error_t error;
        calibration = json_loads(d->calibration_json, JSON_REJECT_DUPLICATES, &error);
        if (!calibration)
            return ls_fail(diag, LS_ERR_INVALID, "calibration:%d: %s", error.line, error.text);
    }
    json_t *doc = json_pack("{ss si so so so sf so}", "software", "lightstaged " LS_VERSION,
                            "conventions", CONVENTIONS, "plan", plan_json(d), "rig", rig_json(d),
                            "exposure_s", exposures_json(d), "reference_exposure_s",
                            d->reference_exposure_s, "calibration", calibration);
    if (doc && d->preflight)
        json_object_set_new(doc, "preflight", preflight_json(d->preflight));
    if (doc && d->led_record)
        json_object_set(doc, "led_sweep", d->led_record);
    if (doc && d->token && *d->token)
        json_object_set_new(doc, "token", json_string(d->token));
    *text = doc ? json_dumps(doc, JSON_COMPACT | JSON_REAL_PRECISION(17)) : NULL;
    json_decref(doc);
    return *text ? LS_OK : ls_fail(diag, LS_ERR_NOMEM, "out of memory writing take.json");
}

static json_t *load(const char *take_json, struct ls_diag *diag)
{
    json_error_t error;
    json_t *doc = json_loads(take_json, JSON_REJECT_DUPLICATES, &error);
    if (!doc)
        ls_fail(diag, LS_ERR_INVALID, "take.json:%d: %s", error.line, error.text);
    return doc;
}

enum ls_err ls_take_json_plan(const char *take_json, char **plan_text, struct ls_diag *diag)
{
    json_t *doc = load(take_json, diag);
    if (!doc)
        return LS_ERR_INVALID;
    const char *text = json_string_value(json_object_get(json_object_get(doc, "plan"), "text"));
    *plan_text = text ? strdup(text) : NULL;
    json_decref(doc);
    if (!text)
        return ls_fail(diag, LS_ERR_INVALID, "take.json: key plan.text is missing");
    return *plan_text ? LS_OK : ls_fail(diag, LS_ERR_NOMEM, "out of memory");
}

enum ls_err ls_take_json_offsets(const char *take_json, struct ls_config *config,
                                 struct ls_diag *diag)
{
    json_t *doc = load(take_json, diag);
    if (!doc)
        return LS_ERR_INVALID;
    const json_t *cameras = json_object_get(json_object_get(doc, "rig"), "cameras");
    for (uint32_t k = 0; k < config->n_cameras; k++) {
        const json_t *camera = json_array_get(cameras, k);
        if (!config->cameras[k].measure_offset)
            continue;
        config->cameras[k].exposure_offset_us =
            json_number_value(json_object_get(camera, "exposure_offset_us"));
        config->cameras[k].exposure_offset_sigma_us =
            json_number_value(json_object_get(camera, "exposure_offset_sigma_us"));
    }
    json_decref(doc);
    return LS_OK;
}

/* What must not change between the halves of a resumed take. */
static bool same_camera(const json_t *a, const json_t *b)
{
    static const char *const keys[] = {"serial",
                                       "width",
                                       "height",
                                       "pixel_format",
                                       "range",
                                       "full_scale_dn",
                                       "exposure_offset_us",
                                       "position_m",
                                       "look_at_m",
                                       "focal_length_mm",
                                       "black_dn",
                                       "electrons_per_dn",
                                       "read_noise_dn",
                                       "gain",
                                       "black_level",
                                       "exposure"};
    for (size_t i = 0; i < sizeof keys / sizeof *keys; i++)
        if (!json_equal(json_object_get(a, keys[i]), json_object_get(b, keys[i])))
            return false;
    return true;
}

static enum ls_err compare_rigs(const json_t *old, const json_t *now, struct ls_diag *diag)
{
    static const char *const keys[] = {"lights", "channels"};
    for (size_t i = 0; i < sizeof keys / sizeof *keys; i++)
        if (!json_equal(json_object_get(old, keys[i]), json_object_get(now, keys[i])))
            return ls_fail(diag, LS_ERR_MISMATCH,
                           "the rig's %s have changed since this take began; start a new take",
                           keys[i]);
    const json_t *a = json_object_get(old, "cameras"), *b = json_object_get(now, "cameras");
    for (size_t i = 0; i < json_array_size(a) || i < json_array_size(b); i++)
        if (!same_camera(json_array_get(a, i), json_array_get(b, i)))
            return ls_fail(diag, LS_ERR_MISMATCH,
                           "camera %zu has changed since this take began; start a new take", i);
    return LS_OK;
}

/* Frames that wait on disk for the rest of their bracket were shot in its order. */
static enum ls_err compare_brackets(const json_t *doc, const struct ls_plan *plan,
                                    struct ls_diag *diag)
{
    const json_t *was = json_object_get(json_object_get(doc, "plan"), "bracket");
    const char *now = ls_bracket_name(plan->bracket);
    if (json_is_string(was) && !strcmp(json_string_value(was), now))
        return LS_OK;
    return ls_fail(diag, LS_ERR_MISMATCH,
                   "brackets were made by %.20s when this take began and would be by %s now: the "
                   "cameras or the rig file have changed; start a new take",
                   json_is_string(was) ? json_string_value(was) : "another version of lightstaged",
                   now);
}

/* The order of shots is this version's; a level that the plan leaves to the controller goes with
 * its current limit. */
static enum ls_err compare_conditions(const json_t *doc, const struct ls_plan *plan,
                                      struct ls_diag *diag)
{
    const json_t *list = json_object_get(json_object_get(doc, "plan"), "conditions");
    for (uint32_t i = 0; i < plan->n_conditions; i++) {
        const char *id = json_string_value(json_object_get(json_array_get(list, i), "id"));
        if (!id || strcmp(id, plan->conditions[i].id) != 0)
            return ls_fail(diag, LS_ERR_MISMATCH,
                           "condition %u was %.40s when this take began and would be %s now: "
                           "another version of lightstaged began it; start a new take",
                           i, id ? id : "none", plan->conditions[i].id);
        const json_t *old = json_object_get(json_array_get(list, i), "level");
        if (old && json_integer_value(old) != plan->conditions[i].level)
            return ls_fail(diag, LS_ERR_MISMATCH,
                           "%s was lit at level %d when this take began and would be at %u now: "
                           "the controller's current limit has changed; start a new take",
                           plan->conditions[i].id, (int)json_integer_value(old),
                           plan->conditions[i].level);
    }
    return LS_OK;
}

enum ls_err ls_take_json_same_rig(const char *take_json, const struct ls_take_document *document,
                                  struct ls_diag *diag)
{
    json_t *doc = load(take_json, diag);
    if (!doc)
        return LS_ERR_INVALID;
    /* through text, so that both sides are rounded alike */
    json_t *fresh = rig_json(document);
    char *text = json_dumps(fresh, JSON_REAL_PRECISION(17));
    json_t *now = text ? json_loads(text, 0, NULL) : NULL;
    enum ls_err err = now ? compare_rigs(json_object_get(doc, "rig"), now, diag)
                          : ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    if (!err)
        err = compare_brackets(doc, document->plan, diag);
    if (!err)
        err = compare_conditions(doc, document->plan, diag);
    free(text);
    json_decref(now);
    json_decref(fresh);
    json_decref(doc);
    return err;
}

enum ls_err ls_take_json_read(const char *take_json, json_t **doc, struct ls_diag *diag)
{
    json_error_t error;
    *doc = json_loads(take_json, JSON_REJECT_DUPLICATES, &error);
    if (json_is_object(*doc))
        return LS_OK;
    ls_fail(diag, LS_ERR_INVALID, "take.json:%d: %s", *doc ? 1 : error.line,
            *doc ? "expected an object" : error.text);
    json_decref(*doc);
    *doc = NULL;
    return LS_ERR_INVALID;
}

enum ls_err ls_take_json_print(json_t *doc, int bad, char **text, struct ls_diag *diag)
{
    *text = bad ? NULL : json_dumps(doc, JSON_COMPACT | JSON_REAL_PRECISION(17));
    json_decref(doc);
    return *text ? LS_OK : ls_fail(diag, LS_ERR_NOMEM, "out of memory writing take.json");
}
