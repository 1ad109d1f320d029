#include "judge.h"

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
    int64_t light; /* controller address of a single LED, else -1 */
    int64_t channel, n_leds;
};

/* What a condition of the plan should show, in the controller's numbers. */
struct planned {
    char id[64], kind[12];
    int64_t light, channel, n_leds; /* -1: any */
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
    struct shown shown = {.camera = (uint32_t)integer(o, "camera"),
                          .camera_ns = (uint64_t)integer(o, "camera_ns"),
                          .exposure_us = json_number_value(json_object_get(o, "exposure_us")),
                          .light = integer(o, "light"),
                          .channel = integer(o, "channel"),
                          .n_leds = integer(o, "n_leds")};
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
    const struct shown key = {.camera = t->camera, .camera_ns = t->camera_ns};
    return list->n ? bsearch(&key, list->item, list->n, sizeof key, by_time) : NULL;
}

static int64_t channel_index(const json_t *rig, const char *name)
{
    const json_t *channels = json_object_get(rig, "channels");
    for (size_t i = 0; name && i < json_array_size(channels); i++) {
        const char *other = json_string_value(json_object_get(json_array_get(channels, i), "name"));
        if (other && !strcmp(name, other))
            return (int64_t)i;
    }
    return -1;
}

static struct planned read_condition(const json_t *c, const json_t *rig)
{
    const json_t *address = json_object_get(json_object_get(rig, "lights"), "address");
    const char *kind = json_string_value(json_object_get(c, "kind"));
    const char *id = json_string_value(json_object_get(c, "id"));
    const char *channel = json_string_value(json_object_get(c, "channel"));
    int64_t row = integer(c, "light");
    struct planned out = {.channel = channel_index(rig, channel), .n_leds = -1};
    snprintf(out.kind, sizeof out.kind, "%s", kind ? kind : "");
    snprintf(out.id, sizeof out.id, "%s", id ? id : "");
    out.light = row >= 0 ? json_integer_value(json_array_get(address, (size_t)row)) : -1;
    if (!strcmp(out.kind, "segment") || !strcmp(out.kind, "list"))
        out.n_leds = (int64_t)json_array_size(json_object_get(c, "lights"));
    return out;
}

/* The conditions of take.json. (transfer full), free(). */
static struct planned *read_plan(const char *take_json, uint32_t *n, struct ls_diag *diag)
{
    json_error_t error;
    json_t *doc = json_loads(take_json, 0, &error);
    const json_t *conditions = json_object_get(json_object_get(doc, "plan"), "conditions");
    *n = (uint32_t)json_array_size(conditions);
    struct planned *out = *n ? calloc(*n, sizeof *out) : NULL;
    for (uint32_t i = 0; out && i < *n; i++)
        out[i] = read_condition(json_array_get(conditions, i), json_object_get(doc, "rig"));
    if (!out)
        ls_fail(diag, LS_ERR_INVALID, "take.json: no conditions: %s", doc ? "" : error.text);
    json_decref(doc);
    return out;
}

static bool lit_otherwise(const struct planned *p, const struct shown *shown)
{
    bool one_led = p->n_leds == 1; /* of a segment or a list: the log names a single LED */
    return strcmp(shown->kind, p->kind) || (!one_led && shown->light != p->light) ||
           shown->channel != p->channel || (p->n_leds >= 0 && shown->n_leds != p->n_leds);
}

/* Why this frame is not what its ticket says; false = it is. */
static bool wrong(const struct planned *p, const struct ls_ticket *t, const struct shown *shown,
                  char *why, size_t room)
{
    if (!shown)
        snprintf(why, room, "shot %u (%s): no frame was exposed at camera time %llu", t->shot,
                 p->id, (unsigned long long)t->camera_ns);
    else if (lit_otherwise(p, shown))
        snprintf(why, room, "shot %u (%s): lit by %s light %lld channel %lld, %lld LEDs", t->shot,
                 p->id, shown->kind, (long long)shown->light, (long long)shown->channel,
                 (long long)shown->n_leds);
    else if (fabs(shown->exposure_us - t->exposure_used_us) > 1) /* the controller's unit is 1 us */
        snprintf(why, room, "shot %u (%s): exposed %.1f us, the ticket says %.1f", t->shot, p->id,
                 shown->exposure_us, t->exposure_used_us);
    else
        return false;
    return true;
}

enum ls_err judge_check_labels(const struct ls_takedir *take, const char *log,
                               struct judge_labels *out, struct ls_diag *diag)
{
    struct shown_list list = {0};
    uint32_t n = 0;
    struct planned *plan = read_plan(take->take_json, &n, diag);
    enum ls_err err = plan ? read_log(log, &list, diag) : LS_ERR_INVALID;
    *out = (struct judge_labels){0};
    for (size_t i = 0; i < take->n_tickets && !err; i++) {
        const struct ls_ticket *t = &take->tickets[i];
        char why[256];
        if (t->status != LS_FRAME_OK)
            continue;
        out->checked++;
        if (t->condition < n && !wrong(&plan[t->condition], t, find(&list, t), why, sizeof why))
            continue;
        if (t->condition >= n)
            snprintf(why, sizeof why, "shot %u: condition %u is not in the plan", t->shot,
                     t->condition);
        if (!out->mislabeled++)
            snprintf(out->first, sizeof out->first, "%s", why);
    }
    free(list.item);
    free(plan);
    return err;
}
