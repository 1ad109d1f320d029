#include "daemon/linear_maps.h"

#include "core/mono_blend.h"
#include "daemon/row_sums.h"

#include <math.h>
#include <stdlib.h>

enum { LEAST_ROWS = 16, MOST_ROWS = 128, ERROR_STEP = 4, HALO_PX = LS_LINEAR_HALO_PX };
static const size_t band_bytes = (size_t)100 << 20;

/* Everything one pass needs; bands share the buffers. */
struct pass {
    const struct ls_linear_job *job;
    uint32_t colours, n_in, rows; /* rows of a band */
    float *v_rows[LS_LINEAR_MAX_INPUTS], *f_rows;
    struct ls_row_sums v[LS_LINEAR_MAX_INPUTS], f;
    struct ls_linear_noise *v_noise, *f_noise, total_noise;
    float **v_planes, **u_planes, **f_planes; /* [n_segments] -> padded band */
    float *rgb;                               /* one demosaiced sum */
};

struct band {
    uint32_t y0, y1;
    struct ls_demosaic_region padded;
    uint32_t top, end;
};

static uint32_t above(uint32_t y, uint32_t halo)
{
    return y > halo ? y - halo : 0;
}

static uint32_t below(uint32_t y, uint32_t halo, uint32_t height)
{
    return height - y > halo ? y + halo : height;
}

static struct band band_at(const struct pass *pass, uint32_t y0)
{
    const struct ls_field *field = pass->job->field;
    struct band band = {.y0 = y0, .y1 = below(y0, pass->rows, field->height)};
    uint32_t top = above(y0, HALO_PX), end = below(band.y1, HALO_PX, field->height);
    band.padded = (struct ls_demosaic_region){0, top, field->width, end - top};
    band.top = above(top, LS_DEMOSAIC_HALO);
    band.end = below(end, LS_DEMOSAIC_HALO, field->height);
    return band;
}

/* ---- weights and noise ---- */

/* V_g: lights of segment g under the spectrum's strengths; U_g: all lights, blended too. */
static void fill_v_rows(const struct pass *pass, uint32_t k)
{
    const struct ls_linear_job *job = pass->job;
    const struct ls_light_set *set = job->set[k];
    const double *g = job->field->g + (size_t)job->s * job->field->n_lights;
    for (uint32_t j = 0; j < set->n_pictures; j++) {
        uint32_t i = j % job->field->n_lights;
        double w = g[i] * set->k[j];
        pass->v_rows[k][(size_t)job->segment[i] * set->n_pictures + j] = (float)w;
        for (uint32_t q = 0; q < job->n_segments && job->phi; q++)
            pass->v_rows[k][(size_t)(job->n_segments + q) * set->n_pictures + j] =
                (float)(w * job->phi[(size_t)i * job->n_segments + q]);
    }
}

static struct ls_linear_noise noise_of(const struct ls_field *field, const float *rows,
                                       uint32_t n_rows, uint32_t n)
{
    double squares = 0, sum = 0, largest = 0;
    for (size_t j = 0; j < (size_t)n_rows * n; j++) {
        squares += (double)rows[j] * (double)rows[j];
        sum += (double)rows[j];
        largest = fmax(largest, (double)rows[j]);
    }
    return (struct ls_linear_noise){field->noise.read_variance * squares +
                                        field->noise.dark_variance * sum * sum,
                                    field->noise.shot * largest};
}

static void fill_noise(struct pass *pass)
{
    const struct ls_linear_job *job = pass->job;
    uint32_t n = job->set[0]->n_pictures, n_segments = job->n_segments;
    for (uint32_t q = 0; q < n_segments; q++) {
        pass->v_noise[q] = noise_of(job->field, pass->v_rows[0] + (size_t)q * n, 1, n);
        pass->f_noise[q] =
            noise_of(job->field, pass->f_rows + (size_t)q * n_segments, 1, n_segments);
    }
    pass->total_noise = noise_of(job->field, pass->v_rows[0], n_segments, n);
}

/* ---- life ---- */

static void free_planes(float **planes, uint32_t n)
{
    for (uint32_t q = 0; planes && q < n; q++)
        free(planes[q]);
    free(planes);
}

static void pass_finish(struct pass *pass)
{
    for (uint32_t k = 0; k < LS_LINEAR_MAX_INPUTS; k++) {
        ls_row_sums_finish(&pass->v[k]);
        free(pass->v_rows[k]);
    }
    ls_row_sums_finish(&pass->f);
    free(pass->f_rows);
    free(pass->v_noise);
    free(pass->f_noise);
    free_planes(pass->v_planes, pass->job->n_segments);
    free_planes(pass->u_planes, pass->job->n_segments);
    free_planes(pass->f_planes, pass->job->n_segments);
    free(pass->rgb);
}

static float **make_planes(uint32_t n, size_t floats)
{
    float **planes = calloc(n, sizeof *planes);
    bool whole = planes != NULL;
    for (uint32_t q = 0; whole && q < n; q++)
        whole = (planes[q] = malloc(floats * sizeof(float))) != NULL;
    if (!whole)
        free_planes(planes, n);
    return whole ? planes : NULL;
}

/* What the sums of a row of the picture take, with all that is made of them. */
static void choose_rows(struct pass *pass)
{
    const struct ls_linear_job *job = pass->job;
    size_t sums = job->n_sets * (job->phi ? 2u : 1u) + 1;
    size_t made = pass->n_in * (job->phi ? 2u : 1u) + pass->colours;
    size_t row = sizeof(float) * job->field->width * job->n_segments * (sums + made);
    size_t around = 2 * (HALO_PX + LS_DEMOSAIC_HALO) + LS_TILE_SIDE;
    size_t rows = band_bytes / row;
    rows = rows > around + LEAST_ROWS ? rows - around : LEAST_ROWS;
    pass->rows = rows > MOST_ROWS ? MOST_ROWS : (uint32_t)(rows / LEAST_ROWS * LEAST_ROWS);
}

static enum ls_err allocate(struct pass *pass)
{
    const struct ls_linear_job *job = pass->job;
    size_t n = job->n_segments, sums = n * (job->phi ? 2 : 1);
    size_t padded = (size_t)job->field->width * (pass->rows + 2 * HALO_PX);
    bool whole = true;
    for (uint32_t k = 0; k < job->n_sets; k++)
        whole &= (pass->v_rows[k] = calloc(sums * job->set[k]->n_pictures, sizeof(float))) != NULL;
    pass->f_rows = calloc(n * n, sizeof *pass->f_rows);
    pass->v_noise = calloc(n, sizeof *pass->v_noise);
    pass->f_noise = calloc(n, sizeof *pass->f_noise);
    pass->v_planes = make_planes(job->n_segments, padded * pass->n_in);
    pass->f_planes = make_planes(job->n_segments, padded * pass->colours);
    if (job->phi)
        pass->u_planes = make_planes(job->n_segments, padded);
    pass->rgb = malloc(padded * pass->colours * sizeof(float));
    whole &= pass->f_rows && pass->v_noise && pass->f_noise && pass->v_planes && pass->f_planes &&
             (!job->phi || pass->u_planes) && pass->rgb;
    return whole ? LS_OK : LS_ERR_NOMEM;
}

static enum ls_err pass_init(struct pass *pass, struct ls_diag *diag)
{
    const struct ls_linear_job *job = pass->job;
    const struct ls_demosaic_region whole = {0, 0, job->field->width, job->field->height};
    pass->colours = job->field->n_channels;
    pass->n_in = job->n_sets * pass->colours;
    choose_rows(pass);
    if (allocate(pass))
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for a fit on %u segments",
                       job->n_segments);
    for (uint32_t q = 0; q < job->n_segments; q++)
        pass->f_rows[(size_t)q * job->n_segments + q] = (float)job->factor[q];
    for (uint32_t k = 0; k < job->n_sets; k++) {
        fill_v_rows(pass, k);
        const struct ls_accumulate_job v = {.pictures = job->set[k]->pictures,
                                            .n_pictures = job->set[k]->n_pictures,
                                            .n_sums = job->n_segments * (job->phi ? 2 : 1),
                                            .weights = pass->v_rows[k]};
        ls_row_sums_init(&pass->v[k], job->field, &v, &whole, 0);
    }
    const struct ls_accumulate_job f = {.pictures = job->f,
                                        .n_pictures = job->n_segments,
                                        .n_sums = job->n_segments,
                                        .weights = pass->f_rows};
    ls_row_sums_init(&pass->f, job->field, &f, &whole, 0);
    fill_noise(pass);
    return LS_OK;
}

/* ---- bands ---- */

/* Sum @q, demosaiced, into @plane of [pixels][depth] at @at. */
static enum ls_err fill_plane(struct pass *pass, const struct ls_row_sums *sums, uint32_t q,
                              const struct band *band, float *plane, uint32_t depth, uint32_t at)
{
    uint32_t colours = pass->colours;
    size_t n = (size_t)band->padded.width * band->padded.height;
    float *to = depth == colours ? plane : pass->rgb;
    enum ls_err err = ls_relight_demosaic(pass->job->field, ls_row_sums_get(sums, q), sums->window,
                                          band->padded, to);
    for (size_t p = 0; p < n && !err && depth != colours; p++)
        for (uint32_t c = 0; c < colours; c++)
            plane[p * depth + at + c] = pass->rgb[p * colours + c];
    return err;
}

static enum ls_err fill_planes(struct pass *pass, const struct band *band, struct ls_diag *diag)
{
    const struct ls_linear_job *job = pass->job;
    enum ls_err err = ls_row_sums_need(&pass->f, band->top, band->end, diag);
    for (uint32_t k = 0; k < job->n_sets && !err; k++)
        err = ls_row_sums_need(&pass->v[k], band->top, band->end, diag);
    for (uint32_t q = 0; q < job->n_segments && !err; q++) {
        err = fill_plane(pass, &pass->f, q, band, pass->f_planes[q], pass->colours, 0);
        for (uint32_t k = 0; k < job->n_sets && !err; k++)
            err = fill_plane(pass, &pass->v[k], q, band, pass->v_planes[q], pass->n_in,
                             k * pass->colours);
        if (!err && job->phi)
            err = fill_plane(pass, &pass->v[0], job->n_segments + q, band, pass->u_planes[q], 1, 0);
    }
    return err;
}

static enum ls_err fit_matrices(struct pass *pass, const struct band *band,
                                struct ls_linear_error *error, struct ls_diag *diag)
{
    const struct ls_linear_job *job = pass->job;
    struct ls_linear_options options;
    struct ls_linear_pictures pictures = {.width = band->padded.width,
                                          .height = band->padded.height,
                                          .n_segments = job->n_segments,
                                          .n_in = pass->n_in,
                                          .n_out = pass->colours,
                                          .v = (const float *const *)pass->v_planes,
                                          .f = (const float *const *)pass->f_planes,
                                          .v_noise = pass->v_noise,
                                          .f_noise = pass->f_noise,
                                          .total_noise = pass->total_noise,
                                          .p_in = job->p_in,
                                          .p_out = job->field->p + job->s * pass->colours,
                                          .inputs = {0, 1, 2},
                                          .demosaiced = pass->colours > 1};
    uint32_t first = band->y0 - band->padded.y, n = band->y1 - band->y0;
    ls_linear_options_default(&options);
    float *out = job->map + (size_t)band->y0 * job->field->width * pass->colours * pass->n_in;
    enum ls_err err = ls_linear_fit(&pictures, &options, first, n, out, diag);
    if (!err && job->n_segments > 1)
        err = ls_linear_leave_one_out(&pictures, &options, first, n, ERROR_STEP, error, NULL, diag);
    return err;
}

static enum ls_err blend_ratios(struct pass *pass, const struct band *band, struct ls_diag *diag)
{
    const struct ls_linear_job *job = pass->job;
    const struct ls_mono_blend_pictures pictures = {.width = band->padded.width,
                                                    .height = band->padded.height,
                                                    .n_segments = job->n_segments,
                                                    .v = (const float *const *)pass->v_planes,
                                                    .u = (const float *const *)pass->u_planes,
                                                    .f = (const float *const *)pass->f_planes,
                                                    .v_noise = pass->v_noise,
                                                    .total_noise = pass->total_noise,
                                                    .neutral =
                                                        job->field->p[job->s] / job->p_in[0]};
    float *out = job->map + (size_t)band->y0 * job->field->width * job->n_segments;
    return ls_mono_blend_ratios(&pictures, band->y0 - band->padded.y, band->y1 - band->y0, out,
                                diag);
}

enum ls_err ls_linear_maps_make(const struct ls_linear_job *job, struct ls_linear_error *error,
                                struct ls_diag *diag)
{
    struct pass pass = {.job = job};
    enum ls_err err = pass_init(&pass, diag);
    for (uint32_t y = 0; y < job->field->height && !err; y += pass.rows) {
        struct band band = band_at(&pass, y);
        err = fill_planes(&pass, &band, diag);
        if (!err)
            err = job->phi ? blend_ratios(&pass, &band, diag)
                           : fit_matrices(&pass, &band, error, diag);
    }
    pass_finish(&pass);
    return err;
}
