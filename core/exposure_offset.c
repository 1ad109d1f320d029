#include "core/exposure_offset.h"

#include <math.h>

enum ls_err ls_exposure_offset_fit(const struct ls_width_signal *signals, size_t n,
                                   struct ls_exposure_offset *out, struct ls_diag *diag)
{
    double s = 0, sx = 0, sy = 0, sxx = 0, sxy = 0;
    for (size_t i = 0; i < n; i++) {
        const struct ls_width_signal *p = &signals[i];
        if (!isfinite(p->width_us) || !isfinite(p->mean) || !isfinite(p->variance) ||
            p->variance <= 0)
            return ls_fail(diag, LS_ERR_INVALID,
                           "pulse of %g us: signal %g, variance %g: expected finite numbers and a "
                           "variance above 0",
                           p->width_us, p->mean, p->variance);
        double w = 1 / p->variance, x = p->width_us - signals[0].width_us;
        s += w;
        sx += w * x;
        sy += w * p->mean;
        sxx += w * x * x;
        sxy += w * x * p->mean;
    }
    double d = s * sxx - sx * sx;
    if (n < 2 || !(d > 1e-12 * s * sxx))
        return ls_fail(diag, LS_ERR_INVALID, "expected signals at two widths or more");
    double slope = (s * sxy - sx * sy) / d, at_first = (sxx * sy - sx * sxy) / d;
    if (!(slope > 0))
        return ls_fail(diag, LS_ERR_MISMATCH, "the signal does not rise with the pulse's width");
    double o = at_first / slope; /* the first pulse's own exposure */
    double variance = (sxx / d + 2 * o * sx / d + o * o * s / d) / (slope * slope);
    *out = (struct ls_exposure_offset){o - signals[0].width_us, sqrt(variance)};
    return LS_OK;
}
