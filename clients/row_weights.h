/*
 * row_weights: how much each reading of the chart counts in the solve of the LEDs' strengths.
 * Layer: clients. Threads: the main thread. Ownership: owns its values; see finish.
 *
 * JSON: [one number per patch of the calibration's chart], or [[one per camera channel] per patch];
 * a reading of weight w counts w^2 times, 0 leaves it out. After M the channels are those of the
 * picture.
 */
#ifndef LS_CLIENTS_ROW_WEIGHTS_H
#define LS_CLIENTS_ROW_WEIGHTS_H

#include "core/error.h"

#include <stddef.h>

struct ls_row_weights {
    size_t n_patches,
        n_channels; /* channels: 1 where a patch has one number for all; 0 patches: none */
    double *values; /* [n_patches][n_channels], finite, >= 0 */
};

/** Errors: LS_ERR_INVALID (no JSON, another shape, a value that is no weight, all 0),
 * LS_ERR_NOT_FOUND, LS_ERR_LIMIT, LS_ERR_NOMEM, each with the file's name. @out: zeroed. */
LS_MUST_CHECK enum ls_err ls_row_weights_read(const char *path, struct ls_row_weights *out,
                                              struct ls_diag *diag);

/** For a chart's rows [patch][channel]: *rows is (transfer full), NULL where there are none.
 * LS_ERR_INVALID: for another chart. */
LS_MUST_CHECK enum ls_err ls_row_weights_for(const struct ls_row_weights *weights, size_t n_patches,
                                             size_t n_channels, double **rows,
                                             struct ls_diag *diag);

/** Zeroed is allowed. */
void ls_row_weights_finish(struct ls_row_weights *weights);

#endif
