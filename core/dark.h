/*
 * dark: statistics of K dark frames: mean and variance per pixel, clipped black, read noise.
 * Layer: core. Threads: one thread per object at a time. Ownership: the object owns its sums
 * (12 bytes per pixel), the caller every output.
 *
 * A dark frame is shot with the shutter open and the LEDs off, so it holds black level, dark
 * current and ambient light. Sums are integers: the result does not depend on the order of frames
 * and is exact up to the last rounding. K <= 65536.
 */
#ifndef LS_CORE_DARK_H
#define LS_CORE_DARK_H

#include "core/error.h"
#include "core/pixel.h"

#include <stddef.h>
#include <stdint.h>

struct ls_dark;

struct ls_dark_stats {
    uint32_t n_frames;
    double mean_dn;          /* over pixels and frames */
    double zero_fraction;    /* of samples at DN 0 */
    double clipped_fraction; /* of samples at the format's largest DN */
    double read_noise_dn;    /* 1 sigma of one frame without quantisation; 0 if K < 2 */
};

/** Largest share of samples at DN 0 that is not yet a clipped black level (method: 0.1 %). */
#define LS_DARK_ZERO_LIMIT 0.001

/** Errors: LS_ERR_INVALID (no pixels), LS_ERR_LIMIT (more than 2^32 - 1), LS_ERR_NOMEM.
 * (transfer full). */
LS_MUST_CHECK enum ls_err ls_dark_create(const struct ls_pixel_format *format, uint32_t width,
                                         uint32_t height, struct ls_dark **out,
                                         struct ls_diag *diag);

/** NULL is allowed. */
void ls_dark_destroy(struct ls_dark *dark);

/** Fold in one raw frame as it came over the wire. LS_ERR_LIMIT past 65536 frames. RT-safe. */
LS_MUST_CHECK enum ls_err ls_dark_add(struct ls_dark *dark, const void *raw);

/** Mean per pixel, DN: width height floats, nearest to the exact mean. LS_ERR_STATE before the
 * first frame. */
LS_MUST_CHECK enum ls_err ls_dark_mean(const struct ls_dark *dark, float *mean_dn);

/** Unbiased variance per pixel of one frame, DN^2. LS_ERR_STATE with fewer than two frames. */
LS_MUST_CHECK enum ls_err ls_dark_variance(const struct ls_dark *dark, float *variance_dn2);

/** Numbers over the whole frame. The read noise is the root of the mean pixel variance,
 * pixels above 36 times the median (and above 4 DN^2) left out, so hot ones do not move it.
 * Errors: LS_ERR_STATE before the first frame, LS_ERR_NOMEM. */
LS_MUST_CHECK enum ls_err ls_dark_stats(const struct ls_dark *dark, struct ls_dark_stats *stats);

/** LS_ERR_INVALID with a sentence when the black level clips: zero_fraction >= LS_DARK_ZERO_LIMIT
 * (half of the noise is cut off and every mean is too high). */
LS_MUST_CHECK enum ls_err ls_dark_check_black(const struct ls_dark_stats *stats,
                                              struct ls_diag *diag);

#endif
