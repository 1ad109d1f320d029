/*
 * exposure_offset: what a sensor adds to a trigger pulse, from the same light at several widths.
 * Layer: core. Threads: any; pure. Ownership: none.
 *
 * A pulse of width w exposes for w + o, so under a constant light the mean signal of the same
 * pixels is s(w) = a (w + o): o is where the straight line through the measurements meets s = 0,
 * with its sign turned. The line is fitted by weighted least squares, weights 1 / variance. Where
 * shot noise rules, short pulses under a bright light tell more: with n electrons in all, a pulse w
 * fixes its end of the line to w / sqrt(n).
 */
#ifndef LS_CORE_EXPOSURE_OFFSET_H
#define LS_CORE_EXPOSURE_OFFSET_H

#include "core/error.h"

#include <stddef.h>

/** Mean signal above the dark at one width. */
struct ls_width_signal {
    double width_us, mean, variance; /* variance of the mean, above 0 */
};

struct ls_exposure_offset {
    double us, sigma_us; /* and its standard error */
};

/**
 * Fit @n >= 2 signals of different widths. LS_ERR_INVALID: fewer widths, a number that is not
 * finite, a variance not above 0; LS_ERR_MISMATCH: the signal does not rise with the width.
 */
LS_MUST_CHECK enum ls_err ls_exposure_offset_fit(const struct ls_width_signal *signals, size_t n,
                                                 struct ls_exposure_offset *out,
                                                 struct ls_diag *diag);

#endif
