/*
 * linear_check: a fitted map held against lights that were also photographed alone.
 * Layer: daemon, for linear_maps.c. Threads: any. Ownership: all arrays are the caller's.
 *
 * The matrices, or a blend's ratios, turn what each input photographed of such a light into what
 * spectrum s should show of it; core/linear.h compares (ls_linear_check_light).
 */
#ifndef LS_DAEMON_LINEAR_CHECK_H
#define LS_DAEMON_LINEAR_CHECK_H

#include "daemon/linear_maps.h"

struct ls_linear_check {
    const struct ls_linear_job *job;
    const struct ls_linear_target *target;    /* its map is filled over `wanted` */
    struct ls_demosaic_region wanted, padded; /* in the picture */
    const float *const *v; /* [n_segments] -> [padded.height][padded.width][n_in] */
};

/** Add what the target's lights show over the wanted pixels. No lights: nothing. Errors: those of
 * ls_accumulate, LS_ERR_NOMEM. */
LS_MUST_CHECK enum ls_err ls_linear_check(const struct ls_linear_check *check,
                                          struct ls_linear_error *all,
                                          struct ls_linear_error *highlights, struct ls_diag *diag);

#endif
