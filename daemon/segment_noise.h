/*
 * segment_noise: the noise of what a spectrum is fitted on, segment by segment.
 * Layer: daemon, for linear_maps.c. Threads: any, read-only once made. Ownership: init / finish.
 *
 * Read noise and dark current's by the squares of the weights a sum has, shot noise by the largest
 * of them; where the lights were multiplexed, by light_set's factor on every light's.
 */
#ifndef LS_DAEMON_SEGMENT_NOISE_H
#define LS_DAEMON_SEGMENT_NOISE_H

#include "core/linear.h"
#include "daemon/linear_maps.h"

struct ls_segment_noise {
    struct ls_linear_noise *v, *f; /* [n_segments], of V under the target's strengths, and of F */
    struct ls_linear_noise total;  /* of V of all lights */
};

/** Of @target's sums. ls_segment_noise_finish also after an error. Errors: those of
 * ls_segment_row, LS_ERR_NOMEM. */
LS_MUST_CHECK enum ls_err ls_segment_noise_init(struct ls_segment_noise *noise,
                                                const struct ls_linear_job *job,
                                                const struct ls_linear_target *target,
                                                struct ls_diag *diag);

/** Zeroed is allowed. */
void ls_segment_noise_finish(struct ls_segment_noise *noise);

#endif
