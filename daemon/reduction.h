/*
 * reduction: what is made of full-size floats before they are sent: one component, a level.
 * Layer: daemon. Threads: one at a time per object. Ownership: the caller's; finish it.
 *
 * Luminance is Y = 0.2126 R + 0.7152 G + 0.0722 B (ITU-R BT.709-6, 3.3) of the take's matrix M on
 * the camera's RGB, in double, rounded to float once. A level (core/level.h) is the mean of floats
 * so far. Halves are the nearest to it, and +-65504 beyond
 * their range.
 */
#ifndef LS_DAEMON_REDUCTION_H
#define LS_DAEMON_REDUCTION_H

#include "core/error.h"
#include "core/level.h"
#include "daemon/take_facts.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct ls_reduction {
    uint32_t level;
    bool luminance;
    double y[3];               /* of camera RGB */
    struct ls_level_rows rows; /* of the picture at hand */
};

/** LS_ERR_UNSUPPORTED: there is no such level. */
LS_MUST_CHECK enum ls_err ls_reduction_check_level(uint32_t level, struct ls_diag *diag);

/** Luminance from now on, if the camera sees colours. LS_ERR_STATE: the take's calibration does not
 * say how. */
LS_MUST_CHECK enum ls_err ls_reduction_make_mono(struct ls_reduction *r,
                                                 const struct ls_take_facts *facts,
                                                 struct ls_diag *diag);

/** Is anything to be done? */
bool ls_reduction_any(const struct ls_reduction *r);

/** The next picture; its rows come from @needs, as ls_level_needs says, and have @components.
 * LS_ERR_NOMEM. */
LS_MUST_CHECK enum ls_err ls_reduction_begin(struct ls_reduction *r,
                                             const struct ls_demosaic_region *needs,
                                             uint32_t components, struct ls_diag *diag);

/** The next @n_rows rows, which are overwritten. *out: [*made][width of the level][components of
 * what is sent], (transfer full), free(); *made may be 0. LS_ERR_NOMEM. */
LS_MUST_CHECK enum ls_err ls_reduction_add(struct ls_reduction *r, float *values, uint32_t n_rows,
                                           float **out, uint32_t *made, struct ls_diag *diag);

/** To within the range of halves. */
void ls_reduction_clamp(float *values, size_t n);

/** Zeroed is allowed. */
void ls_reduction_finish(struct ls_reduction *r);

#endif
