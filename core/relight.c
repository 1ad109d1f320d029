#include "core/relight.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

enum { GROUP = LS_ACCUMULATE_GROUP };

static const uint16_t zero_row[LS_TILE_SIDE];

/** One call of ls_accumulate. */
struct pass {
    const struct ls_accumulate_kernel *kernel;
    const struct ls_field *field;
    const struct ls_accumulate_job *job;
    const struct ls_tile_region *region;
    size_t width, height; /* of the region, px */
    float *sums;
    float *rows; /* [LS_TILE_SIDE][n_sums][LS_TILE_SIDE], the sums of one tile, close together */
    struct ls_accumulate_report *report;
    /* for max_error: pictures by rising bound, what is left out of each sum, who is left out */
    struct bound {
        double most;
        uint32_t picture;
    } * order;
    double *left_out; /* [n_sums] */
    bool *skip;       /* [n_pictures] */
};

/** A tile: its place in the picture's tiles and in the region's pixels. */
struct tile {
    size_t index, x, y;
    uint32_t width, height;
};

static float weight(const struct ls_accumulate_job *job, uint32_t q, uint32_t picture)
{
    return job->weights[(size_t)q * job->n_pictures + picture];
}

static bool weightless(const struct ls_accumulate_job *job, uint32_t picture)
{
    for (uint32_t q = 0; q < job->n_sums; q++)
        if (weight(job, q, picture) != 0)
            return false;
    return true;
}

static void run_group(const struct pass *pass, const struct tile *tile, const uint32_t *pictures,
                      uint32_t n)
{
    float w[LS_ACCUMULATE_MAX_SUMS][GROUP];
    const void *rows[GROUP];
    uint32_t n_sums = pass->job->n_sums;
    for (uint32_t q = 0; q < n_sums; q++)
        for (uint32_t i = 0; i < GROUP; i++)
            w[q][i] = i < n ? weight(pass->job, q, pictures[i]) : 0;
    for (uint32_t y = 0; y < tile->height; y++) {
        for (uint32_t i = 0; i < GROUP; i++)
            rows[i] = i < n ? (const char *)pass->job->pictures[pictures[i]].tiles[tile->index] +
                                  2 * (size_t)y * tile->width
                            : (const void *)zero_row;
        float *acc = pass->rows + (size_t)y * n_sums * LS_TILE_SIDE;
        pass->report->not_finite += pass->kernel->rows(rows, (const float(*)[GROUP])w, n_sums,
                                                       tile->width, acc, LS_TILE_SIDE);
    }
}

static void hand_over(const struct pass *pass, const struct tile *tile)
{
    uint32_t n_sums = pass->job->n_sums;
    for (uint32_t q = 0; q < n_sums; q++)
        for (uint32_t y = 0; y < tile->height; y++)
            memcpy(pass->sums + (q * pass->height + tile->y + y) * pass->width + tile->x,
                   pass->rows + ((size_t)y * n_sums + q) * LS_TILE_SIDE,
                   sizeof *pass->sums * tile->width);
}

static int by_bound(const void *a, const void *b)
{
    const struct bound *x = a, *y = b;
    if (x->most != y->most)
        return x->most < y->most ? -1 : 1;
    return x->picture < y->picture ? -1 : x->picture > y->picture;
}

static double bound_of(const struct pass *pass, const struct tile *tile, uint32_t q,
                       uint32_t picture)
{
    double most = (double)pass->job->tile_max[tile->index * pass->job->n_pictures + picture];
    return fabs((double)weight(pass->job, q, picture)) * fabs(most);
}

static bool try_leave_out(struct pass *pass, const struct tile *tile, uint32_t picture)
{
    uint32_t n_sums = pass->job->n_sums;
    for (uint32_t q = 0; q < n_sums; q++)
        if (!(pass->left_out[q] + bound_of(pass, tile, q, picture) <= pass->job->max_error))
            return false;
    for (uint32_t q = 0; q < n_sums; q++) {
        pass->left_out[q] += bound_of(pass, tile, q, picture);
        pass->report->bound = fmax(pass->report->bound, pass->left_out[q]);
    }
    return true;
}

static void choose_skips(struct pass *pass, const struct tile *tile)
{
    const struct ls_accumulate_job *job = pass->job;
    memset(pass->left_out, 0, sizeof *pass->left_out * job->n_sums);
    for (uint32_t i = 0; i < job->n_pictures; i++) {
        pass->order[i] = (struct bound){0, i};
        for (uint32_t q = 0; q < job->n_sums; q++)
            pass->order[i].most = fmax(pass->order[i].most, bound_of(pass, tile, q, i));
    }
    qsort(pass->order, job->n_pictures, sizeof *pass->order, by_bound);
    for (uint32_t i = 0; i < job->n_pictures; i++) {
        uint32_t picture = pass->order[i].picture;
        pass->skip[picture] = !weightless(job, picture) && try_leave_out(pass, tile, picture);
    }
}

static void run_tile(struct pass *pass, const struct tile *tile)
{
    const struct ls_accumulate_job *job = pass->job;
    uint32_t group[GROUP], n = 0;
    if (pass->skip)
        choose_skips(pass, tile);
    memset(pass->rows, 0, sizeof *pass->rows * tile->height * job->n_sums * LS_TILE_SIDE);
    for (uint32_t i = 0; i < job->n_pictures; i++) {
        if (weightless(job, i) || !job->pictures[i].tiles[tile->index] ||
            (pass->skip && pass->skip[i])) {
            pass->report->tiles_skipped++;
            continue;
        }
        pass->report->tiles_read++;
        group[n++] = i;
        if (n == GROUP) {
            run_group(pass, tile, group, n);
            n = 0;
        }
    }
    if (n > 0)
        run_group(pass, tile, group, n);
    hand_over(pass, tile);
}

static void run_tiles(struct pass *pass)
{
    const struct ls_tile_region *r = pass->region;
    size_t tiles_x = ls_field_tiles_x(pass->field);
    for (uint32_t ty = r->y0; ty < r->y1; ty++) {
        for (uint32_t tx = r->x0; tx < r->x1; tx++) {
            struct ls_tile_region one = {tx, ty, tx + 1, ty + 1};
            struct tile tile = {.index = ty * tiles_x + tx,
                                .x = (size_t)(tx - r->x0) * LS_TILE_SIDE,
                                .y = (size_t)(ty - r->y0) * LS_TILE_SIDE,
                                .width = ls_region_width_px(pass->field, &one),
                                .height = ls_region_height_px(pass->field, &one)};
            run_tile(pass, &tile);
        }
    }
}

static enum ls_err check(const struct ls_field *field, const struct ls_accumulate_job *job,
                         const struct ls_tile_region *r, struct ls_diag *diag)
{
    if (r->x0 >= r->x1 || r->y0 >= r->y1 || r->x1 > ls_field_tiles_x(field) ||
        r->y1 > ls_field_tiles_y(field))
        return ls_fail(diag, LS_ERR_INVALID,
                       "relight: tiles [%u, %u) x [%u, %u): expected a part of %u x %u", r->x0,
                       r->x1, r->y0, r->y1, ls_field_tiles_x(field), ls_field_tiles_y(field));
    if (job->n_sums < 1 || job->n_sums > LS_ACCUMULATE_MAX_SUMS)
        return ls_fail(diag, LS_ERR_INVALID, "relight: %u sums: expected 1..%d", job->n_sums,
                       LS_ACCUMULATE_MAX_SUMS);
    if (!(job->max_error >= 0) || (job->max_error > 0 && !job->tile_max))
        return ls_fail(diag, LS_ERR_INVALID,
                       "relight: an error of %g is asked for: expected a "
                       "number >= 0, and the maxima of the tiles",
                       job->max_error);
    for (uint32_t q = 0; q < job->n_sums; q++)
        for (uint32_t i = 0; i < job->n_pictures; i++)
            if (!isfinite(weight(job, q, i)))
                return ls_fail(diag, LS_ERR_INVALID,
                               "relight: weight of light %u in sum %u is not a finite number", i,
                               q);
    return LS_OK;
}

static enum ls_err run_with_skips(struct pass *pass, struct ls_diag *diag)
{
    LS_CLEANUP_FREE struct bound *order = calloc(pass->job->n_pictures + 1u, sizeof *order);
    LS_CLEANUP_FREE double *left_out = calloc(pass->job->n_sums, sizeof *left_out);
    LS_CLEANUP_FREE bool *skip = calloc(pass->job->n_pictures + 1u, sizeof *skip);
    if (!order || !left_out || !skip)
        return ls_fail(diag, LS_ERR_NOMEM, "relight: out of memory");
    pass->order = order;
    pass->left_out = left_out;
    pass->skip = skip;
    run_tiles(pass);
    return LS_OK;
}

enum ls_err ls_accumulate_with(const struct ls_accumulate_kernel *kernel,
                               const struct ls_field *field, const struct ls_accumulate_job *job,
                               const struct ls_tile_region *region, float *sums,
                               struct ls_accumulate_report *report, struct ls_diag *diag)
{
    struct ls_accumulate_report unused;
    enum ls_err err = check(field, job, region, diag);
    if (err)
        return err;
    struct pass pass = {.kernel = kernel,
                        .field = field,
                        .job = job,
                        .region = region,
                        .width = ls_region_width_px(field, region),
                        .height = ls_region_height_px(field, region),
                        .sums = sums,
                        .report = report ? report : &unused};
    *pass.report = (struct ls_accumulate_report){0};
    LS_CLEANUP_FREE float *rows =
        calloc((size_t)job->n_sums * LS_TILE_SIDE * LS_TILE_SIDE, sizeof *rows);
    if (!rows)
        return ls_fail(diag, LS_ERR_NOMEM, "relight: out of memory");
    pass.rows = rows;
    if (job->max_error > 0)
        return run_with_skips(&pass, diag);
    run_tiles(&pass);
    return LS_OK;
}

enum ls_err ls_accumulate(const struct ls_field *field, const struct ls_accumulate_job *job,
                          const struct ls_tile_region *region, float *sums,
                          struct ls_accumulate_report *report, struct ls_diag *diag)
{
    return ls_accumulate_with(ls_accumulate_kernel(NULL), field, job, region, sums, report, diag);
}
