#include "core/gains.h"

#include "core/vec3.h"

static uint32_t reference_colour(uint32_t n_colours)
{
    return n_colours == 3 ? 1 : 0;
}

bool ls_gains_one_sided(const double direction[3], const double (*camera_m)[3], uint32_t n_cameras)
{
    for (uint32_t k = 0; k < n_cameras; k++) {
        double c[3] = {camera_m[k][0], camera_m[k][1], camera_m[k][2]};
        ls_unit3(c);
        if (ls_dot3(c, direction) >= -0.5)
            return false;
    }
    return true;
}

enum ls_err ls_gains_scale_polarised(struct ls_gains *v, const struct ls_gains *w,
                                     uint32_t n_lights, uint32_t n_cameras, uint32_t n_colours,
                                     struct ls_diag *diag)
{
    uint32_t green = reference_colour(n_colours);
    double sum = 0, mean = 0;
    for (uint32_t k = 0; k < n_cameras; k++) {
        double a = v->level[k][green], b = w->level[k][green];
        if (!(a > 0 && b > 0))
            continue;
        double e = v->level_sigma[k][green] * v->level_sigma[k][green] +
                   w->level_sigma[k][green] * w->level_sigma[k][green] + 1e-12;
        sum += 1 / e;
        mean += log(2 * a / b) / e;
    }
    if (!(sum > 0))
        return ls_fail(diag, LS_ERR_INVALID,
                       "gains: no camera knows the level of both white and a polarised channel, so "
                       "that V + H = W cannot be had");
    double scale = exp(mean / sum);
    for (uint32_t i = 0; i < n_lights; i++) {
        v->g[i] *= scale;
        v->k[i] /= scale;
        v->sigma_k[i] /= scale;
    }
    for (uint32_t k = 0; k < n_cameras; k++)
        for (uint32_t c = 0; c < n_colours; c++)
            v->level[k][c] /= scale;
    return LS_OK;
}

enum ls_err ls_gains_closure(const struct ls_gains *const *channels, uint32_t n_channels,
                             uint32_t camera, uint32_t n_colours, const double *reflectance,
                             double *scale, float (*p)[3], struct ls_diag *diag)
{
    uint32_t green = reference_colour(n_colours);
    for (uint32_t k = 0; k < n_channels * n_colours; k++)
        if (!(reflectance[k] > 0 && reflectance[k] <= 1))
            return ls_fail(diag, LS_ERR_INVALID,
                           "grey sphere: reflectance %g: expected more than 0, at most 1",
                           reflectance[k]);
    double white = channels[0]->level[camera][green] / reflectance[green];
    if (!(white > 0))
        return ls_fail(diag, LS_ERR_INVALID,
                       "closure: camera %u has no level of white, so that nothing can be scaled",
                       camera);
    *scale = 1 / white;
    for (uint32_t s = 0; s < n_channels; s++)
        for (uint32_t c = 0; c < n_colours; c++)
            p[s][c] =
                (float)(channels[s]->level[camera][c] / reflectance[s * n_colours + c] / white);
    return LS_OK;
}
