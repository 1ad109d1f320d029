#include "daemon/rgb_band.h"

#include "core/factored.h"
#include "core/half.h"

#include <stdlib.h>

static enum ls_err out_of_memory(struct ls_diag *diag)
{
    return ls_fail(diag, LS_ERR_NOMEM, "out of memory for rows of a picture");
}

static size_t samples(const struct ls_rgb_band *band)
{
    return (size_t)band->region.width * band->region.height * band->field->n_channels;
}

/* As stored, in floats or halves: the other is NULL. @ratio: halves are promoted by it, else NULL.
 */
static enum ls_err demosaic(const struct ls_rgb_band *band, float *floats, uint16_t *halves,
                            const uint16_t *ratio, struct ls_diag *diag)
{
    const struct ls_field *field = band->field;
    struct ls_demosaic_region w = ls_demosaic_needs(band->region, field->width, field->height);
    LS_CLEANUP_FREE uint16_t *mosaic = malloc((size_t)w.width * w.height * sizeof *mosaic);
    if (!mosaic)
        return out_of_memory(diag);
    ls_picture_map_read_half(band->map, w.x, w.y, w.width, w.height, mosaic);
    const struct ls_demosaic_source source = {.half = mosaic,
                                              .stride = w.width,
                                              .window = w,
                                              .image_width = field->width,
                                              .image_height = field->height,
                                              .cfa = field->cfa};
    const size_t row_step = 3 * (size_t)band->region.width;
    struct ls_demosaic_target target = {.pixel_step = 3,
                                        .row_step = row_step,
                                        .scale = (float)band->gain,
                                        .half_ratio = ratio,
                                        .ratio_step = row_step};
    for (int c = 0; c < 3; c++) {
        target.plane[c] = floats ? floats + c : NULL;
        target.half[c] = halves ? halves + c : NULL;
    }
    enum ls_err err = ls_demosaic(&source, band->region, field->demosaic, &target);
    return err ? ls_fail(diag, err, "rows %u to %u cannot be demosaiced", band->region.y,
                         band->region.y + band->region.height)
               : LS_OK;
}

/* White, or promoted. */
static enum ls_err make_halves(const struct ls_rgb_band *band, const uint16_t *ratio, uint16_t *out,
                               struct ls_diag *diag)
{
    const struct ls_demosaic_region *r = &band->region;
    if (band->field->n_channels > 1)
        return demosaic(band, NULL, out, ratio, diag);
    LS_CLEANUP_FREE uint16_t *white = ratio ? malloc(samples(band) * sizeof *white) : NULL;
    if (ratio && !white)
        return out_of_memory(diag);
    ls_picture_map_read_half(band->map, r->x, r->y, r->width, r->height, white ? white : out);
    if (white)
        ls_factored_expand(white, (float)band->gain, ratio, samples(band), out);
    return LS_OK;
}

static void ratio_halves(const struct ls_rgb_band *band, uint16_t *out)
{
    size_t row = (size_t)band->region.width * band->field->n_channels;
    for (uint32_t y = 0; y < band->region.height; y++)
        ls_half_from_floats(band->ratio + y * band->ratio_stride, out + y * row, row);
}

static enum ls_err promoted_halves(const struct ls_rgb_band *band, uint16_t *out,
                                   struct ls_diag *diag)
{
    if (band->ratio_halves)
        return make_halves(band, band->ratio_halves, out, diag);
    LS_CLEANUP_FREE uint16_t *ratio = malloc(samples(band) * sizeof *ratio);
    if (!ratio)
        return out_of_memory(diag);
    ratio_halves(band, ratio);
    return make_halves(band, ratio, out, diag);
}

/* What is no number stays none. */
static float clamped(float v)
{
    return v > LS_HALF_MAX ? LS_HALF_MAX : v < -LS_HALF_MAX ? -LS_HALF_MAX : v;
}

enum ls_err ls_rgb_band_floats(const struct ls_rgb_band *band, float *out, struct ls_diag *diag)
{
    const struct ls_demosaic_region *r = &band->region;
    if (band->field->n_channels == 1) {
        ls_picture_map_read(band->map, r->x, r->y, r->width, r->height, (float)band->gain, out);
        return LS_OK;
    }
    enum ls_err err = demosaic(band, out, NULL, NULL, diag);
    for (size_t k = 0; k < samples(band) && !err; k++)
        out[k] *= (float)band->gain;
    return err;
}

enum ls_err ls_rgb_band_halves(const struct ls_rgb_band *band, uint16_t *out, struct ls_diag *diag)
{
    size_t n = samples(band);
    if (band->ratio)
        return promoted_halves(band, out, diag);
    if (band->gain == 1)
        return make_halves(band, NULL, out, diag);
    LS_CLEANUP_FREE float *floats = malloc(n * sizeof *floats);
    if (!floats)
        return out_of_memory(diag);
    enum ls_err err = ls_rgb_band_floats(band, floats, diag);
    for (size_t k = 0; k < n && !err; k++)
        floats[k] = clamped(floats[k]);
    if (!err)
        ls_half_from_floats(floats, out, n);
    return err;
}
