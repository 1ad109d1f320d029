/*
 * relight: whole pictures by several threads, from the mapped files of a take to RGB floats.
 * Layer: tests. Threads: as many as asked; the picture does not depend on their number.
 * Ownership: all arrays are the caller's.
 *
 * Each thread takes a share of the rows of tiles and sums one row of tiles at a time into a window
 * that keeps the last rows of the one before; what is complete is finished at once. The rows at the
 * seam of two threads are finished when both are done.
 */
#ifndef LS_TESTS_BENCH_RELIGHT_H
#define LS_TESTS_BENCH_RELIGHT_H

#include "core/accumulate_kernels.h"
#include "core/relight.h"

enum { BENCH_MAX_TERMS = 16, BENCH_RELIGHT_THREADS = 8 };

struct bench_relight {
    const struct ls_field *field;
    const struct ls_accumulate_kernels *kernels;
    unsigned n_threads;
    uint32_t n_sums;
    const float *weights;  /* [n_sums][n_lights] */
    const float *tile_max; /* as ls_accumulate_job; may be NULL */
    double max_error;
    /* per sum, over the whole picture; NULL = white, or no matrix */
    const float *ratio[BENCH_MAX_TERMS], *matrix[BENCH_MAX_TERMS];
    float *out;           /* [height][width][3]; NULL: the sums alone, which are thrown away */
    double anonymous_mib; /* most seen while it ran */
    struct ls_accumulate_report report[BENCH_RELIGHT_THREADS]; /* of the last run */
    float *window[BENCH_RELIGHT_THREADS], *seam[BENCH_RELIGHT_THREADS];
};

/** Room for the windows and seams; once the rest is filled in. A thread needs a row of tiles. */
void bench_relight_init(struct bench_relight *relight);
void bench_relight_finish(struct bench_relight *relight);

/** What was left out of the last run, and how many pairs of picture and tile were read. */
struct ls_accumulate_report bench_relight_report(const struct bench_relight *relight);

/** A task for bench_time. */
void bench_relight(void *relight);

#endif
