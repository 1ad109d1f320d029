/*
 * plan_sweep: a plan made short: what shows whether the rig is fit for it.
 * Layer: daemon. Threads: as plan. Ownership: everything made belongs to the builder's plan.
 *
 * Private to plan. A plan with `sweep = true` photographs, in each channel that it uses, the
 * brightest of its pictures of several lights, and every light alone, all at the shortest exposure;
 * its darks are those of the whole bracket. What that says of the rig is the take's "checks"
 * (daemon/led_sweep.h).
 */
#ifndef LS_DAEMON_PLAN_SWEEP_H
#define LS_DAEMON_PLAN_SWEEP_H

#include "daemon/plan_conditions.h"

/** Replace the conditions that were read by those of the sweep; darks stay. */
void ls_plan_make_sweep(struct ls_conf *conf, struct ls_plan_builder *builder);

#endif
