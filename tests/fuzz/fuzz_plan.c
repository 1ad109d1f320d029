/* plan: what a client asks for. A plan that is accepted shows only LEDs of the rig, in steps that
 * belong to its conditions, and its ids are names of files. */
#include "daemon/plan.h"
#include "tests/fuzz/fuzz.h"
#include "tests/fuzz/fuzz_rig.h"

#include <string.h>

static const char id_letters[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789_-";

static int is_address(const struct ls_config *config, uint32_t address)
{
    for (uint32_t i = 0; i < config->n_lights; i++)
        if (config->lights[i].address == address)
            return 1;
    return 0;
}

static void check_condition(const struct ls_plan_condition *c, const struct ls_config *config)
{
    size_t length = strnlen(c->id, sizeof c->id);
    HOLDS(length > 0 && length < sizeof c->id && strspn(c->id, id_letters) == length);
    HOLDS(memchr(c->pattern, 0, sizeof c->pattern));
    HOLDS(c->light < (int32_t)config->n_lights && c->channel < (int32_t)config->n_channels);
    HOLDS(c->dark == (c->channel < 0));
    for (uint32_t k = 0; k < c->lights.n_leds; k++) {
        HOLDS(is_address(config, c->lights.leds[k].light));
        HOLDS(c->lights.leds[k].channel < config->n_channels && c->lights.leds[k].level);
    }
}

static void check(const struct ls_plan *plan, const struct ls_config *config)
{
    uint32_t steps = 0;
    HOLDS(plan->n_exposures >= 1 && plan->n_exposures <= LS_MAX_EXPOSURES);
    HOLDS(plan->period_us > plan->pulse_us[plan->n_exposures - 1]);
    for (uint32_t i = 0; i < plan->n_conditions; i++) {
        const struct ls_plan_condition *c = &plan->conditions[i];
        check_condition(c, config);
        HOLDS(c->first_step == steps && c->n_steps > 0);
        for (uint32_t k = 0; k < c->n_steps; k++, steps++)
            HOLDS(plan->steps[steps].condition == i &&
                  plan->steps[steps].exposure < plan->n_exposures);
    }
    HOLDS(steps == plan->n_steps);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t n)
{
    const struct ls_config *config = fuzz_rig();
    struct ls_plan *plan = NULL;
    struct ls_diag diag = {0};
    char *text = fuzz_text(data, n);
    enum ls_err err = ls_plan_parse(text, config, &plan, &diag);
    free(text);
    HOLDS_REFUSED(err, diag);
    HOLDS(!err == !!plan);
    if (plan)
        check(plan, config);
    ls_plan_destroy(plan);
    return 0;
}
