#include "daemon/linear_maps.h"

#include "core/mono_blend.h"
#include "daemon/light_set.h"
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

/* Weights of the lights of segment @q, of all of them blended (phi), or of all (neither): the
 * spectrum's strengths. */
static void fill_lights(const struct ls_linear_job *job, uint32_t q, const double *phi, double *w)
{
    const double *g = job->field->g + (size_t)job->s * job->field->n_lights;
    for (uint32_t i = 0; i < job->field->n_lights; i++)
        w[i] = g[i] * (phi                           ? phi[(size_t)i * job->n_segments + q]
                       : q < job->n_segments ? job->segment[i] == q
                                             : 1);
}

/* V_g: lights of segment g under the spectrum's strengths; U_g: all lights, blended too. */
static enum ls_err fill_v_rows(const struct pass *pass, uint32_t k, double *w, struct ls_diag *diag)
{
    const struct ls_linear_job *job = pass->job;
    const struct ls_light_set *set = job->set[k];
    uint32_t n_lights = job->field->n_lights;
    enum ls_err err = LS_OK;
    for (uint32_t q = 0; q < job->n_segments && !err; q++) {
        float *row = pass->v_rows[k] + (size_t)q * set->n_pictures;
        fill_lights(job, q, NULL, w);
        err = ls_light_set_row(set, w, n_lights, row, diag);
        if (err || !job->phi)
            continue;
        fill_lights(job, q, job->phi, w);
        err = ls_light_set_row(set, w, n_lights, row + (size_t)job->n_segments * set->n_pictures,
                               diag);
    }
    return err;
}

static struct ls_linear_noise noise_of(const struct ls_field *field, const float *row, uint32_t n)
{
    double squares = 0, sum = 0, largest = 0;
    for (size_t j = 0; j < n; j++) {
        squares += (double)row[j] * (double)row[j];
        sum += (double)row[j];
        largest = fmax(largest, (double)row[j]);
    }
    return (struct ls_linear_noise){field->noise.read_variance * squares +
                                        field->noise.dark_variance * sum * sum,
                                    field->noise.shot * largest};
}

/* Of V under @w: multiplexed pictures have the shot noise of every light, all taken to be alike. */
static struct ls_linear_noise v_noise_of(const struct ls_linear_job *job, const double *w,
                                         const float *row)
{
    const struct ls_light_set *set = job->set[0];
    struct ls_linear_noise noise = noise_of(job->field, row, set->n_pictures);
    if (ls_light_set_is_multiplexed(set))
        noise.shot = job->field->noise.shot *
                     ls_light_set_shot(set, w, job->field->n_lights, row);
    return noise;
}

static enum ls_err fill_noise(struct pass *pass, double *w, struct ls_diag *diag)
{
    const struct ls_linear_job *job = pass->job;
    uint32_t n = job->set[0]->n_pictures, n_segments = job->n_segments;
    LS_CLEANUP_FREE float *all = calloc(n, sizeof *all);
    if (!all)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for the weights of %u pictures", n);
    for (uint32_t q = 0; q < n_segments; q++) {
        fill_lights(job, q, NULL, w);
        pass->v_noise[q] = v_noise_of(job, w, pass->v_rows[0] + (size_t)q * n);
        pass->f_noise[q] = noise_of(job->field, pass->f_rows + (size_t)q * n_segments, n_segments);
    }
    fill_lights(job, n_segments, NULL, w);
    enum ls_err err = ls_light_set_row(job->set[0], w, job->field->n_lights, all, diag);
    pass->total_noise = v_noise_of(job, w, all);
    return err;
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
    LS_CLEANUP_FREE double *w = calloc(job->field->n_lights, sizeof *w);
    enum ls_err err =
        w ? LS_OK : ls_fail(diag, LS_ERR_NOMEM, "out of memory for the weights of lights");
    for (uint32_t k = 0; k < job->n_sets && !err; k++) {
        err = fill_v_rows(pass, k, w, diag);
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
    return err ? err : fill_noise(pass, w, diag);
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
