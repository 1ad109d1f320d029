#include "daemon/bracket.h"

#include "core/merge.h"

const char *ls_bracket_name(enum ls_bracket bracket)
{
    return bracket == LS_BRACKET_OUTERMOST ? "outermost" : "width";
}

void ls_bracket_choose(struct ls_plan *plan, const struct ls_config *config)
{
    plan->bracket = LS_BRACKET_WIDTH;
    for (uint32_t k = 0; k < config->n_cameras; k++)
        if (config->cameras[k].driver.exposure == LS_EXPOSURE_TIMED)
            plan->bracket = LS_BRACKET_OUTERMOST;
    for (uint32_t i = 0; i < plan->n_conditions; i++)
        plan->keep_raw |= ls_bracket_keeps(plan, &plan->conditions[i]);
}

enum ls_err ls_bracket_check(const struct ls_plan *plan, const struct ls_config *config,
                             uint32_t camera, double offset_us, struct ls_diag *diag)
{
    const struct ls_config_camera *c = &config->cameras[camera];
    double used_s[LS_MAX_EXPOSURES], shorter_s = 0;
    for (uint32_t i = 0; i < plan->n_exposures; i++) {
        used_s[i] = (plan->pulse_us[i] + offset_us) * 1e-6;
        if (used_s[i] <= 0)
            return ls_fail(diag, LS_ERR_INVALID,
                           "exposures_us: %u us and the offset of camera %u (%g us) leave no "
                           "exposure",
                           plan->pulse_us[i], camera, offset_us);
    }
    if (!ls_merge_bracket_gaps(used_s, plan->n_exposures, c->range_low, c->range_high, &shorter_s))
        return LS_OK;
    return ls_fail(diag, LS_ERR_INVALID,
                   "exposures_us: the step after %g us leaves a gap: camera %u is linear from %g "
                   "to %g of full scale, so each exposure, its offset of %g us included, may be at "
                   "most %g times the one before",
                   shorter_s * 1e6 - offset_us, camera, c->range_low, c->range_high, offset_us,
                   c->range_high / c->range_low);
}

uint32_t ls_bracket_first_of_lights(const struct ls_plan *plan)
{
    return plan->bracket == LS_BRACKET_OUTERMOST ? plan->n_exposures : 1;
}

uint32_t ls_bracket_rounds(const struct ls_plan *plan)
{
    return 2 * ls_bracket_first_of_lights(plan);
}

int ls_bracket_exposure(const struct ls_plan *plan, uint32_t round)
{
    return plan->bracket == LS_BRACKET_OUTERMOST ? (int)(round % plan->n_exposures) : -1;
}

bool ls_bracket_in_round(const struct ls_plan *plan, uint32_t round, uint32_t step)
{
    const struct ls_plan_condition *of = &plan->conditions[plan->steps[step].condition];
    int exposure = ls_bracket_exposure(plan, round);
    bool first = of->dark && !of->watch;
    return first == (round < ls_bracket_first_of_lights(plan)) &&
           (exposure < 0 || plan->steps[step].exposure == exposure);
}

uint32_t ls_bracket_settling(const struct ls_plan *plan)
{
    return plan->bracket == LS_BRACKET_OUTERMOST && plan->n_exposures > 1
               ? ls_bracket_rounds(plan) - 1
               : 0;
}

bool ls_bracket_keeps(const struct ls_plan *plan, const struct ls_plan_condition *condition)
{
    return plan->bracket == LS_BRACKET_OUTERMOST && !condition->dark && condition->n_steps > 1;
}
