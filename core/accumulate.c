#include "core/relight.h"

#include "core/half.h"

#include <math.h>
#include <stdbool.h>
#include <string.h>

#if defined(__x86_64__)
#include <immintrin.h>
#endif

enum { GROUP = LS_ACCUMULATE_GROUP };

static float widen(const void *row, uint32_t j, unsigned *not_finite)
{
    uint16_t bits;
    memcpy(&bits, (const char *)row + 2 * (size_t)j, sizeof bits);
    if ((bits & 0x7c00) != 0x7c00)
        return ls_half_to_float(bits);
    ++*not_finite;
    return 0;
}

static unsigned column(const void *const halfs[GROUP], const float (*w)[GROUP], uint32_t n_sums,
                       uint32_t j, float *acc, size_t acc_stride)
{
    unsigned not_finite = 0;
    float v[GROUP];
    for (int i = 0; i < GROUP; i++)
        v[i] = widen(halfs[i], j, &not_finite);
    for (uint32_t q = 0; q < n_sums; q++) {
        float part = w[q][0] * v[0];
        for (int i = 1; i < GROUP; i++)
            part += w[q][i] * v[i];
        acc[q * acc_stride + j] += part;
    }
    return not_finite;
}

static unsigned rows_c(const void *const halfs[GROUP], const float (*w)[GROUP], uint32_t n_sums,
                       uint32_t count, float *acc, size_t acc_stride)
{
    unsigned not_finite = 0;
    for (uint32_t j = 0; j < count; j++)
        not_finite += column(halfs, w, n_sums, j, acc, acc_stride);
    return not_finite;
}

#if defined(__x86_64__)
__attribute__((target("avx2,f16c"))) static unsigned rows_f16c(const void *const halfs[GROUP],
                                                               const float (*w)[GROUP],
                                                               uint32_t n_sums, uint32_t count,
                                                               float *acc, size_t acc_stride)
{
    const __m256 infinity = _mm256_set1_ps(INFINITY), sign = _mm256_set1_ps(-0.0f);
    unsigned not_finite = 0;
    uint32_t j = 0;
    for (; j + 8 <= count; j += 8) {
        __m256 v[GROUP];
        for (int i = 0; i < GROUP; i++) {
            const __m128i *in = (const __m128i *)((const char *)halfs[i] + 2 * (size_t)j);
            v[i] = _mm256_cvtph_ps(_mm_loadu_si128(in));
            __m256 finite = _mm256_cmp_ps(_mm256_andnot_ps(sign, v[i]), infinity, _CMP_LT_OQ);
            v[i] = _mm256_and_ps(v[i], finite);
            not_finite += 8u - (unsigned)__builtin_popcount((unsigned)_mm256_movemask_ps(finite));
        }
        for (uint32_t q = 0; q < n_sums; q++) {
            float *out = acc + q * acc_stride + j;
            __m256 part = _mm256_mul_ps(_mm256_broadcast_ss(&w[q][0]), v[0]);
            for (int i = 1; i < GROUP; i++)
                part = _mm256_add_ps(part, _mm256_mul_ps(_mm256_broadcast_ss(&w[q][i]), v[i]));
            _mm256_storeu_ps(out, _mm256_add_ps(_mm256_loadu_ps(out), part));
        }
    }
    for (; j < count; j++)
        not_finite += column(halfs, w, n_sums, j, acc, acc_stride);
    return not_finite;
}

/* every processor with AVX2 has F16C, which clang 14 cannot ask for */
static bool has_f16c(void)
{
    return __builtin_cpu_supports("avx2");
}
#else
#define rows_f16c rows_c

static bool has_f16c(void)
{
    return false;
}
#endif

static const struct ls_accumulate_kernel kernel_c = {"c", rows_c};
static const struct ls_accumulate_kernel kernel_f16c = {"f16c", rows_f16c};

const struct ls_accumulate_kernel *ls_accumulate_kernel(const char *mask)
{
    bool masked = mask && strcmp(mask, kernel_f16c.name) == 0;
    return !masked && has_f16c() ? &kernel_f16c : &kernel_c;
}
