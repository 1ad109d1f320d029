/*
 * relight_rows: weighted sums of pictures, tile row after tile row down a picture, each read once.
 * Layer: core. Threads: the shares of a tile row may be summed at once by different threads; all
 * else by one at a time. Ownership: owns the sums; pictures and weights are the caller's and
 * outlive it.
 *
 * Whoever finishes a picture in bands needs a few rows around each band. They are kept from one
 * tile row to the next, so that the sums are what one pass over the whole picture gives, to the
 * bit, whatever the bands and shares, and the memory is that of a tile row and what is kept:
 *
 *     for (uint32_t y = region.y, end; y < region.y + region.height; y = end) {
 *         end = ls_relight_band_end(field, &region, y, halo);
 *         uint32_t top = y > halo ? y - halo : 0;
 *         uint32_t below = height - end > halo ? end + halo : height;   (of the picture)
 *         while (rows.window.y + rows.window.height < below) {
 *             ls_relight_rows_roll(&rows, top);
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
    struct ls_tile_region tiles;        /* columns; y0 is the next tile row to read */
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

/** Forget what lies above row @y0 of the picture and make room for the next tile row, of which
 * there is one. Errors: LS_ERR_NOMEM. */
LS_MUST_CHECK enum ls_err ls_relight_rows_roll(struct ls_relight_rows *rows, uint32_t y0,
                                               struct ls_diag *diag);

/** Sum part @share of @n_shares of the next tile row: columns of tiles, perhaps none. Once for each
 * share, in any order. *report: of this share. Errors: those of ls_accumulate. */
LS_MUST_CHECK enum ls_err ls_relight_rows_sum(const struct ls_relight_rows *rows, uint32_t share,
                                              uint32_t n_shares,
                                              struct ls_accumulate_report *report,
                                              struct ls_diag *diag);

/** All @n shares are summed: the window holds the tile row. */
void ls_relight_rows_add(struct ls_relight_rows *rows, const struct ls_accumulate_report *report,
                         uint32_t n);

/** Sum @q over the window. (transfer none), until the next roll. RT-safe. */
const float *ls_relight_rows_get(const struct ls_relight_rows *rows, uint32_t q);

/** End of the band of @region that begins at row @y: it and its @halo end with a row of tiles, so
 * that no tile row is read before its time. RT-safe. */
uint32_t ls_relight_band_end(const struct ls_field *field, const struct ls_demosaic_region *region,
                             uint32_t y, uint32_t halo);

/** Zeroed is allowed. */
void ls_relight_rows_finish(struct ls_relight_rows *rows);

#endif
