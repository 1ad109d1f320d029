#include "judge.h"

#include "daemon/take_facts.h"

#include <jansson.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* One exposure as the simulator knows it. */
struct shown {
    uint32_t camera;
    uint64_t camera_ns;
    double exposure_us;
    char kind[12];
    int64_t light; /* of a single LED, else -1 */
    int64_t channel;
};

struct shown_list {
    struct shown *item;
    size_t n, capacity;
};

static enum ls_err append(struct shown_list *list, const struct shown *shown)
{
    if (list->n == list->capacity) {
        size_t capacity = list->capacity ? 2 * list->capacity : 1024;
        struct shown *item = realloc(list->item, capacity * sizeof *item);
        if (!item)
            return LS_ERR_NOMEM;
        list->item = item;
        list->capacity = capacity;
    }
    list->item[list->n++] = *shown;
    return LS_OK;
}

static int64_t integer(const json_t *o, const char *key)
{
    const json_t *v = json_object_get(o, key);
    return json_is_integer(v) ? json_integer_value(v) : -1;
}

static enum ls_err read_line(struct shown_list *list, const char *line, size_t length,
                             unsigned number, struct ls_diag *diag)
{
    json_error_t error;
    json_t *o = json_loadb(line, length, 0, &error);
    if (!json_is_object(o)) {
        json_decref(o);
        return ls_fail(diag, LS_ERR_INVALID, "log line %u: %s", number, error.text);
    }
    const char *kind = json_string_value(json_object_get(o, "kind"));
    struct shown shown = { .camera = (uint32_t)integer(o, "camera"),
                           .camera_ns = (uint64_t)integer(o, "camera_ns"),
                           .exposure_us = json_number_value(json_object_get(o, "exposure_us")),
                           .light = integer(o, "light"),
                           .channel = integer(o, "channel") };
    snprintf(shown.kind, sizeof shown.kind, "%s", kind ? kind : "");
    json_decref(o);
    if (!kind)
        return ls_fail(diag, LS_ERR_INVALID, "log line %u: key kind is missing", number);
    return append(list, &shown);
}

static int by_time(const void *a, const void *b)
{
    const struct shown *x = a, *y = b;
    if (x->camera != y->camera)
        return x->camera < y->camera ? -1 : 1;
    return x->camera_ns < y->camera_ns ? -1 : x->camera_ns > y->camera_ns;
}

static enum ls_err read_log(const char *log, struct shown_list *list, struct ls_diag *diag)
{
    unsigned number = 1;
    for (const char *stop; *log; log = stop + (*stop == '\n'), number++) {
        stop = strchrnul(log, '\n');
        enum ls_err err = read_line(list, log, (size_t)(stop - log), number, diag);
        if (err)
            return err;
    }
    if (list->n)
        qsort(list->item, list->n, sizeof *list->item, by_time);
    return LS_OK;
}

static const struct shown *find(const struct shown_list *list, const struct ls_ticket *t)
{
    const struct shown key = { .camera = t->camera, .camera_ns = t->camera_ns };
    return list->n ? bsearch(&key, list->item, list->n, sizeof key, by_time) : NULL;
}

/* Why this frame is not what its ticket says; false = it is. */
static bool wrong(const struct ls_take_facts *facts, const struct ls_ticket *t,
                  const struct shown *shown, char *why, size_t room)
{
    const struct ls_condition_fact *c = &facts->conditions[t->condition];
    static const char *const kinds[] = { "", "dark", "one", "sphere" };
    int64_t channel = c->kind == LS_FACT_ONE || c->kind == LS_FACT_SPHERE ? (int64_t)c->channel : -1;
    int64_t light = c->kind == LS_FACT_ONE ? (int64_t)c->light : -1;
    if (!shown)
        snprintf(why, room, "shot %u (%s): no frame was exposed at camera time %llu", t->shot, c->id,
                 (unsigned long long)t->camera_ns);
    else if (c->kind != LS_FACT_OTHER &&
             (strcmp(shown->kind, kinds[c->kind]) || shown->light != light ||
              shown->channel != channel))
        snprintf(why, room, "shot %u (%s): lit by %s light %lld channel %lld", t->shot, c->id,
                 shown->kind, (long long)shown->light, (long long)shown->channel);
    else if (fabs(shown->exposure_us - t->exposure_used_us) > 1) /* the controller's unit is 1 us */
        snprintf(why, room, "shot %u (%s): exposed %.1f us, the ticket says %.1f", t->shot, c->id,
                 shown->exposure_us, t->exposure_used_us);
    else
        return false;
    return true;
}

enum ls_err judge_check_labels(const struct ls_takedir *take, const char *log,
                               struct judge_labels *out, struct ls_diag *diag)
{
    struct shown_list list = { 0 };
    struct ls_take_facts *facts = NULL;
    enum ls_err err = ls_take_facts_read(take->take_json, 0, &facts, diag);
    if (!err)
        err = read_log(log, &list, diag);
    *out = (struct judge_labels){ 0 };
    for (size_t i = 0; i < take->n_tickets && !err; i++) {
        const struct ls_ticket *t = &take->tickets[i];
        char why[256];
        if (t->status != LS_FRAME_OK)
            continue;
        out->checked++;
        if (t->condition >= facts->n_conditions ||
            !wrong(facts, t, find(&list, t), why, sizeof why))
            continue;
        if (!out->mislabeled++)
            snprintf(out->first, sizeof out->first, "%s", why);
    }
    free(list.item);
    ls_take_facts_destroy(facts);
    return err;
}
