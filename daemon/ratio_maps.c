#include "daemon/ratio_maps.h"

#include "core/promote.h"
#include "core/relight.h"

#include <stdlib.h>
#include <string.h>

enum { BAND_ROWS = 512 };

/* Everything one pass needs; bands share the buffers. */
struct pass {
    const struct ls_field *field;
    uint32_t spectra[LS_FIELD_MAX_SPECTRA], n;
    float *made[LS_FIELD_MAX_SPECTRA];
    float *rows;                          /* [n][n_lights], the weights of V */
    float *spheres;                       /* [n][n_spectra], the weights of F */
    float *v, *f;                         /* [n][window] mosaics */
    float *v_rgb, *f_rgb, *sigma, *ratio; /* padded band, [height][width][n_channels] */
};

struct band {
    uint32_t y0, y1;                  /* rows wanted */
    struct ls_demosaic_region padded; /* with the ratio's halo */
    struct ls_tile_region tiles;      /* with the demosaic's halo around that */
    struct ls_demosaic_region window; /* the same, in pixels */
};

static struct band band_at(const struct ls_field *field, uint32_t y0)
{
    uint32_t y1 = field->height - y0 > BAND_ROWS ? y0 + BAND_ROWS : field->height;
    uint32_t top = y0 > LS_PROMOTE_HALO_PX ? y0 - LS_PROMOTE_HALO_PX : 0;
    uint32_t end =
        field->height - y1 > LS_PROMOTE_HALO_PX ? y1 + LS_PROMOTE_HALO_PX : field->height;
    struct band band = {.y0 = y0, .y1 = y1, .padded = {0, top, field->width, end - top}};
    band.tiles = ls_region_of_pixels(field, 0, top, field->width, end, LS_DEMOSAIC_HALO);
    band.window = (struct ls_demosaic_region){
        band.tiles.x0 * LS_TILE_SIDE, band.tiles.y0 * LS_TILE_SIDE,
        ls_region_width_px(field, &band.tiles), ls_region_height_px(field, &band.tiles)};
    return band;
}

static void pass_finish(struct pass *pass)
{
    for (uint32_t i = 0; i < pass->n; i++)
        free(pass->made[i]);
    free(pass->rows);
    free(pass->spheres);
    free(pass->v);
    free(pass->f);
    free(pass->v_rgb);
    free(pass->f_rgb);
    free(pass->sigma);
    free(pass->ratio);
}

static float *floats(size_t n)
{
    return malloc(n * sizeof(float));
}

static enum ls_err pass_init(struct pass *pass, struct ls_diag *diag)
{
    const struct ls_field *field = pass->field;
    size_t width = field->width, colours = field->n_channels;
    size_t window = width * (BAND_ROWS + 4 * LS_TILE_SIDE);
    size_t padded = width * (BAND_ROWS + 2 * LS_PROMOTE_HALO_PX) * colours;
    int missing = 0;
    pass->rows = floats((size_t)pass->n * field->n_lights);
    pass->spheres = calloc((size_t)pass->n * field->n_spectra, sizeof(float));
    pass->v = floats(window * pass->n);
    pass->f = floats(window * pass->n);
    pass->v_rgb = floats(padded);
    pass->f_rgb = floats(padded);
    pass->sigma = floats(padded);
    pass->ratio = floats(padded);
    for (uint32_t i = 0; i < pass->n; i++) {
        pass->made[i] = floats(width * field->height * colours);
        missing |= !pass->made[i];
    }
    if (missing || !pass->rows || !pass->spheres || !pass->v || !pass->f || !pass->v_rgb ||
        !pass->f_rgb || !pass->sigma || !pass->ratio)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for the promotion of %u spectra",
                       pass->n);
    for (uint32_t i = 0; i < pass->n; i++) {
        uint32_t s = pass->spectra[i];
        ls_promote_denominator_row(field, s, pass->rows + (size_t)i * field->n_lights);
        pass->spheres[(size_t)i * field->n_spectra + s] = (float)ls_promote_sphere_factor(field, s);
    }
    return LS_OK;
}

static enum ls_err accumulate(const struct pass *pass, const struct ls_picture *pictures,
                              uint32_t n_pictures, const float *weights, const struct band *band,
                              float *sums, struct ls_diag *diag)
{
    struct ls_accumulate_report report;
    struct ls_accumulate_job job = {
        .pictures = pictures, .n_pictures = n_pictures, .n_sums = pass->n, .weights = weights};
    return ls_accumulate(pass->field, &job, &band->tiles, sums, &report, diag);
}

static enum ls_err one_ratio(struct pass *pass, const struct band *band, uint32_t i,
                             struct ls_diag *diag)
{
    const struct ls_field *field = pass->field;
    uint32_t s = pass->spectra[i], colours = field->n_channels;
    size_t window = (size_t)band->window.width * band->window.height;
    size_t n = (size_t)band->padded.width * band->padded.height * colours;
    size_t row = (size_t)field->width * colours;
    double neutral[3];
    for (uint32_t c = 0; c < colours; c++)
        neutral[c] = field->p[s * colours + c] / field->p[c];
    enum ls_err err =
        ls_relight_demosaic(field, pass->v + i * window, band->window, band->padded, pass->v_rgb);
    if (!err)
        err = ls_relight_demosaic(field, pass->f + i * window, band->window, band->padded,
                                  pass->f_rgb);
    if (err)
        return err;
    ls_promote_sigma(field, pass->rows + (size_t)i * field->n_lights, field->n_lights, pass->v_rgb,
                     n, pass->sigma);
    if (colours > 1)
        ls_promote_add_contrast(pass->v_rgb, band->padded.width, band->padded.height, colours,
                                pass->sigma);
    err = ls_promote_ratio(pass->f_rgb, pass->v_rgb, pass->sigma, band->padded.width,
                           band->padded.height, colours, neutral, pass->ratio, diag);
    if (!err)
        memcpy(pass->made[i] + band->y0 * row, pass->ratio + (band->y0 - band->padded.y) * row,
               (band->y1 - band->y0) * row * sizeof(float));
    return err;
}

static enum ls_err one_band(struct pass *pass, const struct band *band, struct ls_diag *diag)
{
    const struct ls_field *field = pass->field;
    enum ls_err err =
        accumulate(pass, field->white, field->n_lights, pass->rows, band, pass->v, diag);
    if (!err)
        err = accumulate(pass, field->sphere, field->n_spectra, pass->spheres, band, pass->f, diag);
    for (uint32_t i = 0; i < pass->n && !err; i++)
        err = one_ratio(pass, band, i, diag);
    return err;
}

enum ls_err ls_ratio_maps_make(const struct ls_field *field, const uint32_t *spectra, uint32_t n,
                               float **maps, struct ls_diag *diag)
{
    struct pass pass = {.field = field};
    for (uint32_t i = 0; i < n; i++)
        if (!maps[spectra[i]])
            pass.spectra[pass.n++] = spectra[i];
    if (pass.n == 0)
        return LS_OK;
    enum ls_err err = pass_init(&pass, diag);
    for (uint32_t y = 0; y < field->height && !err; y += BAND_ROWS) {
        struct band band = band_at(field, y);
        err = one_band(&pass, &band, diag);
    }
    for (uint32_t i = 0; i < pass.n && !err; i++) {
        maps[pass.spectra[i]] = pass.made[i];
        pass.made[i] = NULL;
    }
    pass_finish(&pass);
    return err;
}
