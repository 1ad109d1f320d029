/*
 * merge_group: a few pixels merged out of place: the end of a run, the neighbours of a defect.
 * Layer: core, inside the merge only. Threads: any; pure. Ownership: everything is the caller's.
 */
#ifndef LS_CORE_MERGE_GROUP_H
#define LS_CORE_MERGE_GROUP_H

#include "core/merge_kernels.h"

/** One group; zero it first: pixels that were not loaded are then merged as black. */
struct ls_merge_group {
    uint16_t x[LS_MERGE_MAX_EXPOSURES][LS_MERGE_GROUP]; /* DN, sorted as in the model */
    float dark[LS_MERGE_MAX_EXPOSURES][LS_MERGE_GROUP];
    float e[LS_MERGE_GROUP], variance[LS_MERGE_GROUP];
    uint16_t half[LS_MERGE_GROUP];
    uint8_t validity[LS_MERGE_GROUP];
};

/** What every step of a merge needs. */
struct ls_merge_work {
    const struct ls_merge_kernels *kernels;
    const struct ls_merge_model *model;
    const struct ls_merge_params *params;
    const struct ls_merge_spans *spans;
};

/** Load @n pixels of the image from @first on into places @at .. of the group. RT-safe. */
void ls_merge_group_load(const struct ls_merge_work *work, struct ls_merge_group *group,
                         size_t first, size_t n, size_t at);

/** Merge all of the group, every output of it. RT-safe. */
void ls_merge_group_run(const struct ls_merge_work *work, struct ls_merge_group *group);

#endif
