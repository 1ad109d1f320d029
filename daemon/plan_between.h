/*
 * plan_between: what stands between the conditions a plan asks for: watches and references.
 * Layer: daemon. Threads: as plan. Ownership: everything made belongs to the builder's plan.
 *
 * Private to plan. Errors stick to the ls_conf they are reported at.
 */
#ifndef LS_DAEMON_PLAN_BETWEEN_H
#define LS_DAEMON_PLAN_BETWEEN_H

#include "daemon/plan_conditions.h"

/** Read the plan's `reference` and put references and watches where plan.h says they stand. After
 * everything else was added: darks first, then what is lit. */
void ls_plan_add_between(struct ls_conf *conf, struct ls_plan_builder *builder);

#endif
