#include "core/merge_variance.h"

#include <math.h>

/* sigma^2 of y at an exposure, DN^2. */
static double sample_variance(const struct ls_merge_params *p, double dn_per_s, double t)
{
    return p->read_noise_dn * p->read_noise_dn + 1.0 / 12 +
           fmax(dn_per_s * t, 0) / p->electrons_per_dn;
}

/* The longest exposure that is not high, or the shortest. */
static double exposure_left(const struct ls_merge_params *p, double black_dn, double dn_per_s)
{
    double high = p->range_high * p->full_scale_dn, longest = 0, shortest = INFINITY;
    for (uint32_t i = 0; i < p->n_exposures; i++) {
        double t = p->exposure_s[i];
        shortest = fmin(shortest, t);
        if (!(black_dn + dn_per_s * t > high))
            longest = fmax(longest, t);
    }
    return longest > 0 ? longest : shortest;
}

/* DN^2 / s^2 */
static double variance_at(const struct ls_merge_params *p, double black_dn, double dn_per_s)
{
    double low = p->range_low * p->full_scale_dn, high = p->range_high * p->full_scale_dn;
    double information = 0;
    for (uint32_t i = 0; i < p->n_exposures; i++) {
        double t = p->exposure_s[i], expected = black_dn + dn_per_s * t;
        if (expected >= low && expected <= high)
            information += t * t / sample_variance(p, dn_per_s, t);
    }
    if (information > 0)
        return 1 / information;
    double t = exposure_left(p, black_dn, dn_per_s);
    return sample_variance(p, dn_per_s, t) / (t * t);
}

void ls_merge_variance(const struct ls_merge_params *params, double black_dn, const float *e,
                       size_t n, float *variance)
{
    double full = params->full_scale_dn;
    for (size_t k = 0; k < n; k++)
        variance[k] = (float)(variance_at(params, black_dn, full * (double)e[k]) / (full * full));
}
