/*
 * plan_patterns: the kinds of a plan that light several lights by a rule.
 * Layer: daemon. Threads: as plan. Ownership: everything made belongs to the entry's builder.
 *
 * Private to plan_conditions. Each adds the conditions of one channel of an entry; errors stick to
 * the ls_conf.
 */
#ifndef LS_DAEMON_PLAN_PATTERNS_H
#define LS_DAEMON_PLAN_PATTERNS_H

#include "daemon/plan_builder.h"

/** The lights in @count groups of neighbours (core/segments.h): "segment-R-03" of "segments-14". */
void ls_plan_add_segments(struct ls_conf *conf, const struct ls_plan_entry *entry, uint32_t count);

/** The entry's lights at once: "headlight-R" of "headlight" (three) or "headlight-N". */
void ls_plan_add_headlight(struct ls_conf *conf, const struct ls_plan_entry *entry);

/** The rows of the S-matrix (core/bases.h): "multiplex-W-0001" of "multiplex". */
void ls_plan_add_multiplex(struct ls_conf *conf, const struct ls_plan_entry *entry);

/** The harmonics up to a degree: "harmonic-W-07" of "harmonic-07", in pairs with p or n behind. */
void ls_plan_add_harmonics(struct ls_conf *conf, const struct ls_plan_entry *entry, uint32_t degree,
                           bool pairs);

/** Three gradients and all lights: "gradient-W-x" of "gradient-x", y, z, full. */
void ls_plan_add_gradients(struct ls_conf *conf, const struct ls_plan_entry *entry);

/** The @n lights nearest the first camera, as seen from the centre, nearest first: lights[n]. */
void ls_plan_lights_near_camera(const struct ls_config *config, uint16_t *lights, uint32_t n);

#endif
