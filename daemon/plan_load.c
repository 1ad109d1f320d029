#include "daemon/plan_load.h"

#include "daemon/plan_builder.h"

#include <math.h>
#include <stdlib.h>

/* LEDs at full level that would give what a condition gives. */
static double whole_leds(const struct ls_condition *c, uint32_t n_lights)
{
    double sum = 0;
    for (uint32_t i = 0; i < c->n_leds; i++)
        sum += (double)c->leds[i].level / LS_PLAN_FULL_LEVEL;
    return c->kind == LS_CONDITION_SPHERE ? sum * n_lights : sum;
}

static double lit_s(const struct ls_plan *plan, const struct ls_plan_condition *c)
{
    double us = 0;
    for (uint32_t i = 0; i < c->n_steps; i++)
        us += plan->pulse_us[plan->steps[c->first_step + i].exposure];
    return us * 1e-6;
}

/* on[channel * n_lights + address]; a sphere is every address. */
static void add_on_time(double *on, const struct ls_condition *c, uint32_t n_lights, double s)
{
    for (uint32_t i = 0; i < c->n_leds; i++) {
        const struct ls_led *led = &c->leds[i];
        bool sphere = c->kind == LS_CONDITION_SPHERE;
        uint32_t first = sphere ? 0 : led->light, end = sphere ? n_lights : led->light + 1u;
        for (uint32_t k = first; k < end; k++)
            on[(size_t)led->channel * n_lights + k] += s * led->level / LS_PLAN_FULL_LEVEL;
    }
}

enum ls_err ls_plan_load(const struct ls_plan *plan, const struct ls_lights_info *lights,
                         struct ls_plan_load *out, struct ls_diag *diag)
{
    size_t n = (size_t)lights->n_lights * lights->n_channels;
    LS_CLEANUP_FREE double *on = calloc(n + 1, sizeof *on);
    *out = (struct ls_plan_load){0};
    if (!on)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for a plan's load");
    for (uint32_t i = 0; i < plan->n_conditions; i++) {
        const struct ls_plan_condition *c = &plan->conditions[i];
        double s = lit_s(plan, c), leds = whole_leds(&c->lights, lights->n_lights);
        out->energy_j += s * leds * lights->led_power_mw * 1e-3;
        out->peak_current_a = fmax(out->peak_current_a, leds * lights->led_current_ma * 1e-3);
        add_on_time(on, &c->lights, lights->n_lights, s);
    }
    for (size_t i = 0; i < n; i++)
        out->busiest_s = fmax(out->busiest_s, on[i]);
    return LS_OK;
}
