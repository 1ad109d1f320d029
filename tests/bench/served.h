/*
 * served: a take as the daemon serves it, relit by the daemon's own code.
 * Layer: tests. Threads: one; a relight starts more. Ownership: bench_served_destroy; the take
 * outlives it.
 */
#ifndef LS_TESTS_BENCH_SERVED_H
#define LS_TESTS_BENCH_SERVED_H

#include "tests/bench/take.h"

struct bench_served;

/** Full spheres of every spectrum are pictures of the take's too, so that Eq. 1 has ratios; they
 * are made here. Ends the program where they cannot be. (transfer full). */
struct bench_served *bench_served_create(struct bench_take *take);

/** The ratio of a spectrum, [height][width][3]; NULL for white. (transfer none). */
const float *bench_served_ratio(struct bench_served *served, uint32_t s);

/** A task for bench_time: a relit picture, all spectra, shared weights, as the answer to a Relight
 * is made: opened, band after band into memory of its own, freed. */
struct bench_relit {
    struct bench_served *served;
    unsigned n_threads;
    const double *weights; /* [n_spectra][n_lights] */
    float *out;            /* [height][width][3]: bands are copied there; NULL: dropped */
};

void bench_relit(void *relit);

/** NULL is allowed. */
void bench_served_destroy(struct bench_served *served);

#endif
