#include "core/separate.h"

#include <math.h>

enum ls_err ls_split_make(struct ls_polarisation a, double k_v, double k_h, struct ls_split *out,
                          struct ls_diag *diag)
{
    double sum = a.v + a.h;
    if (!(k_v > 0 && k_v < 1e6 && k_h > 0 && k_h < 1e6))
        return ls_fail(diag, LS_ERR_INVALID,
                       "separation: gains %g and %g of V and H: expected within (0, 1e6)", k_v,
                       k_h);
    if (!isfinite(a.v) || !isfinite(a.h) || !(sum > 0.5))
        return ls_fail(diag, LS_ERR_INVALID,
                       "separation: polarisation factors %g and %g: expected a sum near 1", a.v,
                       a.h);
    a.v /= sum;
    a.h /= sum;
    double apart = a.v - a.h;
    if (!ls_polarisation_separable(a)) {
        *out = (struct ls_split){0, 0, (float)k_v, (float)k_h};
        return LS_OK;
    }
    *out = (struct ls_split){(float)(k_v / apart), (float)(-k_h / apart),
                             (float)(-2 * a.h * k_v / apart), (float)(2 * a.v * k_h / apart)};
    return LS_OK;
}

bool ls_split_inseparable(const struct ls_split *split)
{
    return split->s_v == 0 && split->s_h == 0;
}

void ls_separate_remainder(const float *f, const float *diffuse, const float *specular,
                           const float *conductor, const double *tint, size_t n_px,
                           uint32_t n_channels, float *numerator, float *denominator)
{
    for (size_t j = 0; j < n_px; j++)
        for (uint32_t c = 0; c < n_channels; c++) {
            size_t k = j * n_channels + c;
            float metal = conductor ? conductor[k] : 0, sum = diffuse[k] + metal;
            numerator[k] = f[k] - (float)tint[c] * (specular[k] - metal);
            denominator[k] = sum;
        }
}
