/*
 * plan_builder: a plan while it grows, and the conditions of the plainest kinds.
 * Layer: daemon. Threads: as plan. Ownership: everything made belongs to the builder's plan.
 *
 * Private to plan. Errors stick to the ls_conf they are reported at.
 */
#ifndef LS_DAEMON_PLAN_BUILDER_H
#define LS_DAEMON_PLAN_BUILDER_H

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

/** The entry's lights one by one: "W-0007". */
void ls_plan_add_each(struct ls_conf *conf, const struct ls_plan_entry *entry);

/** The full sphere of the entry's channel and level: "sphere-W". NULL where the plan is full. */
struct ls_plan_condition *ls_plan_add_sphere(struct ls_conf *conf,
                                             const struct ls_plan_entry *entry);

/** The entry's lights at once, as the plan's next group of its own: "segment0-W" of "lights-12". */
void ls_plan_add_named(struct ls_conf *conf, const struct ls_plan_entry *entry);

#endif
