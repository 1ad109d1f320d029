/*
 * merge_defects: defective pixels of a merge, replaced from their neighbours (merge.h says how).
 * Layer: core, inside the merge only. Threads: any; pure. Ownership: everything is the caller's.
 */
#ifndef LS_CORE_MERGE_DEFECTS_H
#define LS_CORE_MERGE_DEFECTS_H

#include "core/merge_group.h"

#include <stddef.h>

/** The first of params->defects that is not before @pixel; n_defects if there is none. RT-safe. */
size_t ls_merge_first_defect(const struct ls_merge_params *params, size_t pixel);

/** Write the replaced values of @pixel; where no neighbour is good, it stays. RT-safe. */
void ls_merge_correct(const struct ls_merge_work *work, size_t pixel);

#endif
