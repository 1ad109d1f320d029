#include "daemon/plan_custom.h"

#include "core/json_document.h"

#include <ctype.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { MAX_BYTES = 1 << 20 };

/** One item of the list. */
struct item {
    struct ls_conf *c;
    size_t index;
    const json_t *json;
};

static void wrong(const struct item *item, const char *key, const char *fmt, ...) LS_PRINTF(3, 4);
static void wrong(const struct item *item, const char *key, const char *fmt, ...)
{
    char text[256];
    va_list args;
    va_start(args, fmt);
    vsnprintf(text, sizeof text, fmt, args);
    va_end(args);
    if (!item->c->err)
        item->c->err = ls_fail(item->c->diag, LS_ERR_INVALID, "custom: conditions[%zu].%s: %s",
                               item->index, key, text);
}

static bool starts_with(const char *id, const char *word)
{
    return strncmp(id, word, strlen(word)) == 0;
}

static const char *read_id(const struct item *item)
{
    const char *id = json_string_value(json_object_get(item->json, "id"));
    size_t n = id ? strlen(id) : 0, good = 0;
    while (good < n && (isalnum((unsigned char)id[good]) || strchr("-_", id[good])))
        good++;
    if (n < 1 || good < n || n >= sizeof((struct ls_plan_condition *)0)->id)
        wrong(item, "id", "expected 1 to 31 letters, digits, '-' or '_', found \"%.40s\"",
              id ? id : "");
    else if (starts_with(id, "dark-") || starts_with(id, "watch-") || starts_with(id, "reference-"))
        wrong(item, "id", "\"%s\": names that begin so are the daemon's own", id);
    return id;
}

static void read_channel(const struct item *item, struct ls_plan_entry *entry)
{
    const char *name = json_string_value(json_object_get(item->json, "channel"));
    int channel = name ? ls_config_channel(entry->builder->config, name) : -1;
    if (channel < 0)
        wrong(item, "channel", "\"%.40s\": the rig has no such channel", name ? name : "");
    else
        entry->channel = (uint16_t)channel;
}

/* Whole numbers [low, high] of an array, or the one that stands for all @n. */
static void read_numbers(const struct item *item, const char *key, const json_t *value, long low,
                         long high, size_t n, uint16_t *out)
{
    for (size_t i = 0; i < n && !item->c->err; i++) {
        const json_t *number = json_is_array(value) ? json_array_get(value, i) : value;
        json_int_t v = json_integer_value(number);
        char where[48];
        snprintf(where, sizeof where, json_is_array(value) ? "%s[%zu]" : "%s", key, i);
        if (!json_is_integer(number) || v < low || v > high) {
            wrong(item, where, "expected a whole number %ld to %ld, found %lld", low, high,
                  (long long)v);
            return;
        }
        out[i] = (uint16_t)v;
    }
}

static void read_lights(const struct item *item, struct ls_plan_entry *entry, uint16_t *lights)
{
    const json_t *list = json_object_get(item->json, "lights");
    size_t n = json_array_size(list), most = entry->builder->config->n_lights;
    if (n < 1 || n > most) {
        wrong(item, "lights", "expected a list of 1 to %zu rows of the rig file, found %zu", most,
              n);
        return;
    }
    read_numbers(item, "lights", list, 0, (long)most - 1, n, lights);
    for (size_t i = 0; i < n; i++)
        for (size_t k = 0; k < i; k++)
            if (lights[i] == lights[k])
                wrong(item, "lights", "light %u stands twice", lights[i]);
    entry->n_lights = (uint32_t)n;
}

static void read_levels(const struct item *item, struct ls_plan_entry *entry, uint16_t *levels)
{
    const json_t *one = json_object_get(item->json, "level");
    const json_t *each = json_object_get(item->json, "levels");
    if (!one == !each)
        wrong(item, "level", "expected one of \"level\" and \"levels\"");
    if (each && json_array_size(each) != entry->n_lights)
        wrong(item, "levels", "expected a level for each of %u lights, found %zu", entry->n_lights,
              json_array_size(each));
    read_numbers(item, each ? "levels" : "level", each ? each : one, 1, LS_PLAN_FULL_LEVEL,
                 entry->n_lights, levels);
    for (uint32_t i = 0; i < entry->n_lights; i++)
        entry->level = levels[i] > entry->level ? levels[i] : entry->level;
}

static void refuse_unknown(const struct item *item)
{
    static const char *const keys[] = {"id", "channel", "lights", "level", "levels"};
    const char *key;
    json_t *value;
    json_object_foreach((json_t *)item->json, key, value)
    {
        bool known = false;
        for (size_t i = 0; i < sizeof keys / sizeof *keys; i++)
            known |= strcmp(key, keys[i]) == 0;
        if (!known)
            wrong(item, key, "unknown key: expected id, channel, lights, level or levels");
    }
}

static void read_item(const struct item *item, struct ls_plan_builder *b, size_t n_items,
                      uint16_t *numbers, double *weights)
{
    uint32_t n = b->config->n_lights;
    uint16_t *lights = numbers, *levels = numbers + n;
    struct ls_plan_entry entry = {.builder = b, .lights = lights};
    const char *id = read_id(item);
    read_channel(item, &entry);
    read_lights(item, &entry, lights);
    if (!item->c->err)
        read_levels(item, &entry, levels);
    refuse_unknown(item);
    for (uint32_t i = 0; i < entry.n_lights && !item->c->err; i++)
        weights[i] = (double)levels[i] / entry.level;
    struct ls_plan_condition *cond =
        item->c->err ? NULL : ls_plan_add_pattern(item->c, &entry, weights);
    if (!cond)
        return;
    cond->part = (uint16_t)item->index;
    cond->parts = (uint16_t)n_items;
    snprintf(cond->id, sizeof cond->id, "%s", id);
    snprintf(cond->pattern, sizeof cond->pattern, "custom");
}

static void read_list(struct ls_conf *c, struct ls_plan_builder *b, const json_t *root)
{
    const json_t *list = json_object_get(root, "conditions");
    size_t n = json_array_size(list);
    LS_CLEANUP_FREE uint16_t *numbers = calloc(2 * b->config->n_lights, sizeof *numbers);
    LS_CLEANUP_FREE double *weights = calloc(b->config->n_lights, sizeof *weights);
    if (!numbers || !weights)
        c->err = LS_ERR_NOMEM;
    else if (n < 1 || n > UINT16_MAX)
        c->err =
            ls_fail(c->diag, LS_ERR_INVALID,
                    "custom: conditions: expected a list of 1 to %d, found %zu", UINT16_MAX, n);
    for (size_t i = 0; i < n && !c->err; i++) {
        const struct item item = {c, i, json_array_get(list, i)};
        read_item(&item, b, n, numbers, weights);
    }
}

void ls_plan_read_custom(struct ls_conf *c, struct ls_plan_builder *b)
{
    LS_CLEANUP_FREE char *text = ls_conf_string(c, "custom", NULL);
    json_t *root = NULL;
    if (!text || c->err)
        return;
    c->err = ls_json_document("custom", text, strlen(text), MAX_BYTES, &root, c->diag);
    if (!c->err)
        read_list(c, b, root);
    json_decref(root);
}
