#include "daemon/checks.h"

#include "daemon/take_json.h"

#include <jansson.h>
#include <math.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define DRIFT_SIGMAS 5
enum { ROWS_ENOUGH = 256 }; /* for the mean of a picture: beyond, some rows stand for all */

struct compared {
    uint32_t camera, condition, n_colours;
    struct ls_light_drift colour[LS_SUMS_COLOURS]; /* change NAN: nothing to compare */
    bool alarm;
};

struct ls_checks {
    const struct ls_config *config;
    const struct ls_plan *plan;
    pthread_mutex_t lock;
    struct ls_picture_sums first[LS_MAX_CAMERAS][LS_MAX_CHANNELS]; /* no blocks: none came */
    struct compared *compared;
    uint32_t n_compared, capacity;
    struct ls_drift_seen worst;
    struct ls_led_sweep leds;
};

struct ls_checks *ls_checks_create(const struct ls_config *config, const struct ls_plan *plan)
{
    struct ls_checks *c = calloc(1, sizeof *c);
    if (!c)
        return NULL;
    c->config = config;
    c->plan = plan;
    pthread_mutex_init(&c->lock, NULL);
    if (ls_led_sweep_init(&c->leds, config, plan)) {
        ls_checks_destroy(c);
        return NULL;
    }
    return c;
}

void ls_checks_destroy(struct ls_checks *c)
{
    if (!c)
        return;
    for (uint32_t i = 0; i < LS_MAX_CAMERAS; i++)
        for (uint32_t k = 0; k < LS_MAX_CHANNELS; k++)
            ls_picture_sums_finish(&c->first[i][k]);
    ls_led_sweep_finish(&c->leds);
    pthread_mutex_destroy(&c->lock);
    free(c->compared);
    free(c);
}

/* ---- drift ---- */

static bool is_alarm(const struct ls_light_drift *d)
{
    return fabs(d->change) > LS_DRIFT_ALARM && fabs(d->change) > DRIFT_SIGMAS * d->error;
}

static void compare(const struct ls_picture_sums *first, const struct ls_picture_sums *now,
                    struct compared *out)
{
    out->n_colours = now->n_colours;
    for (uint32_t i = 0; i < now->n_colours; i++) {
        if (!ls_picture_drift(first, now, i, &out->colour[i]))
            out->colour[i] = (struct ls_light_drift){NAN, NAN};
        out->alarm |= is_alarm(&out->colour[i]);
    }
}

/* The colour to tell of: an alarm before none, then the largest change; NULL if none is known. */
static const struct ls_light_drift *most(const struct compared *c, uint32_t *colour)
{
    const struct ls_light_drift *out = NULL;
    for (uint32_t i = 0; i < c->n_colours; i++) {
        const struct ls_light_drift *d = &c->colour[i];
        if (isnan(d->change) || is_alarm(d) < c->alarm)
            continue;
        if (!out || fabs(d->change) > fabs(out->change)) {
            out = d;
            *colour = i;
        }
    }
    return out;
}

static void describe(const struct ls_checks *c, const struct compared *now,
                     const struct ls_light_drift *drift, uint32_t colour, char *text, size_t size)
{
    static const char *const colours[] = {"red", "green", "blue"};
    int n = snprintf(
        text, size,
        "light drift: camera %.64s: %s of %s is %+.2f %% (error %.2f %%) "
        "from the first reference",
        c->config->cameras[now->camera].name, now->n_colours == 1 ? "brightness" : colours[colour],
        c->plan->conditions[now->condition].id, 100 * drift->change, 100 * drift->error);
    if (now->alarm && n > 0 && (size_t)n < size)
        snprintf(text + n, size - (size_t)n,
                 ", allowed %g %%: let the lights warm up by a take of the same plan, see that "
                 "supply and cooling are steady and that nothing in view moves, and take again",
                 100 * LS_DRIFT_ALARM);
}

/* Under the lock. */
static void note(struct ls_checks *c, const struct compared *now, struct ls_diag *alarm)
{
    uint32_t colour = 0;
    const struct ls_light_drift *drift = most(now, &colour);
    if (!drift)
        return;
    struct ls_drift_seen seen = {.known = true, .alarm = now->alarm, .drift = *drift};
    describe(c, now, drift, colour, seen.text, sizeof seen.text);
    if (now->alarm)
        snprintf(alarm->text, sizeof alarm->text, "%s", seen.text);
    bool larger = fabs(drift->change) > fabs(c->worst.drift.change);
    if (!c->worst.known || seen.alarm > c->worst.alarm || (seen.alarm == c->worst.alarm && larger))
        c->worst = seen;
}

static enum ls_err remember(struct ls_checks *c, const struct compared *now, struct ls_diag *diag)
{
    if (c->n_compared == c->capacity) {
        uint32_t capacity = c->capacity ? 2 * c->capacity : 64;
        struct compared *more = realloc(c->compared, capacity * sizeof *more);
        if (!more)
            return ls_fail(diag, LS_ERR_NOMEM, "out of memory for what references say");
        c->compared = more;
        c->capacity = capacity;
    }
    c->compared[c->n_compared++] = *now;
    return LS_OK;
}

/* Under the lock. @sums becomes the first of its channel if there is none yet. */
static enum ls_err look_at_reference(struct ls_checks *c, uint32_t camera, uint32_t condition,
                                     struct ls_picture_sums *sums, struct ls_diag *alarm,
                                     struct ls_diag *diag)
{
    struct ls_picture_sums *first = &c->first[camera][c->plan->conditions[condition].channel];
    if (!first->n_blocks) {
        *first = *sums;
        *sums = (struct ls_picture_sums){0};
        return LS_OK;
    }
    struct compared now = {.camera = camera, .condition = condition};
    compare(first, sums, &now);
    note(c, &now, alarm);
    return remember(c, &now, diag);
}

enum ls_err ls_checks_picture(struct ls_checks *c, uint32_t camera, uint32_t condition,
                              const struct ls_picture_view *picture, struct ls_diag *alarm,
                              struct ls_diag *diag)
{
    struct ls_picture_sums sums;
    bool reference = c->plan->conditions[condition].reference;
    uint32_t every = reference ? 1 : 1 + picture->height / (2 * ROWS_ENOUGH);
    alarm->text[0] = 0;
    enum ls_err err = ls_picture_sums_make(picture, every, &sums, diag);
    if (err)
        return err;
    pthread_mutex_lock(&c->lock);
    if (reference)
        err = look_at_reference(c, camera, condition, &sums, alarm, diag);
    else
        ls_led_sweep_add(&c->leds, camera, condition, &sums);
    pthread_mutex_unlock(&c->lock);
    ls_picture_sums_finish(&sums);
    return err;
}

enum ls_err ls_checks_adopt(struct ls_checks *c, uint32_t camera, uint32_t condition,
                            const struct ls_picture_view *picture, struct ls_diag *diag)
{
    const struct ls_plan_condition *cond = &c->plan->conditions[condition];
    if (!cond->reference || c->first[camera][cond->channel].n_blocks)
        return LS_OK;
    return ls_picture_sums_make(picture, 1, &c->first[camera][cond->channel], diag);
}

void ls_checks_drift(struct ls_checks *c, struct ls_drift_seen *out)
{
    pthread_mutex_lock(&c->lock);
    *out = c->worst;
    pthread_mutex_unlock(&c->lock);
}

/* ---- take.json ---- */

static json_t *number(double value)
{
    return isfinite(value) ? json_real(value) : json_null();
}

static json_t *compared_json(const struct ls_checks *c, const struct compared *now)
{
    json_t *change = json_array(), *error = json_array();
    for (uint32_t i = 0; i < now->n_colours; i++) {
        json_array_append_new(change, number(now->colour[i].change));
        json_array_append_new(error, number(now->colour[i].error));
    }
    return json_pack("{ss si so so sb}", "reference", c->plan->conditions[now->condition].id,
                     "camera", (int)now->camera, "change", change, "error", error, "alarm",
                     now->alarm);
}

static int put(struct ls_checks *c, json_t *conclusion, json_t *doc)
{
    int bad = conclusion ? json_object_set(doc, "checks", conclusion) : 0;
    if (c->n_compared && !json_is_array(json_object_get(doc, "drift")))
        bad |= json_object_set_new(doc, "drift", json_array());
    for (uint32_t i = 0; i < c->n_compared; i++)
        bad |=
            json_array_append_new(json_object_get(doc, "drift"), compared_json(c, &c->compared[i]));
    return bad;
}

enum ls_err ls_checks_conclude(struct ls_checks *c, const struct ls_findings *findings,
                               json_t **conclusion, struct ls_diag *diag)
{
    return ls_led_sweep_conclude(&c->leds, findings, conclusion, diag);
}

enum ls_err ls_checks_put(struct ls_checks *c, json_t *conclusion, const char *take_json,
                          char **text, struct ls_diag *diag)
{
    json_t *doc = NULL;
    enum ls_err err = ls_take_json_read(take_json, &doc, diag);
    if (err)
        return err;
    pthread_mutex_lock(&c->lock);
    int bad = put(c, conclusion, doc);
    pthread_mutex_unlock(&c->lock);
    return ls_take_json_print(doc, bad, text, diag);
}
