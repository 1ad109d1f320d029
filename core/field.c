#include "core/field.h"

#include <math.h>
#include <stdbool.h>

uint32_t ls_field_tiles_x(const struct ls_field *field)
{
    return field->width / LS_TILE_SIDE + (field->width % LS_TILE_SIDE != 0);
}

uint32_t ls_field_tiles_y(const struct ls_field *field)
{
    return field->height / LS_TILE_SIDE + (field->height % LS_TILE_SIDE != 0);
}

static uint32_t clipped(uint32_t tile0, uint32_t tile1, uint32_t size)
{
    uint64_t a = (uint64_t)tile0 * LS_TILE_SIDE, b = (uint64_t)tile1 * LS_TILE_SIDE;
    b = b < size ? b : size;
    return a < b ? (uint32_t)(b - a) : 0;
}

uint32_t ls_region_width_px(const struct ls_field *field, const struct ls_tile_region *region)
{
    return clipped(region->x0, region->x1, field->width);
}

uint32_t ls_region_height_px(const struct ls_field *field, const struct ls_tile_region *region)
{
    return clipped(region->y0, region->y1, field->height);
}

static uint32_t first_tile(uint32_t px, uint32_t halo)
{
    return (px > halo ? px - halo : 0) / LS_TILE_SIDE;
}

static uint32_t end_tile(uint32_t px, uint32_t halo, uint32_t size)
{
    uint64_t end = (uint64_t)px + halo;
    end = end < size ? end : size;
    return (uint32_t)((end + LS_TILE_SIDE - 1) / LS_TILE_SIDE);
}

struct ls_tile_region ls_region_of_pixels(const struct ls_field *field, uint32_t x0, uint32_t y0,
                                          uint32_t x1, uint32_t y1, uint32_t halo)
{
    return (struct ls_tile_region){.x0 = first_tile(x0, halo),
                                   .y0 = first_tile(y0, halo),
                                   .x1 = end_tile(x1, halo, field->width),
                                   .y1 = end_tile(y1, halo, field->height)};
}

static bool positive(double v)
{
    return isfinite(v) && v > 0;
}

static enum ls_err check_sizes(const struct ls_field *field, struct ls_diag *diag)
{
    if (field->n_lights < 1 || field->width < 1 || field->height < 1)
        return ls_fail(diag, LS_ERR_INVALID, "field: %u lights of %u x %u px: expected at least 1",
                       field->n_lights, field->width, field->height);
    if (field->n_spectra < 1 || field->n_spectra > LS_FIELD_MAX_SPECTRA)
        return ls_fail(diag, LS_ERR_INVALID, "field: %u spectra: expected 1..%d", field->n_spectra,
                       LS_FIELD_MAX_SPECTRA);
    if (field->n_channels != (field->cfa == LS_CFA_NONE ? 1u : 3u))
        return ls_fail(diag, LS_ERR_INVALID, "field: %u channels: expected %d for this camera",
                       field->n_channels, field->cfa == LS_CFA_NONE ? 1 : 3);
    if (!field->white || !field->k || !field->g || !field->omega_sr || !field->directions ||
        !field->p || !field->duty || !field->factor)
        return ls_fail(diag, LS_ERR_INVALID,
                       "field: pictures, gains, solid angles, directions, p, "
                       "duties or factors are missing");
    if (!positive(field->scale))
        return ls_fail(diag, LS_ERR_INVALID, "field: scale %g: expected a positive number",
                       field->scale);
    return LS_OK;
}

static enum ls_err check_gains(const struct ls_field *field, uint32_t s, struct ls_diag *diag)
{
    const double *k = field->k + (size_t)s * field->n_lights;
    const double *g = field->g + (size_t)s * field->n_lights;
    double mean = 0;
    for (uint32_t i = 0; i < field->n_lights; i++) {
        if (!positive(k[i]) || !positive(g[i]) || fabs(k[i] * g[i] - 1) > 1e-6)
            return ls_fail(diag, LS_ERR_INVALID,
                           "field: spectrum %u, light %u: gain %g and strength %g: expected "
                           "positive, strength = 1 / gain",
                           s, i, k[i], g[i]);
        mean += g[i] / field->n_lights;
    }
    if (fabs(mean - 1) > 1e-3)
        return ls_fail(diag, LS_ERR_INVALID,
                       "field: spectrum %u: strengths have mean %g: expected 1, normalise them", s,
                       mean);
    return LS_OK;
}

static enum ls_err check_spectrum(const struct ls_field *field, uint32_t s, struct ls_diag *diag)
{
    if (!(field->duty[s] > 0 && field->duty[s] <= 1))
        return ls_fail(diag, LS_ERR_INVALID, "field: spectrum %u: duty %g: expected (0, 1]", s,
                       field->duty[s]);
    if (!(field->factor[s] > 0 && field->factor[s] <= 10))
        return ls_fail(diag, LS_ERR_INVALID,
                       "field: spectrum %u: droop factor %g: expected (0, 10]", s,
                       field->factor[s]);
    for (uint32_t c = 0; c < field->n_channels; c++)
        if (!positive(field->p[s * field->n_channels + c]))
            return ls_fail(diag, LS_ERR_INVALID,
                           "field: p of spectrum %u, channel %u is %g: expected positive", s, c,
                           field->p[s * field->n_channels + c]);
    return check_gains(field, s, diag);
}

enum ls_err ls_field_check(const struct ls_field *field, struct ls_diag *diag)
{
    enum ls_err err = check_sizes(field, diag);
    for (uint32_t s = 0; !err && s < field->n_spectra; s++)
        err = check_spectrum(field, s, diag);
    if (err)
        return err;
    double green = field->p[field->n_channels == 3 ? 1 : 0], sphere = 0;
    if (fabs(green - 1) > 1e-3)
        return ls_fail(diag, LS_ERR_INVALID,
                       "field: p of white in %s is %g: expected 1, the unit of the field",
                       field->n_channels == 3 ? "green" : "the mono channel", green);
    for (uint32_t i = 0; i < field->n_lights; i++)
        sphere += field->omega_sr[i];
    if (!(fabs(sphere / (4 * M_PI) - 1) <= 1e-3))
        return ls_fail(diag, LS_ERR_INVALID,
                       "field: solid angles of the lights sum to %g sr: expected 4 pi", sphere);
    return LS_OK;
}

enum ls_err ls_field_normalise_gains(const double *strength, size_t n, double *k, double *g,
                                     struct ls_diag *diag)
{
    double mean = 0;
    for (size_t i = 0; i < n; i++) {
        if (!positive(strength[i]))
            return ls_fail(diag, LS_ERR_INVALID,
                           "gains: light %zu has strength %g: expected a positive number", i,
                           strength[i]);
        mean += strength[i] / (double)n;
    }
    for (size_t i = 0; i < n; i++) {
        double relative = strength[i] / mean;
        g[i] = relative;
        k[i] = 1 / relative;
    }
    return LS_OK;
}
