/*
 * rgb_band: rows of one stored picture as RGB, by core's kernels on halves: demosaiced, gained and,
 * under a ratio of Eq. 1, promoted.
 * Layer: daemon. Threads: any; pure. Ownership: everything is the caller's.
 *
 * A mono camera's one component is as stored, gained. Floats are the demosaic of the stored halves
 * times the gain. Halves are their nearest halves, except under a ratio: there white's demosaiced
 * halves are promoted by core/factored, with the ratio as halves. Three roundings instead of
 * one: within 1.5e-3 of the floats that daemon/render makes, relative, and 2^-24 of (white's value
 * + the ratio) where a half is denormal. What lies beyond half's range becomes +-65504.
 */
#ifndef LS_DAEMON_RGB_BAND_H
#define LS_DAEMON_RGB_BAND_H

#include "core/demosaic.h"
#include "core/error.h"
#include "core/field.h"
#include "daemon/picture_map.h"

#include <stddef.h>
#include <stdint.h>

struct ls_rgb_band {
    const struct ls_field *field;
    const struct ls_picture_map *map;
    struct ls_demosaic_region region; /* inside the picture */
    double gain;
    const float *ratio;  /* [region.height][region.width][n_channels], halves only; NULL = 1 */
    size_t ratio_stride; /* floats from row to row */
    const uint16_t *ratio_halves; /* the same as its nearest halves, without gaps; or NULL */
};

/** out[region.height][region.width][n_channels]. Errors: LS_ERR_NOMEM. */
LS_MUST_CHECK enum ls_err ls_rgb_band_floats(const struct ls_rgb_band *band, float *out,
                                             struct ls_diag *diag);

/** The same as halves. */
LS_MUST_CHECK enum ls_err ls_rgb_band_halves(const struct ls_rgb_band *band, uint16_t *out,
                                             struct ls_diag *diag);

#endif
