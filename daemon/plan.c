#include "daemon/plan.h"

#include "daemon/conf_text.h"
#include "daemon/plan_between.h"
#include "daemon/plan_conditions.h"
#include "daemon/plan_sweep.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum {
    MAX_STEPS = 1 << 20,
    SETTLE_US = 100,
    TRIGGER_MARGIN_US = 500, /* pulse end to next pulse: sensor transfer and line latency */
};

static const char *const subject_words[] = {"still", "live", NULL};
static void read_exposures(struct ls_conf *c, struct ls_plan *plan)
{
    const config_setting_t *list = ls_conf_child(c, "exposures_us", CONFIG_TYPE_ARRAY, true);
    int n = list ? config_setting_length(list) : 0;
    if (list && (n < 1 || n > LS_MAX_EXPOSURES)) {
        ls_conf_error(c, "exposures_us", "%d exposures: expected 1 to %d", n, LS_MAX_EXPOSURES);
        return;
    }
    for (int i = 0; i < n && !c->err; i++) {
        int v = config_setting_get_int_elem(list, i);
        if (v < 1 || v > 10000000)
            ls_conf_error(c, "exposures_us",
                          "%d: expected whole microseconds of pulse, 1 to 10000000", v);
        else if (i && (uint32_t)v <= plan->pulse_us[i - 1])
            ls_conf_error(c, "exposures_us", "expected shortest first, each longer than the last");
        else
            plan->pulse_us[i] = (uint32_t)v;
    }
    plan->n_exposures = (uint32_t)n;
}

/* Darks stand before the lights: merging is online and needs them. */
static void add_darks(struct ls_conf *c, struct ls_plan_builder *b)
{
    uint32_t k = (uint32_t)ls_conf_int(c, "darks", 64, 2, 4096);
    for (uint32_t e = 0; e < b->plan->n_exposures && !c->err; e++) {
        struct ls_plan_condition *cond = ls_plan_add_condition(c, b);
        if (!cond)
            return;
        cond->lights = (struct ls_condition){.kind = LS_CONDITION_DARK};
        cond->dark = true;
        cond->exposure = (uint8_t)e;
        cond->repeats = (uint16_t)k;
        snprintf(cond->id, sizeof cond->id, "dark-%u", e);
    }
}

static void make_steps(struct ls_conf *c, struct ls_plan *plan)
{
    uint64_t n = 0;
    for (uint32_t i = 0; i < plan->n_conditions; i++) {
        struct ls_plan_condition *cond = &plan->conditions[i];
        cond->first_step = (uint32_t)n;
        cond->n_steps = cond->dark ? cond->repeats : plan->sweep ? 1 : plan->n_exposures;
        n += cond->n_steps;
    }
    if (n > MAX_STEPS) {
        ls_conf_error(c, "conditions", "%llu shots: expected at most %d", (unsigned long long)n,
                      MAX_STEPS);
        return;
    }
    plan->steps = calloc(n ? n : 1, sizeof *plan->steps);
    if (!plan->steps) {
        c->err = LS_ERR_NOMEM;
        return;
    }
    for (uint32_t i = 0; i < plan->n_conditions; i++) {
        const struct ls_plan_condition *cond = &plan->conditions[i];
        for (uint32_t k = 0; k < cond->n_steps; k++)
            plan->steps[plan->n_steps++] = (struct ls_plan_step){
                .condition = i,
                .repeat = cond->dark ? (uint16_t)k : 0,
                .exposure = cond->dark ? cond->exposure : (uint8_t)k,
            };
    }
}

/* The default period: as fast as the slowest camera allows, and room for the longest pulse. */
static uint32_t default_period_us(const struct ls_plan *plan, const struct ls_config *config)
{
    uint32_t longest = plan->pulse_us[plan->n_exposures - 1];
    double period = longest + plan->settle_us + TRIGGER_MARGIN_US;
    for (uint32_t i = 0; i < config->n_cameras; i++) {
        double least = 1e6 / config->cameras[i].max_fps;
        period = least > period ? least : period;
    }
    return (uint32_t)(period + 0.999);
}

static void read_plan(struct ls_conf *c, struct ls_plan_builder *b)
{
    struct ls_plan *plan = b->plan;
    plan->subject =
        ls_conf_word(c, "subject", subject_words, -1) ? LS_SUBJECT_LIVE : LS_SUBJECT_STILL;
    plan->allow_flashing = ls_conf_bool(c, "allow_flashing", false);
    plan->keep_raw = ls_conf_bool(c, "keep_raw", false);
    plan->sweep = ls_conf_bool(c, "sweep", false);
    read_exposures(c, plan);
    if (c->err)
        return;
    add_darks(c, b);
    ls_plan_read_conditions(c, b);
    if (!c->err && plan->sweep)
        ls_plan_make_sweep(c, b);
    if (!c->err)
        ls_plan_add_between(c, b);
    plan->settle_us = (uint32_t)ls_conf_int(c, "settle_us", SETTLE_US, 0, 1000000);
    uint32_t least = default_period_us(plan, b->config);
    plan->period_us = (uint32_t)ls_conf_int(c, "period_us", least, least, 60000000);
    if (!c->err)
        make_steps(c, plan);
}

enum ls_err ls_plan_parse(const char *text, const struct ls_config *config, struct ls_plan **out,
                          struct ls_diag *diag)
{
    config_t tree;
    struct ls_conf c;
    struct ls_plan_builder b = {.plan = calloc(1, sizeof *b.plan), .config = config};
    if (b.plan) {
        b.plan->conditions = calloc(LS_PLAN_MAX_CONDITIONS, sizeof *b.plan->conditions);
        b.plan->leds = calloc(LS_PLAN_MAX_LEDS, sizeof *b.plan->leds);
    }
    if (!b.plan || !b.plan->conditions || !b.plan->leds) {
        ls_plan_destroy(b.plan);
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for a plan");
    }
    config_init(&tree);
    enum ls_err err = ls_conf_text("plan", text, &tree, diag);
    if (!err) {
        ls_conf_begin(&c, config_root_setting(&tree), "plan", diag);
        read_plan(&c, &b);
        err = ls_conf_finish(&c);
    }
    config_destroy(&tree);
    if (err) {
        ls_plan_destroy(b.plan);
        return err;
    }
    *out = b.plan;
    return LS_OK;
}

void ls_plan_fit_current(struct ls_plan *plan, const struct ls_lights_info *lights)
{
    uint64_t most = 0, full = LS_PLAN_FULL_LEVEL;
    for (uint32_t i = 0; i < plan->n_conditions; i++)
        if (plan->conditions[i].fits_current && plan->conditions[i].lights.n_leds > most)
            most = plan->conditions[i].lights.n_leds;
    uint64_t drawn = most * lights->led_current_ma;
    uint64_t level = drawn > lights->max_current_ma ? full * lights->max_current_ma / drawn : full;
    for (uint32_t i = 0; i < plan->n_conditions; i++) {
        struct ls_plan_condition *c = &plan->conditions[i];
        if (!c->fits_current)
            continue;
        c->level = (uint16_t)(level ? level : 1);
        struct ls_led *leds = plan->leds + (c->lights.leds - plan->leds);
        for (uint32_t k = 0; k < c->lights.n_leds; k++)
            leds[k].level = c->level;
    }
}

double ls_plan_factor(const struct ls_plan_condition *condition, const struct ls_config *config,
                      const struct ls_calibration *calibration)
{
    if (!condition->pattern[0])
        return 1;
    int channel = ls_calibration_channel(calibration, config->channels[condition->channel].name);
    return channel < 0 ? 0
                       : ls_calibration_factor(calibration, (uint32_t)channel, condition->pattern,
                                               (double)condition->level / LS_PLAN_FULL_LEVEL);
}

void ls_plan_destroy(struct ls_plan *plan)
{
    if (!plan)
        return;
    free(plan->conditions);
    free(plan->steps);
    free(plan->leds);
    free(plan);
}
