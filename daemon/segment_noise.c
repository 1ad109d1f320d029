#include "daemon/segment_noise.h"

#include "daemon/light_set.h"
#include "daemon/segment_sums.h"

#include <math.h>
#include <stdlib.h>

static struct ls_linear_noise noise_of(const struct ls_field *field, const float *row, uint32_t n)
{
    double squares = 0, sum = 0, largest = 0;
    for (uint32_t j = 0; j < n; j++) {
        squares += (double)row[j] * (double)row[j];
        sum += (double)row[j];
        largest = fmax(largest, (double)row[j]);
    }
    return (struct ls_linear_noise){field->noise.read_variance * squares +
                                        field->noise.dark_variance * sum * sum,
                                    field->noise.shot * largest};
}

/* Of V of a segment, or with UINT32_MAX of all lights; multiplexed pictures have the shot noise of
 * every light, all taken to be alike. @w and @row have room for ls_segment_row. */
static enum ls_err v_noise(const struct ls_linear_job *job, const struct ls_linear_target *target,
                           uint32_t segment, double *w, float *row, struct ls_linear_noise *out,
                           struct ls_diag *diag)
{
    const struct ls_light_set *set = job->set[0];
    enum ls_err err = ls_segment_row(job, target, 0, segment, -1, w, row, diag);
    if (err)
        return err;
    *out = noise_of(job->field, row, set->n_pictures);
    if (ls_light_set_is_multiplexed(set))
        out->shot = job->field->noise.shot * ls_light_set_shot(set, w, job->field->n_lights, row);
    return LS_OK;
}

enum ls_err ls_segment_noise_init(struct ls_segment_noise *noise, const struct ls_linear_job *job,
                                  const struct ls_linear_target *target, struct ls_diag *diag)
{
    LS_CLEANUP_FREE double *w = malloc(job->field->n_lights * sizeof *w);
    LS_CLEANUP_FREE float *row = malloc(job->set[0]->n_pictures * sizeof *row);
    enum ls_err err = LS_OK;
    noise->v = calloc(job->n_segments, sizeof *noise->v);
    noise->f = calloc(job->n_segments, sizeof *noise->f);
    if (!w || !row || !noise->v || !noise->f)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for %u segments", job->n_segments);
    for (uint32_t q = 0; q < job->n_segments && !err; q++) {
        float factor = (float)target->factor[q];
        noise->f[q] = noise_of(job->field, &factor, 1);
        err = v_noise(job, target, q, w, row, &noise->v[q], diag);
    }
    return err ? err : v_noise(job, target, UINT32_MAX, w, row, &noise->total, diag);
}

void ls_segment_noise_finish(struct ls_segment_noise *noise)
{
    free(noise->v);
    free(noise->f);
}
