#include "daemon/ratio_maps.h"

#include "core/promote.h"
#include "daemon/row_sums.h"

#include <stdlib.h>
#include <string.h>

enum { BAND_ROWS = 128, PADDED_ROWS = BAND_ROWS + 2 * LS_PROMOTE_HALO_PX };

/* Everything one pass needs; bands share the buffers. */
struct pass {
    const struct ls_field *field;
    const struct ls_ratio_job *job;
    struct ls_relight_rows v, f;
    float *v_rgb, *f_rgb, *sigma, *ratio; /* padded band, [height][width][n_channels] */
};

struct band {
    uint32_t y0, y1;                  /* rows wanted */
    struct ls_demosaic_region padded; /* with the ratio's halo */
    uint32_t top, end;                /* with the demosaic's halo around that */
};

static uint32_t above(uint32_t y, uint32_t halo)
{
    return y > halo ? y - halo : 0;
}

static uint32_t below(uint32_t y, uint32_t halo, uint32_t height)
{
    return height - y > halo ? y + halo : height;
}

static struct band band_at(const struct ls_field *field, uint32_t y0)
{
    struct band band = {.y0 = y0, .y1 = below(y0, BAND_ROWS, field->height)};
    uint32_t top = above(y0, LS_PROMOTE_HALO_PX);
    uint32_t end = below(band.y1, LS_PROMOTE_HALO_PX, field->height);
    band.padded = (struct ls_demosaic_region){0, top, field->width, end - top};
    band.top = above(top, LS_DEMOSAIC_HALO);
    band.end = below(end, LS_DEMOSAIC_HALO, field->height);
    return band;
}

static void pass_finish(struct pass *pass)
{
    ls_relight_rows_finish(&pass->v);
    ls_relight_rows_finish(&pass->f);
    free(pass->v_rgb);
    free(pass->f_rgb);
    free(pass->sigma);
    free(pass->ratio);
}

static uint32_t n_v_rows(const struct ls_ratio_job *job)
{
    return job->coloured ? 3 * job->n : job->n;
}

static enum ls_err pass_init(struct pass *pass, struct ls_diag *diag)
{
    const struct ls_field *field = pass->field;
    const struct ls_ratio_job *job = pass->job;
    const struct ls_accumulate_job v = {.pictures = job->v,
                                        .n_pictures = job->n_v,
                                        .n_sums = (job->squares ? 2 : 1) * n_v_rows(job),
                                        .weights = job->v_rows};
    const struct ls_accumulate_job f = {
        .pictures = job->f, .n_pictures = job->n_f, .n_sums = job->n, .weights = job->f_rows};
    const struct ls_demosaic_region whole = {0, 0, field->width, field->height};
    size_t padded = (size_t)field->width * PADDED_ROWS * field->n_channels * sizeof(float);
    ls_relight_rows_init(&pass->v, field, &v, &whole, 0);
    ls_relight_rows_init(&pass->f, field, &f, &whole, 0);
    pass->v_rgb = malloc(padded);
    pass->f_rgb = malloc(padded);
    pass->sigma = malloc(padded);
    pass->ratio = malloc(padded);
    if (!pass->v_rgb || !pass->f_rgb || !pass->sigma || !pass->ratio)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for the promotion of %u spectra", job->n);
    return LS_OK;
}

/* Of V, whose light is V itself or a sum of its own. */
static enum ls_err fill_sigma(struct pass *pass, const struct band *band, uint32_t q, size_t n)
{
    const struct ls_ratio_job *job = pass->job;
    uint32_t first = job->coloured ? 3 * q : q;
    const float *row = job->v_rows + (size_t)first * job->n_v;
    enum ls_err err = LS_OK;
    if (!job->squares) {
        ls_promote_sigma(pass->field, row, job->n_v, pass->v_rgb, n, pass->sigma);
        return LS_OK;
    }
    err = ls_relight_demosaic(pass->field, ls_relight_rows_get(&pass->v, n_v_rows(job) + first),
                              pass->v.window, band->padded, pass->ratio);
    ls_promote_sigma_light(pass->field, row, job->n_v, pass->ratio, n, pass->sigma);
    return err;
}

/* V, demosaiced; each colour from a sum of its own where lights differ in colour. */
static enum ls_err fill_v(struct pass *pass, const struct band *band, uint32_t q, size_t n)
{
    uint32_t n_sums = pass->job->coloured ? 3 : 1;
    enum ls_err err = LS_OK;
    for (uint32_t c = 0; c < n_sums && !err; c++) {
        float *to = c == 0 ? pass->v_rgb : pass->ratio;
        err = ls_relight_demosaic(pass->field, ls_relight_rows_get(&pass->v, n_sums * q + c),
                                  pass->v.window, band->padded, to);
        for (size_t j = c; j < n && c > 0; j += 3)
            pass->v_rgb[j] = pass->ratio[j];
    }
    return err;
}

static enum ls_err one_ratio(struct pass *pass, const struct band *band, uint32_t q,
                             struct ls_diag *diag)
{
    const struct ls_field *field = pass->field;
    const struct ls_ratio_job *job = pass->job;
    uint32_t colours = field->n_channels;
    size_t n = (size_t)band->padded.width * band->padded.height * colours;
    size_t row = (size_t)field->width * colours;
    enum ls_err err = fill_v(pass, band, q, n);
    if (!err)
        err = ls_relight_demosaic(field, ls_relight_rows_get(&pass->f, q), pass->f.window,
                                  band->padded, pass->f_rgb);
    if (err)
        return ls_fail(diag, err, "rows %u to %u cannot be demosaiced", band->top, band->end);
    err = fill_sigma(pass, band, q, n);
    if (err)
        return ls_fail(diag, err, "rows %u to %u cannot be demosaiced", band->top, band->end);
    if (colours > 1)
        ls_promote_add_contrast(pass->v_rgb, band->padded.width, band->padded.height, colours,
                                pass->sigma);
    err = ls_promote_ratio(pass->f_rgb, pass->v_rgb, pass->sigma, band->padded.width,
                           band->padded.height, colours, job->neutral[q], pass->ratio, diag);
    if (!err)
        memcpy(job->maps[q] + band->y0 * row, pass->ratio + (band->y0 - band->padded.y) * row,
               (band->y1 - band->y0) * row * sizeof(float));
    return err;
}

static enum ls_err one_band(struct pass *pass, const struct band *band, struct ls_diag *diag)
{
    const struct ls_crew crew = {.n_threads = ls_crew_threads()};
    enum ls_err err = ls_row_sums_need(&pass->v, &crew, band->top, band->end, diag);
    if (!err)
        err = ls_row_sums_need(&pass->f, &crew, band->top, band->end, diag);
    for (uint32_t q = 0; q < pass->job->n && !err; q++)
        err = one_ratio(pass, band, q, diag);
    return err;
}

enum ls_err ls_ratio_maps_make(const struct ls_field *field, const struct ls_ratio_job *job,
                               struct ls_diag *diag)
{
    struct pass pass = {.field = field, .job = job};
    enum ls_err err = pass_init(&pass, diag);
    for (uint32_t y = 0; y < field->height && !err; y += BAND_ROWS) {
        struct band band = band_at(field, y);
        err = job->asker && ls_job_cancelled(job->asker)
                  ? ls_fail(diag, LS_ERR_ABORTED, "cancelled")
                  : one_band(&pass, &band, diag);
    }
    pass_finish(&pass);
    return err;
}
