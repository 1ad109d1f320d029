#include "daemon/plan_conditions.h"

#include "core/segments.h"
#include "core/smooth_order.h"
#include "daemon/plan_custom.h"
#include "daemon/plan_patterns.h"

#include <stdlib.h>
#include <string.h>

enum {
    FULL = LS_PLAN_FULL_LEVEL,
    BASIS_LEVEL = FULL / 9,  /* finer steps than a sphere's: its weights are what is decoded */
    LEAST_BASIS_LEVEL = 500, /* half a step is a thousandth */
    MAX_DEGREE = 9,
};

static const char *const kind_words[] = {"each",      "sphere",    "segment",
                                         "segments",  "headlight", "multiplex",
                                         "harmonics", "gradients", NULL};
enum kind {
    KIND_EACH,
    KIND_SPHERE,
    KIND_SEGMENT,
    KIND_SEGMENTS,
    KIND_HEADLIGHT,
    KIND_MULTIPLEX,
    KIND_HARMONICS,
    KIND_GRADIENTS,
};

/* What an entry says beside channels, lights and level. */
struct options {
    enum kind kind;
    uint32_t count, degree;
    bool pairs;
};

static void add(struct ls_conf *c, const struct ls_plan_entry *e, const struct options *o)
{
    switch (o->kind) {
    case KIND_EACH:
        ls_plan_add_each(c, e);
        break;
    case KIND_SPHERE:
        ls_plan_add_sphere(c, e);
        break;
    case KIND_SEGMENT:
        ls_plan_add_named(c, e);
        break;
    case KIND_SEGMENTS:
        ls_plan_add_segments(c, e, o->count);
        break;
    case KIND_HEADLIGHT:
        ls_plan_add_headlight(c, e);
        break;
    case KIND_MULTIPLEX:
        ls_plan_add_multiplex(c, e);
        break;
    case KIND_HARMONICS:
        ls_plan_add_harmonics(c, e, o->degree, o->pairs);
        break;
    case KIND_GRADIENTS:
        ls_plan_add_gradients(c, e);
        break;
    }
}

/* ---- reading ---- */

static uint32_t usual_lights(const struct ls_config *config, enum kind kind, uint16_t *lights)
{
    uint32_t n = config->n_lights;
    if (kind == KIND_HEADLIGHT) {
        n = n < LS_HEADLIGHT_LIGHTS ? n : LS_HEADLIGHT_LIGHTS;
        ls_plan_lights_near_camera(config, lights, n);
        return n;
    }
    for (uint32_t i = 0; i < n; i++)
        lights[i] = (uint16_t)i;
    return n;
}

static bool is_repeated(const uint16_t *lights, int n)
{
    for (int i = 0; i < n; i++)
        if (lights[i] == lights[n])
            return true;
    return false;
}

/* lights = [0, 5, 7] of the kinds that leave the choice, else every light. Returns how many; the
 * array is the caller's. */
static uint32_t read_lights(struct ls_conf *c, const struct ls_config *config, enum kind kind,
                            uint16_t *lights)
{
    bool chosen = kind == KIND_EACH || kind == KIND_SEGMENT || kind == KIND_HEADLIGHT;
    const config_setting_t *list =
        chosen ? ls_conf_child(c, "lights", CONFIG_TYPE_ARRAY, kind == KIND_SEGMENT) : NULL;
    if (!list)
        return usual_lights(config, kind, lights);
    int n = config_setting_length(list);
    if (n < 1 || n > (int)config->n_lights) {
        ls_conf_error(c, "lights", "%d lights: expected 1 to %u", n, config->n_lights);
        return 0;
    }
    for (int i = 0; i < n; i++) {
        int v = config_setting_get_int_elem(list, i);
        if (v < 0 || v >= (int)config->n_lights) {
            ls_conf_error(c, "lights", "light %d: expected 0 to %u (rows of the rig file)", v,
                          config->n_lights - 1);
            return 0;
        }
        lights[i] = (uint16_t)v;
        if (is_repeated(lights, i)) {
            ls_conf_error(c, "lights", "light %d stands twice", v);
            return 0;
        }
    }
    return (uint32_t)n;
}

uint32_t ls_plan_read_channels(struct ls_conf *c, const struct ls_config *config,
                               uint16_t channels[LS_MAX_CHANNELS], bool needed)
{
    const config_setting_t *list = ls_conf_child(c, "channels", CONFIG_TYPE_ARRAY, needed);
    int n = list ? config_setting_length(list) : 0;
    if (list && (n < 1 || n > LS_MAX_CHANNELS))
        ls_conf_error(c, "channels", "%d channels: expected 1 to %d", n, LS_MAX_CHANNELS);
    for (int i = 0; i < n && !c->err; i++) {
        const char *name = config_setting_get_string_elem(list, i);
        int channel = name ? ls_config_channel(config, name) : -1;
        if (channel < 0)
            ls_conf_error(c, "channels", "\"%s\": the rig has no such channel", name ? name : "?");
        else
            channels[i] = (uint16_t)channel;
    }
    return c->err ? 0 : (uint32_t)n;
}

void ls_plan_smooth(struct ls_conf *c, const struct ls_config *config, uint16_t *lights, uint32_t n)
{
    LS_CLEANUP_FREE float(*directions)[3] = calloc(n, sizeof *directions);
    LS_CLEANUP_FREE uint32_t *order = calloc(n, sizeof *order);
    LS_CLEANUP_FREE uint16_t *given = calloc(n, sizeof *given);
    struct ls_diag diag = {{0}};
    if (!directions || !order || !given) {
        c->err = LS_ERR_NOMEM;
        return;
    }
    memcpy(given, lights, n * sizeof *given);
    for (uint32_t i = 0; i < n; i++)
        memcpy(directions[i], config->lights[given[i]].position_m, sizeof directions[i]);
    if (ls_smooth_order((const float(*)[3])directions, n, order, &diag))
        ls_conf_error(c, "order", "%s", diag.text);
    for (uint32_t i = 0; i < n && !c->err; i++)
        lights[i] = given[order[i]];
}

/* order = "smooth" of the lights one by one; those that the plan names stay as it names them,
 * unless it says so. Returns if they are smooth. */
static bool put_in_order(struct ls_conf *c, const struct ls_config *config, uint16_t *lights,
                         uint32_t n)
{
    static const char *const words[] = {"smooth", "given", NULL};
    bool named = config_setting_get_member(c->group, "lights") != NULL;
    if (ls_conf_word(c, "order", words, named) != 0 || c->err)
        return false;
    ls_plan_smooth(c, config, lights, n);
    return true;
}

/* The brightest level that shows a white sample about as bright as one front light does; the bases
 * are brighter: multiplexing, which pays near full duty only, as bright as the controller can. */
static int64_t usual_level(const struct options *o, uint32_t n_lights)
{
    switch (o->kind) {
    case KIND_SPHERE:
        return LS_PLAN_SPHERE_LEVEL;
    case KIND_SEGMENTS: /* its lights stand together: all may face the same way */
        return o->count ? FULL / ((n_lights + o->count - 1) / o->count) : FULL;
    case KIND_HEADLIGHT:
        return n_lights ? FULL / n_lights : FULL;
    case KIND_HARMONICS:
    case KIND_GRADIENTS:
        return BASIS_LEVEL;
    default:
        return FULL;
    }
}

static struct options read_options(struct ls_conf *c, uint32_t n_lights)
{
    static const char *const forms[] = {"pairs", "biased", NULL};
    struct options o = {.kind = (enum kind)ls_conf_word(c, "kind", kind_words, -1)};
    if (o.kind == KIND_SEGMENTS) {
        o.count = (uint32_t)ls_conf_int(c, "count", 0, 0, n_lights);
        if (!o.count)
            ls_conf_error(c, "count", "expected 1 to %u segments", n_lights);
    }
    if (o.kind == KIND_HARMONICS) {
        o.degree = (uint32_t)ls_conf_int(c, "degree", 2, 0, MAX_DEGREE);
        o.pairs = ls_conf_word(c, "form", forms, 0) == 0;
    }
    return o;
}

static void read_condition(struct ls_conf *list, const config_setting_t *group,
                           struct ls_plan_builder *b, uint16_t *lights)
{
    struct ls_conf c;
    ls_conf_begin(&c, group, list->file, list->diag);
    struct options options = read_options(&c, b->config->n_lights);
    uint16_t channels[LS_MAX_CHANNELS];
    uint32_t n_channels = ls_plan_read_channels(&c, b->config, channels, true);
    struct ls_plan_entry entry = {.builder = b, .lights = lights};
    entry.n_lights = read_lights(&c, b->config, options.kind, lights);
    entry.fits_current =
        options.kind == KIND_MULTIPLEX && !config_setting_get_member(group, "level");
    entry.level =
        (uint16_t)ls_conf_int(&c, "level", usual_level(&options, entry.n_lights), 1, FULL);
    if (options.kind == KIND_EACH && entry.level != FULL)
        ls_conf_error(&c, "level",
                      "%u: single lights are photographed at %d: R = k E holds for "
                      "what k was measured at",
                      entry.level, FULL);
    if ((options.kind == KIND_HARMONICS || options.kind == KIND_GRADIENTS) &&
        entry.level < LEAST_BASIS_LEVEL)
        ls_conf_error(&c, "level",
                      "%u: the weights of a basis are rounded to whole levels: expected at least "
                      "%d, a part in a thousand",
                      entry.level, LEAST_BASIS_LEVEL);
    bool smooth =
        options.kind == KIND_SEGMENTS || (options.kind == KIND_EACH && !c.err &&
                                          put_in_order(&c, b->config, lights, entry.n_lights));
    for (uint32_t k = 0; k < n_channels && !c.err; k++) {
        entry.channel = channels[k];
        entry.backwards = smooth && k % 2;
        add(&c, &entry, &options);
    }
    b->named += options.kind == KIND_SEGMENT;
    list->err = list->err ? list->err : ls_conf_finish(&c);
}

static int by_id(const void *a, const void *b)
{
    const struct ls_plan_condition *const *x = a, *const *y = b;
    return strcmp((*x)->id, (*y)->id);
}

static void refuse_repeats(struct ls_conf *c, const struct ls_plan *plan)
{
    LS_CLEANUP_FREE const struct ls_plan_condition **sorted =
        calloc(plan->n_conditions + 1, sizeof *sorted);
    if (!sorted) {
        c->err = LS_ERR_NOMEM;
        return;
    }
    for (uint32_t i = 0; i < plan->n_conditions; i++)
        sorted[i] = &plan->conditions[i];
    qsort(sorted, plan->n_conditions, sizeof *sorted, by_id);
    for (uint32_t i = 1; i < plan->n_conditions && !c->err; i++)
        if (!strcmp(sorted[i - 1]->id, sorted[i]->id))
            ls_conf_error(c, "conditions", "%s is asked for twice", sorted[i]->id);
}

void ls_plan_read_conditions(struct ls_conf *c, struct ls_plan_builder *b)
{
    bool custom = config_setting_get_member(c->group, "custom") != NULL;
    const config_setting_t *list = ls_conf_child(c, "conditions", CONFIG_TYPE_LIST, !custom);
    LS_CLEANUP_FREE uint16_t *lights = calloc(b->config->n_lights, sizeof *lights);
    if (!lights)
        c->err = LS_ERR_NOMEM;
    int n = list ? config_setting_length(list) : 0;
    if (list && !n)
        ls_conf_error(c, "conditions", "empty: nothing to photograph");
    for (int i = 0; i < n && !c->err; i++)
        read_condition(c, config_setting_get_elem(list, (unsigned)i), b, lights);
    ls_plan_read_custom(c, b);
    if (!c->err)
        refuse_repeats(c, b->plan);
}
