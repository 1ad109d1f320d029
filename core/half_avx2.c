#include "core/half.h"
#include "core/half_kernels.h"

#include <immintrin.h>

static void from_floats(const float *in, uint16_t *out, size_t n)
{
    size_t i = 0;
    for (; i + 8 <= n; i += 8)
        _mm_storeu_si128((__m128i *)(out + i),
                         _mm256_cvtps_ph(_mm256_loadu_ps(in + i), _MM_FROUND_TO_NEAREST_INT));
    for (; i < n; i++)
        out[i] = ls_half_from_float(in[i]);
}

static void widen(const uint16_t in[8], float out[8])
{
    _mm256_storeu_ps(out, _mm256_cvtph_ps(_mm_loadu_si128((const __m128i *)in)));
}

static void to_floats(const uint16_t *in, float *out, size_t n)
{
    size_t i = 0;
    for (; i + 8 <= n; i += 8)
        widen(in + i, out + i);
    if (i < n && n >= 8) { /* the last ones, some of them once more */
        widen(in + n - 8, out + n - 8);
        return;
    }
    for (; i < n; i++)
        out[i] = ls_half_to_float(in[i]);
}

const struct ls_half_kernels ls_half_kernels_avx2 = {from_floats, to_floats};
