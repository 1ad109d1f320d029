#include "daemon/plan_between.h"

#include <stdio.h>
#include <stdlib.h>

enum { WATCH_FRAMES = 4, MAX_EVERY = 1000000 };

struct between {
    struct ls_plan_builder *builder;
    uint32_t every; /* shots, 0 = no references */
    uint16_t channels[LS_MAX_CHANNELS];
    uint32_t n_channels, level;
    uint32_t shots, lit;          /* since the last reference, the last watch */
    uint32_t references, watches; /* so far */
};

static void read_reference(struct ls_conf *c, struct between *b)
{
    const struct ls_config *config = b->builder->config;
    struct ls_conf group;
    ls_conf_begin(&group, ls_conf_child(c, "reference", CONFIG_TYPE_GROUP, false), c->file,
                  c->diag);
    b->every = (uint32_t)ls_conf_int(&group, "every", LS_REFERENCE_SHOTS, 0, MAX_EVERY);
    b->level = (uint32_t)ls_conf_int(&group, "level", LS_PLAN_SPHERE_LEVEL, 1, LS_PLAN_FULL_LEVEL);
    b->n_channels = ls_plan_read_channels(&group, config, b->channels, false);
    for (uint16_t i = 0; !b->n_channels && i < config->n_channels; i++)
        if (!config->channels[i].polariser) /* white stands first on a rig */
            b->channels[b->n_channels++] = i;
    b->every = b->n_channels && !b->builder->plan->sweep ? b->every : 0;
    c->err = c->err ? c->err : ls_conf_finish(&group);
}

static void add_watch(struct ls_conf *c, struct between *b)
{
    struct ls_plan *plan = b->builder->plan;
    struct ls_plan_condition *cond = ls_plan_add_condition(c, b->builder);
    if (!cond)
        return;
    cond->dark = true;
    cond->watch = true;
    cond->exposure = (uint8_t)(plan->n_exposures - 1);
    cond->repeats = WATCH_FRAMES;
    snprintf(cond->id, sizeof cond->id, "watch-%u", b->watches++);
    b->lit = 0;
}

static void add_references(struct ls_conf *c, struct between *b)
{
    for (uint32_t i = 0; i < b->n_channels && !c->err; i++) {
        const struct ls_plan_entry entry = {
            .builder = b->builder, .channel = b->channels[i], .level = (uint16_t)b->level};
        struct ls_plan_condition *cond = ls_plan_add_sphere(c, &entry);
        if (!cond)
            return;
        cond->reference = true;
        cond->pattern[0] = 0;
        cond->parts = 0;
        snprintf(cond->id, sizeof cond->id, "reference-%s-%02u",
                 b->builder->config->channels[b->channels[i]].name, b->references);
    }
    b->references++;
    b->shots = 0;
}

static void add_lit(struct ls_conf *c, struct between *b, const struct ls_plan_condition *lit)
{
    if (b->every && b->shots >= b->every)
        add_references(c, b);
    struct ls_plan_condition *cond = c->err ? NULL : ls_plan_add_condition(c, b->builder);
    if (!cond)
        return;
    *cond = *lit;
    b->shots += b->builder->plan->n_exposures;
    if (++b->lit == LS_WATCH_EVERY)
        add_watch(c, b);
}

void ls_plan_add_between(struct ls_conf *c, struct ls_plan_builder *builder)
{
    struct ls_plan *plan = builder->plan;
    struct between b = {.builder = builder};
    read_reference(c, &b);
    LS_CLEANUP_FREE struct ls_plan_condition *asked = plan->conditions;
    uint32_t n = plan->n_conditions, darks = plan->n_exposures;
    plan->conditions = calloc(LS_PLAN_MAX_CONDITIONS, sizeof *plan->conditions);
    plan->n_conditions = 0;
    if (!plan->conditions)
        c->err = c->err ? c->err : LS_ERR_NOMEM;
    if (c->err)
        return;
    if ((uint64_t)(n - darks) * plan->n_exposures <= b.every)
        b.every = 0;
    for (; plan->n_conditions < darks; plan->n_conditions++)
        plan->conditions[plan->n_conditions] = asked[plan->n_conditions];
    if (b.every)
        add_references(c, &b);
    for (uint32_t i = darks; i < n && !c->err; i++)
        add_lit(c, &b, &asked[i]);
    if (b.every && b.shots && !c->err)
        add_references(c, &b);
}
