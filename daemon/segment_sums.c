#include "daemon/segment_sums.h"

#include "core/relight.h"
#include "daemon/light_set.h"

#include <stdlib.h>
#include <string.h>

/* Sums in order: V [set][segment][target][row], U [target][segment], F [target][segment]. */

static uint32_t first_u(const struct ls_linear_job *job, uint32_t n)
{
    return job->n_sets * job->n_segments * n * job->n_rows;
}

static uint32_t first_f(const struct ls_linear_job *job, uint32_t n)
{
    return first_u(job, n) + (job->phi ? job->n_segments * n : 0);
}

static uint32_t n_sums(const struct ls_linear_job *job, uint32_t n)
{
    return first_f(job, n) + job->n_segments * n;
}

static float *sum_at(const struct ls_segment_sums *sums, uint32_t index)
{
    return sums->sums + index * sums->plane;
}

const float *ls_segment_sums_v(const struct ls_segment_sums *sums, uint32_t t, uint32_t set,
                               uint32_t g, uint32_t colour)
{
    uint32_t v = (set * sums->job->n_segments + g) * sums->n + t;
    return sum_at(sums, v * sums->job->n_rows + colour);
}

const float *ls_segment_sums_u(const struct ls_segment_sums *sums, uint32_t t, uint32_t g)
{
    return sum_at(sums, first_u(sums->job, sums->n) + t * sums->job->n_segments + g);
}

const float *ls_segment_sums_f(const struct ls_segment_sums *sums, uint32_t t, uint32_t g)
{
    return sum_at(sums, first_f(sums->job, sums->n) + t * sums->job->n_segments + g);
}

static size_t plane_of(const struct ls_field *field)
{
    uint32_t most = LS_TILE_SIDE + LS_SEGMENT_SUMS_KEEP;
    return (size_t)field->width * (field->height < most ? field->height : most);
}

size_t ls_segment_sums_bytes(const struct ls_linear_job *job)
{
    return sizeof(float) * plane_of(job->field) * n_sums(job, 1);
}

enum ls_err ls_segment_sums_init(struct ls_segment_sums *sums, const struct ls_linear_job *job,
                                 uint32_t first, uint32_t n, struct ls_diag *diag)
{
    *sums = (struct ls_segment_sums){.job = job,
                                     .first = first,
                                     .n = n,
                                     .window = {0, 0, job->field->width, 0},
                                     .plane = plane_of(job->field)};
    sums->sums = malloc(sizeof(float) * sums->plane * n_sums(job, n));
    return sums->sums ? LS_OK
                      : ls_fail(diag, LS_ERR_NOMEM, "out of memory for a fit on %u segments",
                                job->n_segments);
}

void ls_segment_sums_finish(struct ls_segment_sums *sums)
{
    free(sums->sums);
    *sums = (struct ls_segment_sums){0};
}

/* ---- weights ---- */

enum ls_err ls_segment_row(const struct ls_linear_job *job, const struct ls_linear_target *target,
                           uint32_t set, uint32_t segment, int32_t colour, double *w, float *row,
                           struct ls_diag *diag)
{
    uint32_t n = job->field->n_lights;
    const double *g = job->field->g + (size_t)target->s * n;
    const double *factor = colour < 0 ? NULL : target->colour;
    for (uint32_t i = 0; i < n; i++) {
        w[i] = segment == UINT32_MAX || job->segment[i] == segment ? g[i] : 0;
        w[i] /= factor ? factor[3 * i + (uint32_t)colour] : 1;
    }
    return ls_light_set_row(job->set[set], w, n, colour, row, diag);
}

static enum ls_err blended_row(const struct ls_linear_job *job, uint32_t s, uint32_t segment,
                               double *w, float *row, struct ls_diag *diag)
{
    uint32_t n = job->field->n_lights;
    const double *g = job->field->g + (size_t)s * n;
    for (uint32_t i = 0; i < n; i++)
        w[i] = g[i] * job->phi[(size_t)i * job->n_segments + segment];
    return ls_light_set_row(job->set[0], w, n, -1, row, diag);
}

/* ---- sums ---- */

/* The next tile row of the sums from @index on. */
static enum ls_err accumulate(const struct ls_segment_sums *sums, const struct ls_accumulate_job *a,
                              uint32_t index, struct ls_diag *diag)
{
    const struct ls_field *field = sums->job->field;
    const struct ls_tile_region tiles = {0, sums->tile_row, ls_field_tiles_x(field),
                                         sums->tile_row + 1};
    struct ls_accumulate_report report;
    float *to = sum_at(sums, index) + (size_t)sums->window.height * field->width;
    return ls_accumulate(field, a, &tiles, to, &report, diag);
}

/* Segment @g of set @set under the strengths of every target. */
static enum ls_err add_v(const struct ls_segment_sums *sums, uint32_t set, uint32_t g, double *w,
                         float *rows, struct ls_diag *diag)
{
    const struct ls_linear_job *job = sums->job;
    uint32_t n = job->set[set]->n_pictures, n_rows = sums->n * job->n_rows;
    enum ls_err err = LS_OK;
    for (uint32_t q = 0; q < n_rows && !err; q++)
        err = ls_segment_row(job, &job->targets[sums->first + q / job->n_rows], set, g,
                             job->n_rows > 1 ? (int32_t)(q % job->n_rows) : -1, w,
                             rows + (size_t)q * n, diag);
    const struct ls_accumulate_job a = {.pictures = job->set[set]->pictures,
                                        .n_pictures = n,
                                        .n_sums = n_rows,
                                        .weights = rows,
                                        .sum_stride = sums->plane};
    return err ? err : accumulate(sums, &a, (set * job->n_segments + g) * n_rows, diag);
}

static enum ls_err add_u(const struct ls_segment_sums *sums, uint32_t t, uint32_t g, double *w,
                         float *row, struct ls_diag *diag)
{
    const struct ls_linear_job *job = sums->job;
    enum ls_err err = blended_row(job, job->targets[sums->first + t].s, g, w, row, diag);
    const struct ls_accumulate_job a = {.pictures = job->set[0]->pictures,
                                        .n_pictures = job->set[0]->n_pictures,
                                        .n_sums = 1,
                                        .weights = row,
                                        .sum_stride = sums->plane};
    return err ? err : accumulate(sums, &a, first_u(job, sums->n) + t * job->n_segments + g, diag);
}

static enum ls_err add_f(const struct ls_segment_sums *sums, uint32_t t, uint32_t g,
                         struct ls_diag *diag)
{
    const struct ls_linear_target *target = &sums->job->targets[sums->first + t];
    const float factor = (float)target->factor[g];
    const struct ls_accumulate_job a = {.pictures = &target->f[g],
                                        .n_pictures = 1,
                                        .n_sums = 1,
                                        .weights = &factor,
                                        .sum_stride = sums->plane};
    return accumulate(sums, &a, first_f(sums->job, sums->n) + t * sums->job->n_segments + g, diag);
}

/* Item: a V of all targets, or one U or F. */
static enum ls_err add_item(void *user, uint32_t item, unsigned thread, struct ls_diag *diag)
{
    const struct ls_segment_sums *sums = user;
    const struct ls_linear_job *job = sums->job;
    uint32_t n_v = job->n_sets * job->n_segments, set = item < n_v ? item / job->n_segments : 0;
    uint32_t index = item < n_v ? 0 : first_u(job, sums->n) + item - n_v;
    uint32_t at = index < first_f(job, sums->n) ? item - n_v : index - first_f(job, sums->n);
    if (item >= n_v && index >= first_f(job, sums->n))
        return add_f(sums, at / job->n_segments, at % job->n_segments, diag);
    LS_CLEANUP_FREE double *room = malloc(job->field->n_lights * sizeof *room);
    LS_CLEANUP_FREE float *rows =
        malloc((size_t)sums->n * job->n_rows * job->set[set]->n_pictures * sizeof *rows);
    if (!room || !rows)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for weights");
    return item < n_v ? add_v(sums, set, item % job->n_segments, room, rows, diag)
                      : add_u(sums, at / job->n_segments, at % job->n_segments, room, rows, diag);
}

/* Rows from @y on move to the top. */
static void roll(struct ls_segment_sums *sums, uint32_t y)
{
    size_t width = sums->window.width, skip = y - sums->window.y;
    size_t kept = sums->window.height - skip;
    uint32_t n = n_sums(sums->job, sums->n);
    for (uint32_t q = 0; q < n && skip > 0; q++)
        memmove(sum_at(sums, q), sum_at(sums, q) + skip * width, kept * width * sizeof(float));
    sums->window.y = y;
    sums->window.height = (uint32_t)kept;
}

enum ls_err ls_segment_sums_advance(struct ls_segment_sums *sums, uint32_t y, struct ls_diag *diag)
{
    const struct ls_linear_job *job = sums->job;
    const struct ls_field *field = job->field;
    uint32_t n_items = job->n_sets * job->n_segments + n_sums(job, sums->n) - first_u(job, sums->n);
    uint32_t end = (sums->tile_row + 1) * LS_TILE_SIDE;
    roll(sums, y);
    enum ls_err err = ls_crew_run(&job->crew, n_items, add_item, sums, diag);
    end = end < field->height ? end : field->height;
    sums->window.height = end - sums->window.y;
    sums->tile_row++;
    return err;
}
