#include "tests/bench/references_lanes.h"

uint64_t reference_fma_avx2(uint64_t steps, double *sum)
{
    return fma_chains(steps, sum);
}
