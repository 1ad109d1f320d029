#include "daemon/passes.h"

#include <stdlib.h>
#include <string.h>

enum { LONGEST_SETTLE_US = 1000000 }; /* of plans; a camera is ready again long before */

enum ls_err ls_pass_init(struct ls_pass *pass, const struct ls_plan *plan, uint32_t max_steps)
{
    *pass = (struct ls_pass){.capacity = plan->n_steps < max_steps ? plan->n_steps : max_steps,
                             .n_plan_conditions = plan->n_conditions};
    pass->conditions = calloc(plan->n_conditions + 1, sizeof *pass->conditions);
    pass->condition_at = calloc(plan->n_conditions + 1, sizeof *pass->condition_at);
    pass->steps = calloc(pass->capacity + 1, sizeof *pass->steps);
    pass->plan_steps = calloc(pass->capacity + 1, sizeof *pass->plan_steps);
    if (pass->conditions && pass->condition_at && pass->steps && pass->plan_steps)
        return LS_OK;
    ls_pass_finish(pass);
    return LS_ERR_NOMEM;
}

void ls_pass_finish(struct ls_pass *pass)
{
    free(pass->conditions);
    free(pass->condition_at);
    free(pass->steps);
    free(pass->plan_steps);
    *pass = (struct ls_pass){0};
}

static bool has_room(const struct ls_pass *pass, const struct ls_lights_info *info,
                     uint32_t condition)
{
    const struct ls_program *p = &pass->program;
    bool known = pass->condition_at[condition] > 0;
    return p->n_steps < pass->capacity && (known || p->n_conditions < info->max_conditions);
}

static void add_step(struct ls_pass *pass, const struct ls_plan *plan, uint32_t condition,
                     uint32_t exposure, bool held)
{
    uint32_t first_us = plan->period_us < LONGEST_SETTLE_US ? plan->period_us : LONGEST_SETTLE_US;
    bool longer = pass->program.n_steps == 0 && first_us > plan->settle_us;
    pass->steps[pass->program.n_steps++] =
        (struct ls_step){.condition = condition,
                         .pulse_us = plan->pulse_us[exposure],
                         .settle_us = longer ? first_us : plan->settle_us,
                         .flags = held ? LS_STEP_HOLD : 0};
}

static void add(struct ls_pass *pass, const struct ls_plan *plan, uint32_t plan_step, bool held)
{
    const struct ls_plan_step *step = &plan->steps[plan_step];
    uint32_t *at = &pass->condition_at[step->condition];
    struct ls_program *p = &pass->program;
    if (*at == 0) {
        pass->conditions[p->n_conditions] = plan->conditions[step->condition].lights;
        *at = ++p->n_conditions;
    }
    pass->plan_steps[p->n_steps] = plan_step;
    add_step(pass, plan, *at - 1, step->exposure, held);
}

static void begin(struct ls_pass *pass, const struct ls_plan *plan)
{
    memset(pass->condition_at, 0, pass->n_plan_conditions * sizeof *pass->condition_at);
    pass->program = (struct ls_program){
        .conditions = pass->conditions, .steps = pass->steps, .period_us = plan->period_us};
}

uint32_t ls_pass_fill(struct ls_pass *pass, const struct ls_plan *plan,
                      const struct ls_lights_info *info, const uint8_t *wanted, uint32_t first,
                      bool held)
{
    begin(pass, plan);
    for (uint32_t i = first; i < plan->n_steps; i++) {
        if (!wanted[i])
            continue;
        if (!has_room(pass, info, plan->steps[i].condition))
            return i;
        add(pass, plan, i, held);
    }
    return plan->n_steps;
}

void ls_pass_fill_settling(struct ls_pass *pass, const struct ls_plan *plan, uint32_t exposure,
                           bool held)
{
    begin(pass, plan);
    pass->conditions[pass->program.n_conditions++] =
        (struct ls_condition){.kind = LS_CONDITION_DARK};
    pass->plan_steps[0] = LS_PASS_NO_STEP;
    add_step(pass, plan, 0, exposure, held);
}
