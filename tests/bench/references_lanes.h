/*
 * references_lanes: the text of reference_fma; each instruction set includes it once and names its
 * instance.
 * Layer: tests. Threads: any. Ownership: none.
 */
#ifndef LS_TESTS_BENCH_REFERENCES_LANES_H
#define LS_TESTS_BENCH_REFERENCES_LANES_H

#include "core/lanes.h"
#include "tests/bench/references.h"

/* Chains that do not wait for each other, as many as there are registers for. */
enum { CHAINS = LANES == 16 ? 16 : 12 };

LANES_INLINE uint64_t fma_chains(uint64_t steps, double *sum)
{
    floats chain[CHAINS];
    for (int k = 0; k < CHAINS; k++)
        chain[k] = lanes_all((float)k);
    for (uint64_t i = 0; i < steps; i++)
#pragma GCC unroll 16
        for (int k = 0; k < CHAINS; k++)
            chain[k] = lanes_fma(chain[k], lanes_all(0.999f), lanes_all(1e-3f));
    for (int k = 1; k < CHAINS; k++)
        chain[0] += chain[k];
    *sum += (double)chain[0][0];
    return (uint64_t)LANES * CHAINS * steps;
}

#endif
