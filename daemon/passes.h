/*
 * passes: programs for the controller, made from the plan's steps that are still wanted.
 *
 * A short program may be followed by the next within milliseconds. So that its first pulse does not
 * come before the cameras are ready again, it comes a whole period after arm.
 *
 * Layer: daemon. Threads: one. Ownership: an ls_pass owns its arrays; conditions point into the
 * plan.
 */
#ifndef LS_DAEMON_PASSES_H
#define LS_DAEMON_PASSES_H

#include "core/error.h"
#include "daemon/plan.h"
#include "drivers/lights.h"

#include <stdbool.h>
#include <stdint.h>

enum { LS_PASS_NO_STEP = 0xffffffffu };

struct ls_pass {
    struct ls_program program;
    struct ls_condition *conditions;
    struct ls_step *steps;
    uint32_t *plan_steps;   /* per step of the program; LS_PASS_NO_STEP: of none */
    uint32_t *condition_at; /* per condition of the plan: 1 + index in the program, or 0 */
    uint32_t capacity, n_plan_conditions;
};

/** Room for programs of up to @max_steps steps and @max_conditions conditions of @plan. */
LS_MUST_CHECK enum ls_err ls_pass_init(struct ls_pass *pass, const struct ls_plan *plan,
                                       uint32_t max_steps);

/** Zeroed passes are allowed. */
void ls_pass_finish(struct ls_pass *pass);

/**
 * The plan's steps from @first on for which @wanted says 1, in the plan's order, until the plan
 * ends or @info's memory (steps, conditions) is full. Returns the plan step to go on with, n_steps
 * at the end. @held: every step stays lit until the next grant.
 */
uint32_t ls_pass_fill(struct ls_pass *pass, const struct ls_plan *plan,
                      const struct ls_lights_info *info, const uint8_t *wanted, uint32_t first,
                      bool held);

/** One dark step of the plan's exposure @exposure, whose frames are nobody's. */
void ls_pass_fill_settling(struct ls_pass *pass, const struct ls_plan *plan, uint32_t exposure,
                           bool held);

#endif
