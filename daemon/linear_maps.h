/*
 * linear_maps: the matrices of one spectrum over a whole picture, fitted on its segments.
 * Layer: daemon. Threads: any. Ownership: all arrays are the caller's.
 *
 * Streams pictures in bands of rows through core/linear.h, or core/mono_blend.h where one value was
 * photographed per light. The band is made as high as about 100 MB allow (at least 16 rows); the
 * result does not depend on it.
 */
#ifndef LS_DAEMON_LINEAR_MAPS_H
#define LS_DAEMON_LINEAR_MAPS_H

#include "core/error.h"
#include "core/linear.h"
#include "daemon/field_source.h"

#include <stdint.h>

struct ls_linear_job {
    const struct ls_field *field;
    uint32_t s; /* whose strengths and p */
    uint32_t n_segments;
    const struct ls_picture *f; /* [n_segments] */
    const double *factor;       /* [n_segments], picture to sum of E */
    const uint32_t *segment;    /* [n_lights] */
    uint32_t n_sets;
    const struct ls_light_set *set[LS_LINEAR_MAX_INPUTS]; /* white first */
    double p_in[LS_LINEAR_MAX_INPUTS];                    /* [n_sets][n_channels] */
    const double *phi; /* [n_lights][n_segments]: a blend, of one set of a mono camera; NULL = a
                          matrix */
    float *map;        /* matrix: [height][width][n_channels][n_sets x n_channels]; blend:
                          [height][width][n_segments] */
};

/** Fill job->map; add to @error the segments left out one by one, every fourth pixel of every
 * fourth row (matrices of at least two segments; else left alone). Errors: those of core/linear.h
 * and ls_accumulate, LS_ERR_NOMEM. */
LS_MUST_CHECK enum ls_err ls_linear_maps_make(const struct ls_linear_job *job,
                                              struct ls_linear_error *error, struct ls_diag *diag);

#endif
