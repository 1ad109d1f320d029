#include "core/relight.h"

#include "core/accumulate_kernels.h"
#include "core/left_out.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

enum { CHUNK = 512, ROW = LS_ACCUMULATE_ROW };

/** One call of ls_accumulate. */
struct pass {
    const struct ls_accumulate_kernels *kernels;
    const struct ls_field *field;
    const struct ls_accumulate_job *job;
    const struct ls_tile_region *region;
    size_t width, height; /* of the region, px */
    size_t row_stride, sum_stride;
    float *sums;
    float *weights; /* [n_pictures][n_sums] */
    float *acc;     /* [n_sums][CHUNK], of tiles that are narrower than others */
    uint32_t *used; /* [n_used], pictures with a weight */
    uint32_t n_used;
    const void **halfs; /* [n_pictures], of the tile at hand */
    const float **w;    /* [n_pictures], of the same pictures */
    float *packed;      /* the same, as the kernels take them */
    void *room;         /* theirs */
    struct ls_accumulate_report *report;
    struct ls_left_out *left_out; /* NULL without max_error */
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

static void hand_over(const struct pass *pass, const struct tile *tile, uint32_t first,
                      uint32_t count)
{
    for (uint32_t at = first; at < first + count;) {
        uint32_t x = at % tile->width, y = at / tile->width;
        uint32_t left = first + count - at, n = tile->width - x < left ? tile->width - x : left;
        for (uint32_t q = 0; q < pass->job->n_sums; q++)
            memcpy(pass->sums + q * pass->sum_stride + (tile->y + y) * pass->row_stride + tile->x +
                       x,
                   pass->acc + (size_t)q * CHUNK + (at - first), sizeof *pass->acc * n);
        at += n;
    }
}

/* Pixels [first, first + count) of the tile, over the @n pictures listed in the pass. */
static void run_chunk(const struct pass *pass, uint32_t n, uint32_t first, uint32_t count,
                      float *acc, size_t row_stride, size_t stride)
{
    const struct ls_accumulate_terms terms = {.halfs = pass->halfs,
                                              .weights = pass->packed,
                                              .n = n,
                                              .n_sums = pass->job->n_sums,
                                              .room = pass->room};
    if (n > 0)
        pass->report->not_finite +=
            pass->kernels->sum(&terms, first, count, acc, row_stride, stride);
    else
        for (uint32_t q = 0; q < terms.n_sums; q++)
            for (uint32_t j = 0; j < count; j += ROW)
                memset(acc + q * stride + j / ROW * row_stride, 0,
                       sizeof *acc * (count - j < ROW ? count - j : ROW));
}

static void choose_skips(const struct pass *pass, const struct tile *tile)
{
    const struct ls_accumulate_job *job = pass->job;
    for (uint32_t i = 0; i < job->n_pictures; i++)
        pass->left_out->reach[i] = fabs((double)job->tile_max[tile->index * job->n_pictures + i]);
    ls_left_out_choose(pass->left_out, job->max_error);
    pass->report->bound = pass->left_out->bound;
}

/* Nothing but zeros in any picture that counts. */
static bool is_empty(const struct pass *pass, const struct tile *tile)
{
    const float *most = pass->job->tile_max;
    for (uint32_t u = 0; most && u < pass->n_used; u++)
        if (most[tile->index * pass->job->n_pictures + pass->used[u]] != 0)
            return false;
    return most != NULL;
}

/* Which pictures count in this tile; how many. */
static uint32_t list_pictures(struct pass *pass, const struct tile *tile)
{
    uint32_t n = 0;
    bool empty = is_empty(pass, tile);
    if (pass->left_out)
        choose_skips(pass, tile);
    for (uint32_t u = 0; u < pass->n_used && !empty; u++) {
        uint32_t i = pass->used[u];
        const void *halfs = pass->job->pictures[i].tiles[tile->index];
        if (!halfs || (pass->left_out && pass->left_out->skip[i]))
            continue;
        pass->halfs[n] = halfs;
        pass->w[n++] = pass->weights + (size_t)i * pass->job->n_sums;
    }
    ls_accumulate_pack(pass->w, n, pass->job->n_sums, pass->packed);
    pass->report->tiles_read += n;
    pass->report->tiles_skipped += pass->job->n_pictures - n;
    return n;
}

static void run_tile(struct pass *pass, const struct tile *tile)
{
    uint32_t n = list_pictures(pass, tile), pixels = tile->width * tile->height;
    if (tile->width == ROW) {
        run_chunk(pass, n, 0, pixels, pass->sums + tile->y * pass->row_stride + tile->x,
                  pass->row_stride, pass->sum_stride);
        return;
    }
    for (uint32_t first = 0; first < pixels; first += CHUNK) {
        uint32_t count = pixels - first < CHUNK ? pixels - first : CHUNK;
        run_chunk(pass, n, first, count, pass->acc, ROW, CHUNK);
        hand_over(pass, tile, first, count);
    }
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
    uint64_t width = ls_region_width_px(field, r), height = ls_region_height_px(field, r);
    uint64_t row = job->row_stride ? job->row_stride : width, sum = row * (height - 1) + width;
    if (row < width || (job->sum_stride && job->sum_stride < sum))
        return ls_fail(diag, LS_ERR_INVALID,
                       "relight: rows %zu and sums %zu apart: expected at least the %llu x %llu "
                       "pixels of the region",
                       job->row_stride, job->sum_stride, (unsigned long long)width,
                       (unsigned long long)height);
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
    const struct ls_accumulate_job *job = pass->job;
    struct ls_left_out left_out;
    if (ls_left_out_init(&left_out, job->weights, job->n_pictures, job->n_sums))
        return ls_fail(diag, LS_ERR_NOMEM, "relight: out of memory");
    pass->left_out = &left_out;
    run_tiles(pass);
    ls_left_out_finish(&left_out);
    return LS_OK;
}

/* Weights by picture, and who has any. */
static void prepare(struct pass *pass)
{
    const struct ls_accumulate_job *job = pass->job;
    for (uint32_t i = 0; i < job->n_pictures; i++) {
        bool any = false;
        for (uint32_t q = 0; q < job->n_sums; q++) {
            float w = weight(job, q, i);
            pass->weights[(size_t)i * job->n_sums + q] = w;
            any |= w != 0;
        }
        if (any)
            pass->used[pass->n_used++] = i;
    }
}

enum ls_err ls_accumulate_with(const struct ls_accumulate_kernels *kernels,
                               const struct ls_field *field, const struct ls_accumulate_job *job,
                               const struct ls_tile_region *region, float *sums,
                               struct ls_accumulate_report *report, struct ls_diag *diag)
{
    struct ls_accumulate_report unused;
    enum ls_err err = check(field, job, region, diag);
    if (err)
        return err;
    struct pass pass = {.kernels = kernels,
                        .field = field,
                        .job = job,
                        .region = region,
                        .width = ls_region_width_px(field, region),
                        .height = ls_region_height_px(field, region),
                        .row_stride = job->row_stride,
                        .sum_stride = job->sum_stride,
                        .sums = sums,
                        .report = report ? report : &unused};
    if (!pass.row_stride)
        pass.row_stride = pass.width;
    if (!pass.sum_stride)
        pass.sum_stride = pass.row_stride * pass.height;
    size_t n = job->n_pictures;
    LS_CLEANUP_FREE float *weights = malloc((n * job->n_sums + 1) * sizeof *weights);
    LS_CLEANUP_FREE float *packed =
        malloc(ls_accumulate_padded(job->n_pictures) * job->n_sums * sizeof *packed + 1);
    LS_CLEANUP_FREE float *acc = malloc(CHUNK * job->n_sums * sizeof *acc);
    LS_CLEANUP_FREE void *room = malloc(ls_accumulate_room(job->n_pictures, job->n_sums) + 1);
    LS_CLEANUP_FREE uint32_t *used = malloc((n + 1) * sizeof *used);
    LS_CLEANUP_FREE const void **halfs = malloc((n + 1) * sizeof *halfs);
    LS_CLEANUP_FREE const float **w = malloc((n + 1) * sizeof *w);
    if (!weights || !packed || !acc || !room || !used || !halfs || !w)
        return ls_fail(diag, LS_ERR_NOMEM, "relight: out of memory");
    pass.weights = weights;
    pass.packed = packed;
    pass.acc = acc;
    pass.room = room;
    pass.used = used;
    pass.halfs = halfs;
    pass.w = w;
    *pass.report = (struct ls_accumulate_report){0};
    prepare(&pass);
    if (job->max_error > 0)
        return run_with_skips(&pass, diag);
    run_tiles(&pass);
    return LS_OK;
}

enum ls_err ls_accumulate(const struct ls_field *field, const struct ls_accumulate_job *job,
                          const struct ls_tile_region *region, float *sums,
                          struct ls_accumulate_report *report, struct ls_diag *diag)
{
    return ls_accumulate_with(ls_accumulate_kernels(ls_cpu_isa()), field, job, region, sums, report,
                              diag);
}
