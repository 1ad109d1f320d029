#include "daemon/plan_sweep.h"

#include <stdlib.h>

static uint64_t brightness(const struct ls_plan_condition *c, uint32_t n_lights)
{
    uint64_t sum = 0;
    for (uint32_t i = 0; i < c->lights.n_leds; i++)
        sum += c->lights.leds[i].level;
    return c->lights.kind == LS_CONDITION_SPHERE ? sum * n_lights : sum;
}

static const struct ls_plan_condition *brightest(const struct ls_plan_condition *asked, uint32_t n,
                                                 int32_t channel, uint32_t n_lights, bool *used)
{
    const struct ls_plan_condition *out = NULL;
    *used = false;
    for (uint32_t i = 0; i < n; i++) {
        if (asked[i].channel != channel)
            continue;
        *used = true;
        if (asked[i].light < 0 &&
            (!out || brightness(&asked[i], n_lights) > brightness(out, n_lights)))
            out = &asked[i];
    }
    return out;
}

static void add_channel(struct ls_conf *c, struct ls_plan_builder *b, uint16_t channel,
                        const uint16_t *lights, const struct ls_plan_condition *bright)
{
    const struct ls_plan_entry entry = {.builder = b,
                                        .channel = channel,
                                        .level = LS_PLAN_FULL_LEVEL,
                                        .lights = lights,
                                        .n_lights = b->config->n_lights,
                                        .backwards = channel % 2};
    struct ls_plan_condition *copy = bright ? ls_plan_add_condition(c, b) : NULL;
    if (copy)
        *copy = *bright;
    if (!c->err)
        ls_plan_add_each(c, &entry);
}

void ls_plan_make_sweep(struct ls_conf *c, struct ls_plan_builder *b)
{
    struct ls_plan *plan = b->plan;
    uint32_t n = plan->n_conditions, n_lights = b->config->n_lights;
    LS_CLEANUP_FREE struct ls_plan_condition *asked = plan->conditions;
    LS_CLEANUP_FREE uint16_t *lights = calloc(n_lights, sizeof *lights);
    plan->conditions = calloc(LS_PLAN_MAX_CONDITIONS, sizeof *plan->conditions);
    plan->n_conditions = 0;
    if (!plan->conditions || !lights) {
        c->err = LS_ERR_NOMEM;
        return;
    }
    for (uint32_t i = 0; i < n_lights; i++)
        lights[i] = (uint16_t)i;
    ls_plan_smooth(c, b->config, lights, n_lights);
    for (; plan->n_conditions < plan->n_exposures; plan->n_conditions++)
        plan->conditions[plan->n_conditions] = asked[plan->n_conditions];
    for (uint16_t k = 0; k < b->config->n_channels && !c->err; k++) {
        bool used;
        const struct ls_plan_condition *bright = brightest(asked, n, k, n_lights, &used);
        if (used)
            add_channel(c, b, k, lights, bright);
    }
}
