/*
 * linear_maps: the matrices of spectra over a whole picture, fitted on their segments.
 * Layer: daemon. Threads: any; makes its own. Ownership: all arrays are the caller's.
 *
 * Streams pictures in bands of a tile row through core/linear.h, or core/mono_blend.h where one
 * value was photographed per light. Sums over the lights, the great part of the reading, are made
 * of all spectra in one pass, as far as 112 MiB of sums allow; then each band is fitted in
 * rectangles. Neither maps nor errors depend on the number of threads, nor maps on the rectangles.
 */
#ifndef LS_DAEMON_LINEAR_MAPS_H
#define LS_DAEMON_LINEAR_MAPS_H

#include "core/error.h"
#include "core/linear.h"
#include "daemon/crew.h"
#include "daemon/field_source.h"

#include <stdint.h>

enum {
    LS_LINEAR_MAX_CHECKS = 16,
    LS_LINEAR_ERROR_STEP = 5, /* odd: every colour of a mosaic is met */
};

/** One spectrum whose map is made. */
struct ls_linear_target {
    uint32_t s;                 /* whose strengths and p */
    const double *colour;       /* factors on k of its lights, [n_lights][3]; NULL: all are 1 */
    const struct ls_picture *f; /* [n_segments] */
    const double *factor;       /* [n_segments], picture to sum of E */
    float *map;                 /* matrix: [height][width][n_channels][n_sets x n_channels]; blend:
                                   [height][width][n_segments] */
    /* lights also photographed alone in s, which the map is held against */
    const struct ls_light_set *photographed;
    uint32_t n_checks, checks[LS_LINEAR_MAX_CHECKS];
    /* filled: */
    struct ls_linear_error left_out; /* every LS_LINEAR_ERROR_STEP-th pixel and row of the picture;
                                        at least three segments */
    struct ls_linear_error checked, highlights; /* ls_linear_check_light, every pixel */
};

struct ls_linear_job {
    const struct ls_field *field;
    uint32_t n_segments;
    uint32_t n_rows; /* sums that make a V: 1, or 3 where lights of an input or a target differ in
                        colour: each colour of the camera with its own k of the input and g of the
                        target. Exact where the inputs' differ; where the target's do, what a matrix
                        has off its diagonal goes by strengths of the input's colour, not of the
                        output's */
    const uint32_t *segment; /* [n_lights] */
    uint32_t n_sets;
    const struct ls_light_set *set[LS_LINEAR_MAX_INPUTS]; /* white first */
    double p_in[LS_LINEAR_MAX_INPUTS];                    /* [n_sets][n_channels] */
    const double *phi;    /* [n_lights][n_segments]: a blend, of one set of a mono camera; NULL = a
                             matrix */
    const double *others; /* beside phi: ls_mono_blend_others */
    uint32_t n_targets;
    struct ls_linear_target *targets;
    struct ls_crew crew;
};

/** Fill the targets. Errors: those of core/linear.h, ls_accumulate and ls_crew_run,
 * LS_ERR_NOMEM. */
LS_MUST_CHECK enum ls_err ls_linear_maps_make(const struct ls_linear_job *job,
                                              struct ls_diag *diag);

#endif
