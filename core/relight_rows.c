#include "core/relight_rows.h"

#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>

enum { LARGE_PAGE = 2 << 20, USUALLY_KEPT = 2 * LS_DEMOSAIC_HALO };

void ls_relight_rows_init(struct ls_relight_rows *rows, const struct ls_field *field,
                          const struct ls_accumulate_job *job,
                          const struct ls_demosaic_region *region, uint32_t halo)
{
    *rows = (struct ls_relight_rows){.field = field, .job = *job};
    rows->tiles = ls_region_of_pixels(field, region->x, region->y, region->x + region->width,
                                      region->y + region->height, halo);
    rows->window =
        (struct ls_demosaic_region){rows->tiles.x0 * LS_TILE_SIDE, rows->tiles.y0 * LS_TILE_SIDE,
                                    ls_region_width_px(field, &rows->tiles), 0};
}

static uint32_t window_end(const struct ls_relight_rows *rows)
{
    return rows->window.y + rows->window.height;
}

static size_t sum_stride(const struct ls_relight_rows *rows)
{
    return (size_t)rows->capacity * rows->window.width;
}

/* Rows [y0, end of the window) of every sum to the front of @to, whose sums lie @stride apart. */
static void keep(const struct ls_relight_rows *rows, uint32_t y0, float *to, size_t stride)
{
    size_t width = rows->window.width, kept = window_end(rows) - y0;
    for (uint32_t q = 0; q < rows->job.n_sums && kept > 0; q++)
        memmove(to + q * stride, rows->sums + q * sum_stride(rows) + (y0 - rows->window.y) * width,
                kept * width * sizeof *to);
}

/* Many sums are written side by side, each on a page of its own: with large pages the processor
 * knows where they all are. Where there are none it is as malloc. */
static float *allocate(size_t bytes)
{
    size_t rounded = (bytes + LARGE_PAGE - 1) / LARGE_PAGE * LARGE_PAGE;
    if (bytes < LARGE_PAGE)
        return malloc(bytes);
    float *sums = aligned_alloc(LARGE_PAGE, rounded);
    if (sums)
        (void)madvise(sums, rounded, MADV_HUGEPAGE);
    return sums;
}

static enum ls_err grow(struct ls_relight_rows *rows, uint32_t y0, uint32_t capacity,
                        struct ls_diag *diag)
{
    size_t stride = (size_t)capacity * rows->window.width;
    float *sums = allocate(rows->job.n_sums * stride * sizeof *sums);
    if (!sums)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for %u sums", rows->job.n_sums);
    keep(rows, y0, sums, stride);
    free(rows->sums);
    rows->sums = sums;
    rows->capacity = capacity;
    return LS_OK;
}

enum ls_err ls_relight_rows_roll(struct ls_relight_rows *rows, uint32_t y0, uint32_t below,
                                 struct ls_diag *diag)
{
    uint32_t end = window_end(rows), y1 = (below + LS_TILE_SIDE - 1) / LS_TILE_SIDE;
    y0 = y0 < rows->window.y ? rows->window.y : y0 < end ? y0 : end;
    enum ls_err err = LS_OK;
    uint32_t need = y1 * LS_TILE_SIDE - y0;
    if (need > rows->capacity)
        err = grow(rows, y0, need + USUALLY_KEPT, diag);
    else
        keep(rows, y0, rows->sums, sum_stride(rows));
    if (err)
        return err;
    rows->tiles.y1 = y1;
    rows->window.y = y0;
    rows->window.height = end - y0;
    return LS_OK;
}

enum ls_err ls_relight_rows_sum(const struct ls_relight_rows *rows, uint32_t share,
                                uint32_t n_shares, struct ls_accumulate_report *report,
                                struct ls_diag *diag)
{
    uint32_t columns = rows->tiles.x1 - rows->tiles.x0;
    struct ls_accumulate_job job = rows->job;
    struct ls_tile_region part = {
        .x0 = rows->tiles.x0 + (uint32_t)((uint64_t)columns * share / n_shares),
        .x1 = rows->tiles.x0 + (uint32_t)((uint64_t)columns * (share + 1) / n_shares),
        .y0 = rows->tiles.y0,
        .y1 = rows->tiles.y1};
    *report = (struct ls_accumulate_report){0};
    if (part.x0 == part.x1)
        return LS_OK;
    job.sum_stride = sum_stride(rows);
    job.row_stride = rows->window.width;
    float *sums = rows->sums + (size_t)rows->window.height * rows->window.width +
                  (size_t)(part.x0 - rows->tiles.x0) * LS_TILE_SIDE;
    return ls_accumulate(rows->field, &job, &part, sums, report, diag);
}

void ls_relight_rows_add(struct ls_relight_rows *rows, const struct ls_accumulate_report *report,
                         uint32_t n)
{
    rows->window.height += ls_region_height_px(rows->field, &rows->tiles);
    rows->tiles.y0 = rows->tiles.y1;
    for (uint32_t k = 0; k < n; k++) {
        if (report[k].bound > rows->report.bound)
            rows->report.bound = report[k].bound;
        rows->report.tiles_read += report[k].tiles_read;
        rows->report.tiles_skipped += report[k].tiles_skipped;
        rows->report.not_finite += report[k].not_finite;
    }
}

uint32_t ls_relight_tile_rows(uint32_t width, uint32_t n)
{
    enum { CACHE = 16 << 20, MOST = 8 };
    uint64_t row = (uint64_t)LS_TILE_SIDE * width * n * sizeof(float), rows = CACHE / (row + 1);
    return rows < 1 ? 1 : rows > MOST ? MOST : (uint32_t)rows;
}

uint32_t ls_relight_band_end(const struct ls_field *field, const struct ls_demosaic_region *region,
                             uint32_t y, uint32_t halo, uint32_t tile_rows)
{
    uint32_t last = region->y + region->height;
    uint64_t tiles = ((uint64_t)y + halo) / LS_TILE_SIDE + tile_rows, end = tiles * LS_TILE_SIDE;
    end = end < field->height ? end - halo : field->height;
    return end < last ? (uint32_t)end : last;
}

const float *ls_relight_rows_get(const struct ls_relight_rows *rows, uint32_t q)
{
    return rows->sums + q * sum_stride(rows);
}

void ls_relight_rows_finish(struct ls_relight_rows *rows)
{
    free(rows->sums);
    rows->sums = NULL;
}
