/*
 * relight: whole pictures by several threads, from the mapped files of a take to RGB floats, with
 * the rows and the crew that the daemon relights with (core/relight_rows, daemon/row_sums).
 * Layer: tests. Threads: as many as asked; the picture does not depend on their number.
 * Ownership: all arrays are the caller's.
 */
#ifndef LS_TESTS_BENCH_RELIGHT_H
#define LS_TESTS_BENCH_RELIGHT_H

#include "core/accumulate_kernels.h"
#include "core/relight.h"

enum { BENCH_MAX_TERMS = 16 };

struct bench_relight {
    const struct ls_field *field;
    unsigned n_threads;
    uint32_t n_sums;
    const float *weights;  /* [n_sums][n_lights] */
    const float *tile_max; /* as ls_accumulate_job; may be NULL */
    double max_error;
    /* per sum, over the whole picture; NULL = white, or no matrix */
    const float *ratio[BENCH_MAX_TERMS], *matrix[BENCH_MAX_TERMS];
    float *out;           /* [height][width][3]; NULL: the sums alone, which are thrown away */
    double anonymous_mib; /* most seen while it ran */
    struct ls_accumulate_report report; /* of the last run */
};

/** A task for bench_time. */
void bench_relight(void *relight);

#endif
