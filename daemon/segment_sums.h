/*
 * segment_sums: what spectra are fitted on, summed over the lights, rolling down the picture.
 * Layer: daemon, for linear_maps.c. Threads: one owner; makes sums with a crew. Ownership: owns the
 * sums; job and pictures are the caller's and outlive it.
 *
 * Of each target t and segment g: V of each set of inputs, under the strengths of t, one sum or one
 * for each camera colour; F; and, for a
 * blend, U of all lights times phi. Mosaics. Each tile row of the field is read once for all.
 */
#ifndef LS_DAEMON_SEGMENT_SUMS_H
#define LS_DAEMON_SEGMENT_SUMS_H

#include "core/demosaic.h"
#include "daemon/linear_maps.h"

#include <stddef.h>
#include <stdint.h>

struct ls_segment_sums {
    const struct ls_linear_job *job;
    uint32_t first, n;                /* targets */
    struct ls_demosaic_region window; /* what the sums hold; whole rows */
    uint32_t tile_row;                /* the next to be read */
    size_t plane;                     /* floats from sum to sum */
    float *sums;
};

/** Bytes that the sums of one target take. */
size_t ls_segment_sums_bytes(const struct ls_linear_job *job);

/** For targets [first, first + n), holding nothing. ls_segment_sums_finish also after an error.
 * LS_ERR_NOMEM. */
LS_MUST_CHECK enum ls_err ls_segment_sums_init(struct ls_segment_sums *sums,
                                               const struct ls_linear_job *job, uint32_t first,
                                               uint32_t n, struct ls_diag *diag);

/** Forget the rows above @y and read the next tile row; at most LS_SEGMENT_SUMS_KEEP rows may be
 * kept. Errors: those of ls_accumulate and ls_crew_run, LS_ERR_NOMEM. */
LS_MUST_CHECK enum ls_err ls_segment_sums_advance(struct ls_segment_sums *sums, uint32_t y,
                                                  struct ls_diag *diag);

enum { LS_SEGMENT_SUMS_KEEP = 2 * (LS_LINEAR_HALO_PX + LS_DEMOSAIC_HALO) };

/** Over the window; @t counts from `first`. (transfer none), until the next advance. */
const float *ls_segment_sums_v(const struct ls_segment_sums *sums, uint32_t t, uint32_t set,
                               uint32_t g, uint32_t colour);
const float *ls_segment_sums_f(const struct ls_segment_sums *sums, uint32_t t, uint32_t g);
const float *ls_segment_sums_u(const struct ls_segment_sums *sums, uint32_t t, uint32_t g);

/** Weights of V of a segment, or with UINT32_MAX of all lights, under the strengths of
 * @target, those in camera colour @colour, or -1: @w of the lights, [n_lights], and @row over the
 * pictures of set @set. Errors: those of ls_light_set_row. */
LS_MUST_CHECK enum ls_err ls_segment_row(const struct ls_linear_job *job,
                                         const struct ls_linear_target *target, uint32_t set,
                                         uint32_t segment, int32_t colour, double *w, float *row,
                                         struct ls_diag *diag);

/** Zeroed is allowed. */
void ls_segment_sums_finish(struct ls_segment_sums *sums);

#endif
