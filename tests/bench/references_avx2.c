#include "tests/bench/references.h"

#include <immintrin.h>

enum { CHAINS = 12 };

uint64_t reference_fma_avx2(uint64_t steps, double *sum)
{
    const __m256 a = _mm256_set1_ps(0.999f), b = _mm256_set1_ps(1e-3f);
    __m256 chain[CHAINS];
    float lane[8];
    for (int k = 0; k < CHAINS; k++)
        chain[k] = _mm256_set1_ps((float)k);
    for (uint64_t i = 0; i < steps; i++)
#pragma GCC unroll 12
        for (int k = 0; k < CHAINS; k++)
            chain[k] = _mm256_fmadd_ps(chain[k], a, b);
    for (int k = 1; k < CHAINS; k++)
        chain[0] = _mm256_add_ps(chain[0], chain[k]);
    _mm256_storeu_ps(lane, chain[0]);
    *sum += (double)lane[0];
    return 8 * CHAINS * steps;
}
