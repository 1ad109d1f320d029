#include "clients/relit_space.h"

#include "core/primaries.h"

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
    ls_colours_apply((const double(*)[3])document->calibration->m, rgb, n, out);
}
