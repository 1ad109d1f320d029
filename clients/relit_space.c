#include "clients/relit_space.h"

const float ls_rec709_primaries[8] = {0.64f, 0.33f, 0.30f, 0.60f, 0.15f, 0.06f, 0.3127f, 0.3290f};

bool ls_relit_needs_m(const struct ls_take_document *document,
                      const struct ls_light_weights *weights)
{
    return document->calibration && document->calibration->has_m && !document->mono &&
           !weights->after_m;
}

bool ls_relit_in_rec709(const struct ls_take_document *document,
                        const struct ls_light_weights *weights)
{
    return weights->after_m || ls_relit_needs_m(document, weights);
}

void ls_relit_apply_m(const struct ls_take_document *document, const float *rgb, size_t n,
                      float *out)
{
    const double(*m)[3] = (const double(*)[3])document->calibration->m;
    for (size_t i = 0; i < n; i++, rgb += 3, out += 3) {
        const double v[3] = {(double)rgb[0], (double)rgb[1], (double)rgb[2]};
        for (int r = 0; r < 3; r++)
            out[r] = (float)(m[r][0] * v[0] + m[r][1] * v[1] + m[r][2] * v[2]);
    }
}
