#include <immintrin.h>
#include <stdint.h>

enum { LANES = 8, WIDE = 8, MIDDLE = 4, NARROW = 2 };

typedef __m256 vec;
#define vec_zero _mm256_setzero_ps
#define vec_load _mm256_loadu_ps
#define vec_store _mm256_storeu_ps
#define vec_set1 _mm256_set1_ps
#define vec_add _mm256_add_ps
#define vec_order(v, w, p) __asm__("" : "+x"(v), "+r"(w), "+r"(p))
#define vec_fma _mm256_fmadd_ps

/* x - x is 0, or NaN where x is not finite; NaN stays NaN in the sum */
static inline int vec_not_finite(const vec *x, uint32_t n)
{
    vec sum = _mm256_setzero_ps();
    for (uint32_t v = 0; v < n; v++)
        sum = _mm256_add_ps(sum, _mm256_sub_ps(x[v], x[v]));
    return _mm256_movemask_ps(_mm256_cmp_ps(sum, sum, _CMP_UNORD_Q));
}

static inline vec vec_widen(const char *half)
{
    return _mm256_cvtph_ps(_mm_loadu_si128((const __m128i *)half));
}

#include "core/accumulate_vector.inc"

const struct ls_accumulate_kernels ls_accumulate_kernels_avx2 = {sum};
