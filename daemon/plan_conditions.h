/*
 * plan_conditions: the entries of a plan's `conditions`, read and given to their kinds.
 * Layer: daemon. Threads: as plan. Ownership: everything made belongs to the builder's plan.
 *
 * Private to plan. Errors stick to the ls_conf they are reported at.
 */
#ifndef LS_DAEMON_PLAN_CONDITIONS_H
#define LS_DAEMON_PLAN_CONDITIONS_H

#include "daemon/plan_builder.h"

/** Put @n rig rows in an order in which neighbours follow each other: core/smooth_order.h. */
void ls_plan_smooth(struct ls_conf *conf, const struct ls_config *config, uint16_t *lights,
                    uint32_t n);

/** Read `channels`, names of the rig's. Returns how many, 0 if absent and not @needed. */
uint32_t ls_plan_read_channels(struct ls_conf *conf, const struct ls_config *config,
                               uint16_t channels[LS_MAX_CHANNELS], bool needed);

/** Read the plan's `conditions`. */
void ls_plan_read_conditions(struct ls_conf *conf, struct ls_plan_builder *builder);

#endif
