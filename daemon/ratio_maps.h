/*
 * ratio_maps: the stable ratios F/V of a whole picture, several in one pass over the pictures.
 * Layer: daemon. Threads: any. Ownership: all arrays are the caller's.
 *
 * LeGendre, Yu and Debevec, Eq. 1 and 2, as core/promote.h does it. Works in bands of rows, so that
 * the memory beside the maps themselves stays near 250 rows of every ratio; the result does not
 * depend on the bands.
 */
#ifndef LS_DAEMON_RATIO_MAPS_H
#define LS_DAEMON_RATIO_MAPS_H

#include "core/error.h"
#include "core/field.h"
#include "daemon/job.h"

#include <stdbool.h>
#include <stdint.h>

/** Ratio q = sum_j f_rows[q][j] f[j] / sum_j v_rows[q][j] v[j]; with @coloured, of camera colour c
 * that of v_rows[3 q + c], both demosaiced, and sigma that of the first: factors of some percent
 * are nothing to a noise. */
struct ls_ratio_job {
    uint32_t n, n_v, n_f;
    const struct ls_picture *v, *f; /* [n_v], [n_f] */
    const float *v_rows, *f_rows;   /* [n][n_v], [n][n_f] */
    bool coloured;                  /* v_rows is [3 n][n_v] */
    bool squares; /* v_rows is twice as long: behind the weights stand their squares, whose sum is
                     the light that V has its shot noise of; without them it is V */
    const double (*neutral)[3]; /* [n], p(s,c) / p(0,c) */
    float **maps;               /* [n] -> [height][width][n_channels] */
    const struct ls_job *asker; /* no more bands once it is cancelled; or NULL */
};

/** Errors: LS_ERR_ABORTED, LS_ERR_NOMEM, those of core/promote.h and ls_accumulate. */
LS_MUST_CHECK enum ls_err ls_ratio_maps_make(const struct ls_field *field,
                                             const struct ls_ratio_job *job, struct ls_diag *diag);

#endif
