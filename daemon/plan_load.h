/*
 * plan_load: what a plan asks of the LEDs: energy, current, how long the busiest one is lit.
 * Layer: daemon. Threads: any. Ownership: nothing is kept.
 */
#ifndef LS_DAEMON_PLAN_LOAD_H
#define LS_DAEMON_PLAN_LOAD_H

#include "core/error.h"
#include "daemon/plan.h"
#include "drivers/lights.h"

struct ls_plan_load {
    double energy_j;       /* of all LEDs over the plan, by the controller's power of one */
    double peak_current_a; /* of the brightest condition */
    double busiest_s;      /* on-time of the LED that is lit longest, at full level */
};

/** Every address of the plan exists on the controller. LS_ERR_NOMEM. */
LS_MUST_CHECK enum ls_err ls_plan_load(const struct ls_plan *plan,
                                       const struct ls_lights_info *lights,
                                       struct ls_plan_load *out, struct ls_diag *diag);

#endif
