#include "daemon/plan_builder.h"

#include <math.h>
#include <stdio.h>

static struct ls_led *add_leds(struct ls_conf *c, struct ls_plan_builder *b, uint32_t n)
{
    if (n > LS_PLAN_MAX_LEDS - b->n_leds) {
        ls_conf_error(c, "kind", "the plan names more than %d LEDs", LS_PLAN_MAX_LEDS);
        return NULL;
    }
    struct ls_led *leds = b->plan->leds + b->n_leds;
    b->n_leds += n;
    return leds;
}

struct ls_plan_condition *ls_plan_add_condition(struct ls_conf *c, struct ls_plan_builder *b)
{
    if (b->plan->n_conditions == LS_PLAN_MAX_CONDITIONS) {
        ls_conf_error(c, "kind", "the plan has more than %d conditions", LS_PLAN_MAX_CONDITIONS);
        return NULL;
    }
    struct ls_plan_condition *out = &b->plan->conditions[b->plan->n_conditions++];
    *out = (struct ls_plan_condition){.light = -1, .channel = -1, .repeats = 1};
    return out;
}

/* A condition of @n LEDs of the entry's channel, still without addresses and levels. */
static struct ls_plan_condition *add_lit(struct ls_conf *c, const struct ls_plan_entry *e,
                                         enum ls_condition_kind kind, uint32_t n,
                                         struct ls_led **leds)
{
    *leds = add_leds(c, e->builder, n);
    struct ls_plan_condition *cond = *leds ? ls_plan_add_condition(c, e->builder) : NULL;
    if (!cond)
        return NULL;
    for (uint32_t i = 0; i < n; i++)
        (*leds)[i] = (struct ls_led){.channel = e->channel, .level = e->level};
    cond->lights = (struct ls_condition){kind, n, *leds};
    cond->channel = e->channel;
    cond->level = e->level;
    cond->fits_current = e->fits_current;
    cond->parts = 1;
    return cond;
}

/* The controller's address of a row of the rig file. */
static uint16_t address(const struct ls_plan_entry *e, uint32_t i)
{
    return (uint16_t)e->builder->config->lights[e->lights[i]].address;
}

static uint16_t level_of(const struct ls_plan_entry *e, double weight)
{
    return (uint16_t)lrint(e->level * weight);
}

struct ls_plan_condition *ls_plan_add_pattern(struct ls_conf *c, const struct ls_plan_entry *e,
                                              const double *weights)
{
    uint32_t lit = 0, whole = 0;
    for (uint32_t i = 0; i < e->n_lights; i++) {
        lit += level_of(e, weights[i]) > 0;
        whole += level_of(e, weights[i]) == e->level;
    }
    if (!lit) {
        ls_conf_error(c, "level", "%u: no light would be lit", e->level);
        return NULL;
    }
    struct ls_led *leds;
    struct ls_plan_condition *cond =
        add_lit(c, e, lit == whole ? LS_CONDITION_SEGMENT : LS_CONDITION_LIST, lit, &leds);
    for (uint32_t i = 0, k = 0; cond && i < e->n_lights; i++) {
        uint16_t level = level_of(e, weights[i]);
        if (level)
            leds[k++] = (struct ls_led){address(e, i), e->channel, level};
    }
    return cond;
}

static const char *name_of(const struct ls_plan_entry *e)
{
    return e->builder->config->channels[e->channel].name;
}

void ls_plan_add_each(struct ls_conf *c, const struct ls_plan_entry *e)
{
    for (uint32_t k = 0; k < e->n_lights && !c->err; k++) {
        uint32_t i = e->backwards ? e->n_lights - 1 - k : k;
        struct ls_led *led;
        struct ls_plan_condition *cond = add_lit(c, e, LS_CONDITION_ONE, 1, &led);
        if (!cond)
            return;
        led->light = address(e, i);
        cond->light = e->lights[i];
        cond->parts = 0;
        snprintf(cond->id, sizeof cond->id, "%s-%04u", name_of(e), e->lights[i]);
    }
}

struct ls_plan_condition *ls_plan_add_sphere(struct ls_conf *c, const struct ls_plan_entry *e)
{
    struct ls_led *led;
    struct ls_plan_condition *cond = add_lit(c, e, LS_CONDITION_SPHERE, 1, &led);
    if (!cond)
        return NULL;
    snprintf(cond->id, sizeof cond->id, "sphere-%s", name_of(e));
    snprintf(cond->pattern, sizeof cond->pattern, "sphere");
    return cond;
}

void ls_plan_add_named(struct ls_conf *c, const struct ls_plan_entry *e)
{
    struct ls_led *leds;
    struct ls_plan_condition *cond = add_lit(c, e, LS_CONDITION_SEGMENT, e->n_lights, &leds);
    if (!cond)
        return;
    for (uint32_t i = 0; i < e->n_lights; i++)
        leds[i].light = address(e, i);
    snprintf(cond->id, sizeof cond->id, "segment%u-%s", e->builder->named, name_of(e));
    snprintf(cond->pattern, sizeof cond->pattern, "lights-%u", e->n_lights);
}
