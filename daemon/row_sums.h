/*
 * row_sums: weighted sums of pictures, row after row down the picture, each tile row read once.
 * Layer: daemon. Threads: one at a time per object. Ownership: owns the sums; pictures and weights
 * are the caller's and outlive it.
 *
 * Whoever makes a picture in bands needs a few rows around each band. They are kept from one band
 * to the next, so the result is what one pass over the whole picture would give, to the bit, and
 * the memory is that of a band and one row of tiles.
 */
#ifndef LS_DAEMON_ROW_SUMS_H
#define LS_DAEMON_ROW_SUMS_H

#include "core/error.h"
#include "core/relight.h"

#include <stdint.h>

struct ls_row_sums {
    const struct ls_field *field;
    struct ls_accumulate_job job;
    struct ls_tile_region tiles;        /* columns; y0 is the next tile row to read */
    struct ls_demosaic_region window;   /* what the sums hold */
    float *sums;                        /* [job.n_sums][window.height][window.width] */
    struct ls_accumulate_report report; /* of all rows so far */
};

/** Sums of @job for the pixels of @region and @halo around them. Reads nothing yet. */
void ls_row_sums_init(struct ls_row_sums *rows, const struct ls_field *field,
                      const struct ls_accumulate_job *job, const struct ls_demosaic_region *region,
                      uint32_t halo);

/** Make the window hold rows [y0, y1) of the picture; what is above y0 is forgotten. Both only
 * grow. Errors: those of ls_accumulate, LS_ERR_NOMEM. */
LS_MUST_CHECK enum ls_err ls_row_sums_need(struct ls_row_sums *rows, uint32_t y0, uint32_t y1,
                                           struct ls_diag *diag);

/** Sum @q over the window. (transfer none), until the next need. */
const float *ls_row_sums_get(const struct ls_row_sums *rows, uint32_t q);

/** Zeroed is allowed. */
void ls_row_sums_finish(struct ls_row_sums *rows);

#endif
