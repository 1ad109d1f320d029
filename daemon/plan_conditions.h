/*
 * plan_conditions: the entries of a plan's `conditions`, made into what the LEDs do.
 * Layer: daemon. Threads: as plan. Ownership: everything made belongs to the builder's plan.
 *
 * Private to plan. Errors stick to the ls_conf they are reported at.
 */
#ifndef LS_DAEMON_PLAN_CONDITIONS_H
#define LS_DAEMON_PLAN_CONDITIONS_H

#include "daemon/conf_read.h"
#include "daemon/plan.h"

enum {
    LS_PLAN_MAX_CONDITIONS = 65536,
    LS_PLAN_MAX_LEDS = 1 << 20,
    LS_PLAN_FULL_LEVEL = 65535,
    LS_PLAN_SPHERE_LEVEL = LS_PLAN_FULL_LEVEL / 90, /* about as bright as one front light */
};

/** A plan while it grows; its arrays have room for the maxima above. */
struct ls_plan_builder {
    struct ls_plan *plan;
    const struct ls_config *config;
    uint32_t n_leds;
    uint32_t named; /* entries of kind segment so far */
};

/** One entry as read. */
struct ls_plan_entry {
    struct ls_plan_builder *builder;
    uint16_t channel;
    uint16_t level;
    bool fits_current;
    const uint16_t *lights; /* rig rows */
    uint32_t n_lights;
    bool backwards; /* each, segments: from the last to the first */
};

/** A new condition without lights, or NULL where the plan is full. */
struct ls_plan_condition *ls_plan_add_condition(struct ls_conf *conf,
                                                struct ls_plan_builder *builder);

/**
 * A condition of the entry's channel: light i of its lights at weights[i] of its level, those of
 * level 0 left out. One that gives every light it keeps the whole level is a SEGMENT, else a LIST.
 * The caller names it and its pattern. NULL where the plan is full.
 */
struct ls_plan_condition *
ls_plan_add_pattern(struct ls_conf *conf, const struct ls_plan_entry *entry, const double *weights);

/** The entry's lights one by one. */
void ls_plan_add_each(struct ls_conf *conf, const struct ls_plan_entry *entry);

/** Put @n rig rows in an order in which neighbours follow each other: core/smooth_order.h. */
void ls_plan_smooth(struct ls_conf *conf, const struct ls_config *config, uint16_t *lights,
                    uint32_t n);

/** The full sphere of the entry's channel and level. NULL where the plan is full. */
struct ls_plan_condition *ls_plan_add_sphere(struct ls_conf *conf,
                                             const struct ls_plan_entry *entry);

/** Read `channels`, names of the rig's. Returns how many, 0 if absent and not @needed. */
uint32_t ls_plan_read_channels(struct ls_conf *conf, const struct ls_config *config,
                               uint16_t channels[LS_MAX_CHANNELS], bool needed);

/** Read the plan's `conditions`. */
void ls_plan_read_conditions(struct ls_conf *conf, struct ls_plan_builder *builder);

#endif
