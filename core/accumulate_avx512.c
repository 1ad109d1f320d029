#include <immintrin.h>
#include <stdint.h>

enum { LANES = 16, WIDE = 4, MIDDLE = 4, NARROW = 4 };

typedef __m512 vec;
#define vec_zero _mm512_setzero_ps
#define vec_load _mm512_loadu_ps
#define vec_store _mm512_storeu_ps
#define vec_set1 _mm512_set1_ps
#define vec_add _mm512_add_ps
#define vec_fma _mm512_fmadd_ps

/* there are registers to spare: the order of addresses is enough */
#define vec_order(v, w, p) __asm__("" : "+r"(w), "+r"(p))

/* x - x is 0, or NaN where x is not finite; NaN stays NaN in the sum */
static inline int vec_not_finite(const vec *x, uint32_t n)
{
    vec sum = _mm512_setzero_ps();
    for (uint32_t v = 0; v < n; v++)
        sum = _mm512_add_ps(sum, _mm512_sub_ps(x[v], x[v]));
    return _mm512_cmp_ps_mask(sum, sum, _CMP_UNORD_Q);
}

static inline vec vec_widen(const char *half)
{
    return _mm512_cvtph_ps(_mm256_loadu_si256((const __m256i *)half));
}

#include "core/accumulate_vector.inc"

const struct ls_accumulate_kernels ls_accumulate_kernels_avx512 = {sum};
