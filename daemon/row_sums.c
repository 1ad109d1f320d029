#include "daemon/row_sums.h"

#include <stdlib.h>
#include <string.h>

void ls_row_sums_init(struct ls_row_sums *rows, const struct ls_field *field,
                      const struct ls_accumulate_job *job, const struct ls_demosaic_region *region,
                      uint32_t halo)
{
    *rows = (struct ls_row_sums){.field = field, .job = *job};
    rows->tiles = ls_region_of_pixels(field, region->x, region->y, region->x + region->width,
                                      region->y + region->height, halo);
    rows->window =
        (struct ls_demosaic_region){rows->tiles.x0 * LS_TILE_SIDE, rows->tiles.y0 * LS_TILE_SIDE,
                                    ls_region_width_px(field, &rows->tiles), 0};
}

static void add_report(struct ls_row_sums *rows, const struct ls_accumulate_report *report)
{
    if (report->bound > rows->report.bound)
        rows->report.bound = report->bound;
    rows->report.tiles_read += report->tiles_read;
    rows->report.tiles_skipped += report->tiles_skipped;
    rows->report.not_finite += report->not_finite;
}

/* New sums: the rows of the old window from @keep_y on, then the fresh tile row. */
static enum ls_err append(struct ls_row_sums *rows, const float *fresh, uint32_t height,
                          uint32_t keep_y, struct ls_diag *diag)
{
    size_t width = rows->window.width, old = rows->window.height;
    size_t kept = rows->window.y + old - keep_y, skip = old - kept;
    float *grown = malloc(rows->job.n_sums * (kept + height) * width * sizeof(float));
    if (!grown)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for %u sums", rows->job.n_sums);
    for (uint32_t q = 0; q < rows->job.n_sums; q++) {
        float *to = grown + q * (kept + height) * width;
        if (kept > 0)
            memcpy(to, rows->sums + (q * old + skip) * width, kept * width * sizeof(float));
        memcpy(to + kept * width, fresh + q * height * width, height * width * sizeof(float));
    }
    free(rows->sums);
    rows->sums = grown;
    rows->window.y = keep_y;
    rows->window.height = (uint32_t)(kept + height);
    return LS_OK;
}

static enum ls_err read_tile_row(struct ls_row_sums *rows, uint32_t y0, struct ls_diag *diag)
{
    struct ls_tile_region tiles = rows->tiles;
    tiles.y1 = tiles.y0 + 1;
    uint32_t height = ls_region_height_px(rows->field, &tiles);
    uint32_t end = rows->window.y + rows->window.height;
    uint32_t keep = y0 < rows->window.y ? rows->window.y : y0 < end ? y0 : end;
    struct ls_accumulate_report report = {0};
    rows->tiles.y0++;
    LS_CLEANUP_FREE float *fresh =
        malloc((size_t)rows->job.n_sums * height * rows->window.width * sizeof(float));
    if (!fresh)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for %u sums", rows->job.n_sums);
    enum ls_err err = ls_accumulate(rows->field, &rows->job, &tiles, fresh, &report, diag);
    add_report(rows, &report);
    return err ? err : append(rows, fresh, height, keep, diag);
}

enum ls_err ls_row_sums_need(struct ls_row_sums *rows, uint32_t y0, uint32_t y1,
                             struct ls_diag *diag)
{
    enum ls_err err = LS_OK;
    while (!err && rows->window.y + rows->window.height < y1)
        err = read_tile_row(rows, y0, diag);
    return err;
}

const float *ls_row_sums_get(const struct ls_row_sums *rows, uint32_t q)
{
    return rows->sums + (size_t)q * rows->window.height * rows->window.width;
}

void ls_row_sums_finish(struct ls_row_sums *rows)
{
    free(rows->sums);
    rows->sums = NULL;
}
