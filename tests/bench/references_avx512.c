#include "tests/bench/references.h"

#include <immintrin.h>

enum { CHAINS = 16 };

uint64_t reference_fma_avx512(uint64_t steps, double *sum)
{
    const __m512 a = _mm512_set1_ps(0.999f), b = _mm512_set1_ps(1e-3f);
    __m512 chain[CHAINS];
    float lane[16];
    for (int k = 0; k < CHAINS; k++)
        chain[k] = _mm512_set1_ps((float)k);
    for (uint64_t i = 0; i < steps; i++)
#pragma GCC unroll 16
        for (int k = 0; k < CHAINS; k++)
            chain[k] = _mm512_fmadd_ps(chain[k], a, b);
    for (int k = 1; k < CHAINS; k++)
        chain[0] = _mm512_add_ps(chain[0], chain[k]);
    _mm512_storeu_ps(lane, chain[0]);
    *sum += (double)lane[0];
    return 16 * CHAINS * steps;
}
