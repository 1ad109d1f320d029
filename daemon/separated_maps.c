#include "daemon/separated_maps.h"

#include "core/promote.h"
#include "daemon/row_sums.h"

#include <stdlib.h>
#include <string.h>

enum { BAND_ROWS = 128 - 2 * (LS_PROMOTE_HALO_PX + LS_DEMOSAIC_HALO) };

/* Everything one pass needs; bands share the buffers. */
struct pass {
    const struct ls_field_source *source;
    const struct ls_separation *separation;
    const uint32_t *spectra;
    uint32_t n;
    float **maps;
    float *rows;    /* [n][n_lights], g(i,s) */
    float *spheres; /* [n][n_spectra] */
    struct ls_relight_rows f;
    float *diffuse, *specular, *conductor; /* [n][padded band][n_channels] */
    float *f_rgb, *sigma, *ratio;          /* [padded band][n_channels] */
};

struct band {
    uint32_t y0, y1;
    struct ls_demosaic_region padded;
};

static uint32_t below(uint32_t y, uint32_t halo, uint32_t height)
{
    return height - y > halo ? y + halo : height;
}

static struct band band_at(const struct ls_field *field, uint32_t y0)
{
    struct band band = {.y0 = y0, .y1 = below(y0, BAND_ROWS, field->height)};
    uint32_t top = y0 > LS_PROMOTE_HALO_PX ? y0 - LS_PROMOTE_HALO_PX : 0;
    uint32_t end = below(band.y1, LS_PROMOTE_HALO_PX, field->height);
    band.padded = (struct ls_demosaic_region){0, top, field->width, end - top};
    return band;
}

static void pass_finish(struct pass *pass)
{
    ls_relight_rows_finish(&pass->f);
    free(pass->rows);
    free(pass->spheres);
    free(pass->diffuse);
    free(pass->specular);
    free(pass->conductor);
    free(pass->f_rgb);
    free(pass->sigma);
    free(pass->ratio);
}

static void fill_rows(struct pass *pass, uint32_t q)
{
    const struct ls_field *field = &pass->source->field;
    uint32_t n = field->n_lights, s = pass->spectra[q];
    for (uint32_t i = 0; i < n; i++)
        pass->rows[(size_t)q * n + i] = (float)field->g[(size_t)s * n + i];
    pass->spheres[(size_t)q * field->n_spectra + s] = (float)ls_promote_sphere_factor(field, s);
}

static enum ls_err pass_init(struct pass *pass, struct ls_diag *diag)
{
    const struct ls_field *field = &pass->source->field;
    const struct ls_demosaic_region whole = {0, 0, field->width, field->height};
    size_t padded =
        sizeof(float) * field->width * (BAND_ROWS + 2 * LS_PROMOTE_HALO_PX) * field->n_channels;
    pass->rows = calloc((size_t)pass->n * field->n_lights, sizeof(float));
    pass->spheres = calloc((size_t)pass->n * field->n_spectra, sizeof(float));
    pass->diffuse = malloc(padded * pass->n);
    pass->specular = malloc(padded * pass->n);
    pass->conductor = malloc(padded * pass->n);
    pass->f_rgb = malloc(padded);
    pass->sigma = malloc(padded);
    pass->ratio = malloc(padded);
    if (!pass->rows || !pass->spheres || !pass->diffuse || !pass->specular || !pass->conductor ||
        !pass->f_rgb || !pass->sigma || !pass->ratio)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for the separation of %u spectra",
                       pass->n);
    for (uint32_t q = 0; q < pass->n; q++)
        fill_rows(pass, q);
    const struct ls_accumulate_job f = {.pictures = field->sphere,
                                        .n_pictures = field->n_spectra,
                                        .n_sums = pass->n,
                                        .weights = pass->spheres};
    ls_relight_rows_init(&pass->f, field, &f, &whole, 0);
    return LS_OK;
}

static enum ls_err one_ratio(struct pass *pass, const struct band *band, uint32_t q,
                             struct ls_diag *diag)
{
    const struct ls_field *field = &pass->source->field;
    uint32_t colours = field->n_channels, width = band->padded.width, height = band->padded.height;
    size_t pixels = (size_t)width * height, n = pixels * colours, row = (size_t)width * colours;
    float *diffuse = pass->diffuse + q * n, *specular = pass->specular + q * n;
    const float *weights = pass->rows + (size_t)q * field->n_lights;
    double tint[3];
    ls_separation_tint(pass->separation, pass->source, pass->spectra[q], tint);
    enum ls_err err = ls_relight_demosaic(field, ls_relight_rows_get(&pass->f, q), pass->f.window,
                                          band->padded, pass->f_rgb);
    if (err)
        return ls_fail(diag, err, "rows %u to %u cannot be demosaiced", band->y0, band->y1);
    for (size_t k = 0; k < n; k++) /* what is lit, for its noise */
        pass->ratio[k] = diffuse[k] + specular[k];
    ls_separated_sigma(&pass->separation->field, weights, pass->ratio, n, pass->sigma);
    ls_separate_remainder(pass->f_rgb, diffuse, specular, pass->conductor + q * n, tint, pixels,
                          colours, pass->f_rgb, diffuse);
    if (colours > 1)
        ls_promote_add_contrast(diffuse, width, height, colours, pass->sigma);
    err = ls_promote_ratio(pass->f_rgb, diffuse, pass->sigma, width, height, colours, tint,
                           pass->ratio, diag);
    if (!err)
        memcpy(pass->maps[q] + band->y0 * row, pass->ratio + (band->y0 - band->padded.y) * row,
               (band->y1 - band->y0) * row * sizeof(float));
    return err;
}

static enum ls_err one_band(struct pass *pass, const struct band *band, struct ls_diag *diag)
{
    const struct ls_crew crew = {.n_threads = ls_crew_threads()};
    const struct ls_field *field = &pass->source->field;
    const struct ls_separated_job job = {.field = &pass->separation->field,
                                         .n_rows = pass->n,
                                         .weights = pass->rows,
                                         .region = band->padded,
                                         .method = LS_DEMOSAIC_GRADIENT};
    struct ls_separated_report report;
    uint32_t end = band->padded.y + band->padded.height;
    uint32_t top = band->padded.y > LS_DEMOSAIC_HALO ? band->padded.y - LS_DEMOSAIC_HALO : 0;
    enum ls_err err =
        ls_row_sums_need(&pass->f, &crew, top, below(end, LS_DEMOSAIC_HALO, field->height), diag);
    if (!err)
        err = ls_separated_accumulate(&job, pass->diffuse, pass->specular, pass->conductor, &report,
                                      diag);
    for (uint32_t q = 0; q < pass->n && !err; q++)
        err = one_ratio(pass, band, q, diag);
    return err;
}

enum ls_err ls_separated_maps_make(const struct ls_field_source *source,
                                   const struct ls_separation *separation, const uint32_t *spectra,
                                   uint32_t n, const struct ls_job *asker, float **maps,
                                   struct ls_diag *diag)
{
    struct pass pass = {
        .source = source, .separation = separation, .spectra = spectra, .n = n, .maps = maps};
    enum ls_err err = pass_init(&pass, diag);
    for (uint32_t y = 0; y < source->height && !err; y += BAND_ROWS) {
        struct band band = band_at(&source->field, y);
        err = asker && ls_job_cancelled(asker) ? ls_fail(diag, LS_ERR_ABORTED, "cancelled")
                                               : one_band(&pass, &band, diag);
    }
    pass_finish(&pass);
    return err;
}
