#include "daemon/led_sweep.h"

#include "core/led_check.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define FLOOR 0.05 /* of the middle light: what little comes from behind is bounced, and coloured \
                    */
enum { NAMED_LEDS = 8 };

enum ls_err ls_led_sweep_init(struct ls_led_sweep *s, const struct ls_config *config,
                              const struct ls_plan *plan)
{
    size_t n = (size_t)config->n_cameras * plan->n_conditions;
    *s = (struct ls_led_sweep){.config = config, .plan = plan};
    s->level = calloc(n + 1, sizeof *s->level);
    s->saturated = calloc(n + 1, sizeof *s->saturated);
    if (!s->level || !s->saturated)
        return LS_ERR_NOMEM;
    for (size_t i = 0; i < n; i++)
        s->level[i] = s->saturated[i] = NAN;
    return LS_OK;
}

void ls_led_sweep_finish(struct ls_led_sweep *s)
{
    free(s->level);
    free(s->saturated);
    *s = (struct ls_led_sweep){0};
}

void ls_led_sweep_add(struct ls_led_sweep *s, uint32_t camera, uint32_t condition,
                      const struct ls_picture_sums *sums)
{
    size_t at = (size_t)camera * s->plan->n_conditions + condition;
    double total = 0;
    for (uint32_t k = 0; k < sums->n_colours; k++)
        total += sums->total[k];
    s->level[at] = (float)(total / (double)sums->n_px);
    s->saturated[at] = (float)((double)sums->n_saturated / (double)sums->n_px);
}

static void warn(json_t *warnings, const char *fmt, ...) LS_PRINTF(2, 3);
static void warn(json_t *warnings, const char *fmt, ...)
{
    char text[512];
    va_list args;
    va_start(args, fmt);
    vsnprintf(text, sizeof text, fmt, args);
    va_end(args);
    json_array_append_new(warnings, json_string(text));
}

/* ---- LEDs ---- */

/* What one camera says, where no camera before it could. */
static enum ls_err judge(const struct ls_led_sweep *s, uint32_t camera, uint8_t *verdict,
                         float *share, struct ls_diag *diag)
{
    uint32_t n = s->config->n_lights, channels = s->config->n_channels;
    size_t n_leds = (size_t)n * channels;
    LS_CLEANUP_FREE float(*directions)[3] = calloc(n, sizeof *directions);
    LS_CLEANUP_FREE float *level = calloc(n_leds, sizeof *level);
    LS_CLEANUP_FREE float *of_expected = calloc(n_leds, sizeof *of_expected);
    LS_CLEANUP_FREE uint8_t *now = calloc(n_leds, sizeof *now);
    if (!directions || !level || !of_expected || !now)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for judging LEDs");
    for (uint32_t i = 0; i < n; i++)
        memcpy(directions[i], s->config->lights[i].position_m, sizeof directions[i]);
    for (size_t i = 0; i < n_leds; i++)
        level[i] = NAN;
    for (uint32_t i = 0; i < s->plan->n_conditions; i++) {
        const struct ls_plan_condition *c = &s->plan->conditions[i];
        if (c->light >= 0)
            level[(size_t)c->channel * n + (size_t)c->light] =
                s->level[(size_t)camera * s->plan->n_conditions + i];
    }
    const struct ls_led_levels in = {(const float(*)[3])directions, level, n, channels, FLOOR};
    enum ls_err err = ls_led_check(&in, now, of_expected, diag);
    for (size_t i = 0; i < n_leds && !err; i++) {
        if (verdict[i] != LS_LED_UNKNOWN && verdict[i] != LS_LED_UNSEEN)
            continue;
        verdict[i] = now[i] == LS_LED_UNKNOWN ? verdict[i] : now[i];
        share[i] = of_expected[i];
    }
    return err;
}

static json_t *list_leds(const struct ls_led_sweep *s, const uint8_t *verdict, const float *share,
                         enum ls_led_verdict which, char *names, size_t size)
{
    json_t *out = json_array();
    size_t used = 0;
    uint32_t n = s->config->n_lights;
    names[0] = 0;
    for (uint32_t i = 0; i < n; i++)
        for (uint32_t c = 0; c < s->config->n_channels; c++) {
            size_t at = (size_t)c * n + i;
            if (verdict[at] != which)
                continue;
            if (json_array_size(out) <= NAMED_LEDS && used < size)
                used += (size_t)snprintf(names + used, size - used, "%s%s-%04u", used ? ", " : "",
                                         s->config->channels[c].name, i);
            json_array_append_new(
                out,
                json_pack("{si ss so}", "light", (int)i, "channel", s->config->channels[c].name,
                          "share", isnan(share[at]) ? json_null() : json_real((double)share[at])));
        }
    return out;
}

static json_t *leds_json(const struct ls_led_sweep *s, const uint8_t *verdict, const float *share,
                         json_t *warnings)
{
    char dead[256], dim[256], unseen[256];
    int judged = 0;
    for (size_t i = 0; i < (size_t)s->config->n_lights * s->config->n_channels; i++)
        judged += verdict[i] != LS_LED_UNKNOWN && verdict[i] != LS_LED_UNSEEN;
    json_t *out = json_pack("{si so so so}", "judged", judged, "dead",
                            list_leds(s, verdict, share, LS_LED_IS_DEAD, dead, sizeof dead), "dim",
                            list_leds(s, verdict, share, LS_LED_IS_DIM, dim, sizeof dim), "unseen",
                            list_leds(s, verdict, share, LS_LED_UNSEEN, unseen, sizeof unseen));
    size_t n_dead = json_array_size(json_object_get(out, "dead"));
    size_t n_dim = json_array_size(json_object_get(out, "dim"));
    if (n_dead)
        warn(warnings, "%zu LEDs give no light: %s%s: check their cables and drivers", n_dead, dead,
             n_dead > NAMED_LEDS ? " ..." : "");
    if (n_dim)
        warn(warnings,
             "%zu LEDs are dim: %s%s: clean or replace them, or see what stands in their way",
             n_dim, dim, n_dim > NAMED_LEDS ? " ..." : "");
    return out;
}

/* ---- clipping ---- */

static json_t *clipping_of(const struct ls_led_sweep *s, uint32_t channel, uint32_t camera,
                           json_t *warnings)
{
    const struct ls_plan *p = s->plan;
    const struct ls_plan_condition *worst = NULL;
    double most = -1;
    for (uint32_t i = 0; i < p->n_conditions; i++) {
        double share = (double)s->saturated[(size_t)camera * p->n_conditions + i];
        if (p->conditions[i].channel != (int32_t)channel || isnan(share) || share <= most)
            continue;
        most = share;
        worst = &p->conditions[i];
    }
    if (!worst)
        return NULL;
    if (most > LS_CLIPPING_WARNED)
        warn(
            warnings,
            "clipping: %.1f %% of camera %s is saturated under %s even at %u us: begin the bracket "
            "at %u us, or dim it",
            100 * most, s->config->cameras[camera].name, worst->id, p->pulse_us[0],
            p->pulse_us[0] / 2);
    return json_pack("{ss si ss sf}", "channel", s->config->channels[channel].name, "camera",
                     (int)camera, "condition", worst->id, "share", most);
}

static json_t *clipping_json(const struct ls_led_sweep *s, json_t *warnings)
{
    json_t *out = json_array();
    for (uint32_t c = 0; c < s->config->n_channels; c++)
        for (uint32_t k = 0; k < s->config->n_cameras; k++) {
            json_t *item = clipping_of(s, c, k, warnings);
            if (item)
                json_array_append_new(out, item);
        }
    return out;
}

/* ---- ambient light ---- */

/* What the darks gather with time; of one exposure alone: over the nominal black. */
static json_t *ambient_json(const struct ls_led_sweep *s, const struct ls_findings *f,
                            json_t *warnings)
{
    json_t *out = json_array();
    const uint32_t *pulse_us = s->plan->pulse_us;
    for (uint32_t k = 0; k < s->config->n_cameras; k++) {
        const struct ls_config_camera *camera = &s->config->cameras[k];
        uint32_t last = f->n_exposures - 1;
        const struct ls_dark_finding *longest = &f->darks[k][last], *shortest = &f->darks[k][0];
        if (!longest->known || !shortest->known)
            continue;
        double dn = longest->mean_dn - camera->black_dn;
        if (last > 0)
            dn = (longest->mean_dn - shortest->mean_dn) * pulse_us[last] /
                 (pulse_us[last] - pulse_us[0]);
        json_array_append_new(out, json_pack("{si sf}", "camera", (int)k, "dn", dn));
        if (dn > LS_AMBIENT_WARNED * camera->full_scale_dn)
            warn(warnings,
                 "ambient light: camera %s gathers %.1f DN in the dark in %u us (%.2f %% of full "
                 "scale): darken the room; it is subtracted only as long as it stays the same",
                 camera->name, dn, pulse_us[last], 100 * dn / camera->full_scale_dn);
    }
    return out;
}

static bool is_empty(const struct ls_led_sweep *s)
{
    for (size_t i = 0; i < (size_t)s->config->n_cameras * s->plan->n_conditions; i++)
        if (!isnan(s->level[i]))
            return false;
    return true;
}

enum ls_err ls_led_sweep_conclude(const struct ls_led_sweep *s, const struct ls_findings *findings,
                                  json_t **checks, struct ls_diag *diag)
{
    size_t n_leds = (size_t)s->config->n_lights * s->config->n_channels;
    LS_CLEANUP_FREE uint8_t *verdict = calloc(n_leds, sizeof *verdict);
    LS_CLEANUP_FREE float *share = calloc(n_leds, sizeof *share);
    enum ls_err err = LS_OK;
    *checks = NULL;
    if (!verdict || !share)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for judging LEDs");
    if (is_empty(s))
        return LS_OK;
    for (uint32_t k = 0; k < s->config->n_cameras && !err; k++)
        err = judge(s, k, verdict, share, diag);
    if (err)
        return err;
    json_t *warnings = json_array();
    json_t *leds = leds_json(s, verdict, share, warnings);
    json_t *clipping = clipping_json(s, warnings);
    json_t *ambient = ambient_json(s, findings, warnings);
    *checks = json_pack("{so so so so}", "leds", leds, "clipping", clipping, "ambient", ambient,
                        "warnings", warnings);
    return *checks ? LS_OK : ls_fail(diag, LS_ERR_NOMEM, "out of memory");
}
