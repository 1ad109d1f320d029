#include "daemon/findings.h"

#include "daemon/take_json.h"

#include <jansson.h>
#include <math.h>
#include <stdio.h>

struct ls_dark_finding ls_find_dark(const struct ls_dark_exposure *dark)
{
    if (!dark)
        return (struct ls_dark_finding){0};
    const struct ls_dark_stats *s = &dark->stats;
    return (struct ls_dark_finding){.known = true,
                                    .mean_dn = s->mean_dn,
                                    .read_noise_dn = s->read_noise_dn,
                                    .clipped = s->zero_fraction + s->clipped_fraction,
                                    .n_defects = dark->n_defects};
}

struct ls_clock_finding ls_find_controller(const struct ls_clock *controller)
{
    if (controller->n == 0)
        return (struct ls_clock_finding){0};
    return (struct ls_clock_finding){.pairs = controller->n,
                                     .tick_ns = controller->nominal,
                                     .ticks = controller->ticks0,
                                     .host_ns = ls_clock_map(controller, controller->ticks0),
                                     .drift_ppm = ls_clock_drift_ppm(controller),
                                     .residual_rms_us = controller->residual_rms / 1e3,
                                     .residual_max_us = controller->residual_max / 1e3};
}

struct ls_clock_finding ls_find_camera(const struct ls_clock *camera,
                                       const struct ls_clock *controller,
                                       const struct ls_camera_residuals *residuals)
{
    if (camera->n == 0 || controller->n == 0)
        return (struct ls_clock_finding){0};
    double controller_ns = ls_clock_map(camera, camera->ticks0);
    uint64_t us = (uint64_t)(controller_ns / 1e3);
    double rest_ns = controller_ns - (double)us * 1e3;
    double rate = (1 + camera->drift) * (1 + controller->drift);
    double n = residuals->n ? (double)residuals->n : 1;
    return (struct ls_clock_finding){.pairs = camera->n,
                                     .tick_ns = camera->nominal,
                                     .ticks = camera->ticks0,
                                     .host_ns = ls_clock_map(controller, us) + rest_ns,
                                     .drift_ppm = (rate - 1) * 1e6,
                                     .residual_rms_us = sqrt(residuals->sum_squares_us2 / n),
                                     .residual_max_us = residuals->max_us};
}

static json_t *number(double value)
{
    return isfinite(value) ? json_real(value) : json_null();
}

static json_t *find_dark(json_t *darks, uint32_t camera, uint32_t exposure, size_t *at)
{
    for (*at = 0; *at < json_array_size(darks); ++*at) {
        json_t *item = json_array_get(darks, *at);
        if (json_integer_value(json_object_get(item, "camera")) == camera &&
            json_integer_value(json_object_get(item, "exposure")) == exposure)
            return item;
    }
    return NULL;
}

static int put_dark(json_t *darks, uint32_t camera, uint32_t exposure,
                    const struct ls_dark_finding *d)
{
    size_t at;
    json_t *old = find_dark(darks, camera, exposure, &at);
    if (!d->known || (old && !isfinite(d->read_noise_dn)))
        return 0;
    json_t *dark =
        json_pack("{si si so so so si}", "camera", (int)camera, "exposure", (int)exposure,
                  "mean_dn", number(d->mean_dn), "read_noise_dn", number(d->read_noise_dn),
                  "clipped", number(d->clipped), "defects", (int)d->n_defects);
    return old ? json_array_set_new(darks, at, dark) : json_array_append_new(darks, dark);
}

static int put_clock(json_t *clocks, const char *name, const struct ls_clock_finding *c)
{
    if (c->pairs == 0)
        return 0;
    /* in integers: a double holds no nanoseconds of a clock that has run for months */
    uint64_t shown_ns = c->ticks * (uint64_t)c->tick_ns, host_ns = (uint64_t)c->host_ns;
    return json_array_append_new(
        clocks,
        json_pack("{ss sf sI sI sf sf sf si}", "clock", name, "tick_ns", c->tick_ns, "ticks",
                  (json_int_t)c->ticks, "offset_ns", (json_int_t)(host_ns - shown_ns), "drift_ppm",
                  c->drift_ppm, "residual_rms_us", c->residual_rms_us, "residual_max_us",
                  c->residual_max_us, "pairs", (int)c->pairs));
}

/* The array under @key, made if there is none. (transfer none). */
static json_t *array_of(json_t *doc, const char *key)
{
    if (!json_is_array(json_object_get(doc, key)))
        json_object_set_new(doc, key, json_array());
    return json_object_get(doc, key);
}

/* Where the rig file's would stand; exposures are the first camera's. */
static int put_offset(json_t *doc, uint32_t i, const struct ls_exposure_offset *offset)
{
    json_t *cameras = json_object_get(json_object_get(doc, "rig"), "cameras");
    json_t *camera = json_array_get(cameras, i), *exposures = json_object_get(doc, "exposure_s");
    if (offset->sigma_us <= 0)
        return 0;
    double added_s =
        (offset->us - json_number_value(json_object_get(camera, "exposure_offset_us"))) * 1e-6;
    for (size_t e = 0; i == 0 && e < json_array_size(exposures); e++)
        json_real_set(json_array_get(exposures, e),
                      json_number_value(json_array_get(exposures, e)) + added_s);
    return json_object_set_new(camera, "exposure_offset_us", json_real(offset->us)) |
           json_object_set_new(camera, "exposure_offset_sigma_us", json_real(offset->sigma_us));
}

static int put(const struct ls_findings *f, json_t *doc)
{
    json_t *darks = array_of(doc, "darks"), *clocks = array_of(doc, "clocks");
    int bad = put_clock(clocks, "controller", &f->controller);
    for (uint32_t i = 0; i < f->n_cameras; i++) {
        char name[16];
        snprintf(name, sizeof name, "cam%u", i);
        bad |= put_clock(clocks, name, &f->cameras[i]);
        bad |= put_offset(doc, i, &f->offsets[i]);
        for (uint32_t e = 0; e < f->n_exposures; e++)
            bad |= put_dark(darks, i, e, &f->darks[i][e]);
    }
    return bad;
}

enum ls_err ls_findings_put(const struct ls_findings *findings, const char *take_json, char **text,
                            struct ls_diag *diag)
{
    json_t *doc = NULL;
    enum ls_err err = ls_take_json_read(take_json, &doc, diag);
    if (err)
        return err;
    return ls_take_json_print(doc, put(findings, doc), text, diag);
}
