/*
 * references: what this machine can do at best, to hold a kernel against.
 * Layer: tests. Threads: run by the caller's. Ownership: the buffers are the caller's.
 */
#ifndef LS_TESTS_BENCH_REFERENCES_H
#define LS_TESTS_BENCH_REFERENCES_H

#include "tests/bench/bench.h"

#include <stdint.h>

/** Bytes to copy or to read, in n_threads parts. */
struct reference_bytes {
    void *to; /* copy only */
    const void *from;
    size_t bytes; /* of @from */
    unsigned n_threads;
    uint64_t sum; /* of what was read, so that it is read */
};

/** Tasks for bench_time. A copy moves 2 x bytes: what is read and what is written. */
void reference_copy(void *bytes);
void reference_read(void *bytes);

/** Fused multiply-adds that stay in registers, with the widest instructions of one set. */
struct reference_fma {
    enum ls_isa isa;
    unsigned n_threads;
    uint64_t n;    /* steps, at least */
    uint64_t done; /* multiply-adds of all threads together (one = one lane) */
    double sum;
};

void reference_fma(void *fma);

/** One instance per set: runs @steps, returns how many multiply-adds that were. */
uint64_t reference_fma_c(uint64_t steps, double *sum);
uint64_t reference_fma_avx2(uint64_t steps, double *sum);
uint64_t reference_fma_avx512(uint64_t steps, double *sum);

#endif
