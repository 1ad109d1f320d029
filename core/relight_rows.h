/*
 * relight_rows: weighted sums of pictures, down the rows of their tiles, each read once.
 * Layer: core. Threads: the shares of some tile rows may be summed at once by different threads;
 * all else by one at a time. Ownership: owns the sums; pictures and weights are the caller's and
 * outlive it.
 *
 * Whoever finishes a picture in bands needs a few rows around each band. They are kept from one
 * tile row to the next, so that the sums are what one pass over the whole picture gives, to the
 * bit, whatever the bands and shares, and the memory is that of a band and what is kept:
 *
 *     for (uint32_t y = region.y, end; y < region.y + region.height; y = end) {
 *         end = ls_relight_band_end(field, &region, y, halo, tile_rows);
 *         uint32_t top = y > halo ? y - halo : 0;
 *         uint32_t below = height - end > halo ? end + halo : height;   (of the picture)
 *         if (rows.window.y + rows.window.height < below) {
 *             ls_relight_rows_roll(&rows, top, below);
 *             each share of n, by any thread: ls_relight_rows_sum(&rows, share, n, &report[share]);
 *             ls_relight_rows_add(&rows, report, n);
 *         }
 *         rows [y, end), by any threads: ls_relight_finish
 *     }
 */
#ifndef LS_CORE_RELIGHT_ROWS_H
#define LS_CORE_RELIGHT_ROWS_H

#include "core/relight.h"

struct ls_relight_rows {
    const struct ls_field *field;
    struct ls_accumulate_job job;
    struct ls_tile_region tiles;        /* columns, and rows [y0, y1) being read */
    struct ls_demosaic_region window;   /* what the sums hold */
    uint32_t capacity;                  /* rows there is room for, once there are sums */
    float *sums;                        /* [job.n_sums][capacity][window.width] */
    struct ls_accumulate_report report; /* of all rows so far */
};

/** Sums of @job for the pixels of @region and @halo around them. Reads and allocates nothing yet.
 * The job's strides are not looked at. */
void ls_relight_rows_init(struct ls_relight_rows *rows, const struct ls_field *field,
                          const struct ls_accumulate_job *job,
                          const struct ls_demosaic_region *region, uint32_t halo);

/** Forget what lies above row @y0 of the picture and make room for the tile rows down to row
 * @below of it, which are not all in the window yet. Errors: LS_ERR_NOMEM. */
LS_MUST_CHECK enum ls_err ls_relight_rows_roll(struct ls_relight_rows *rows, uint32_t y0,
                                               uint32_t below, struct ls_diag *diag);

/** Sum part @share of @n_shares of these tile rows: columns of tiles, perhaps none. Once for each
 * share, in any order. *report: of this share. Errors: those of ls_accumulate. */
LS_MUST_CHECK enum ls_err ls_relight_rows_sum(const struct ls_relight_rows *rows, uint32_t share,
                                              uint32_t n_shares,
                                              struct ls_accumulate_report *report,
                                              struct ls_diag *diag);

/** All @n shares are summed: the window holds the tile rows. */
void ls_relight_rows_add(struct ls_relight_rows *rows, const struct ls_accumulate_report *report,
                         uint32_t n);

/** Sum @q over the window. (transfer none), until the next roll. RT-safe. */
const float *ls_relight_rows_get(const struct ls_relight_rows *rows, uint32_t q);

/** Tile rows to take at a time where @n floats per pixel are kept of rows of @width pixels: as many
 * as stay in a processor's last cache, 1 to 8. Threads meet that much less often. RT-safe. */
uint32_t ls_relight_tile_rows(uint32_t width, uint32_t n);

/** End of the band of @region that begins at row @y: it and its @halo end with a row of tiles, the
 * last of @tile_rows, so that no tile row is read before its time. RT-safe. */
uint32_t ls_relight_band_end(const struct ls_field *field, const struct ls_demosaic_region *region,
                             uint32_t y, uint32_t halo, uint32_t tile_rows);

/** Zeroed is allowed. */
void ls_relight_rows_finish(struct ls_relight_rows *rows);

#endif
