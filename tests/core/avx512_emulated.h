/*
 * avx512_emulated: the AVX-512 instructions that core's kernels name, lane by lane in C, so that
 * the kernels' text runs on any processor with AVX2, FMA and F16C. It is included before everything
 * else (-include); what the compiler makes of the real instructions is not tested with it.
 * Layer: tests. Threads: any. Ownership: nothing to own.
 *
 * Each is what the Intel 64 and IA-32 Architectures Software Developer's Manual, volume 2, says of
 * the instruction. To use one more in a kernel, add it here.
 */
#ifndef LS_TESTS_CORE_AVX512_EMULATED_H
#define LS_TESTS_CORE_AVX512_EMULATED_H

/* Wide vectors pass between functions of one file alone (on the command line: the notes, too). */
#pragma GCC diagnostic ignored "-Wpsabi"

#include <immintrin.h>
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#if defined(__AVX512F__)
#error "compile without AVX-512"
#endif

/* What the kernels ask for; <immintrin.h> above has not seen them. */
#define __AVX512F__ 1
#define __AVX512BW__ 1
#define __AVX512DQ__ 1
#define __AVX512VL__ 1

/* Called, not inlined: kernels are inlined many times over, and the compiler has enough to do. */
#define EMULATED static __attribute__((noinline, unused))

typedef uint8_t emulated_u8 __attribute__((vector_size(16)));
typedef uint16_t emulated_u16 __attribute__((vector_size(32)));
typedef int32_t emulated_i32 __attribute__((vector_size(64)));

/* Lanes that are off are neither read nor written, whatever lies there. */

EMULATED __m512 emulated_maskz_load(__mmask16 mask, const float *p)
{
    __m512 v = {0};
    for (int k = 0; k < 16; k++)
        if (mask >> k & 1)
            v[k] = p[k];
    return v;
}

EMULATED void emulated_mask_store(float *p, __mmask16 mask, __m512 v)
{
    for (int k = 0; k < 16; k++)
        if (mask >> k & 1)
            p[k] = v[k];
}

EMULATED __m256i emulated_maskz_load_words(__mmask16 mask, const void *p)
{
    uint16_t v[16] = {0};
    for (int k = 0; k < 16; k++)
        if (mask >> k & 1)
            memcpy(v + k, (const char *)p + 2 * k, 2);
    return _mm256_loadu_si256((const __m256i *)v);
}

EMULATED void emulated_mask_store_words(void *p, __mmask16 mask, __m256i words)
{
    uint16_t v[16];
    _mm256_storeu_si256((__m256i *)v, words);
    for (int k = 0; k < 16; k++)
        if (mask >> k & 1)
            memcpy((char *)p + 2 * k, v + k, 2);
}

EMULATED __m512 emulated_load(const void *p)
{
    __m512 v;
    memcpy(&v, p, sizeof v);
    return v;
}

EMULATED void emulated_store(void *p, __m512 v)
{
    memcpy(p, &v, sizeof v);
}

EMULATED __m512 emulated_all(float value)
{
    return value - (__m512){0};
}

EMULATED __m512 emulated_zero(void)
{
    return (__m512){0};
}

EMULATED __m512 emulated_add(__m512 a, __m512 b)
{
    return a + b;
}

EMULATED __m512 emulated_subtract(__m512 a, __m512 b)
{
    return a - b;
}

/* Rounded once. */
EMULATED __m512 emulated_fma(__m512 a, __m512 b, __m512 c)
{
    for (int k = 0; k < 16; k++)
        c[k] = fmaf(a[k], b[k], c[k]);
    return c;
}

/* The second operand where one is NaN, or both are zero. */
EMULATED __m512 emulated_max(__m512 a, __m512 b)
{
    for (int k = 0; k < 16; k++)
        b[k] = a[k] > b[k] ? a[k] : b[k];
    return b;
}

EMULATED __m512 emulated_min(__m512 a, __m512 b)
{
    for (int k = 0; k < 16; k++)
        b[k] = a[k] < b[k] ? a[k] : b[k];
    return b;
}

EMULATED __m512 emulated_root(__m512 a)
{
    for (int k = 0; k < 16; k++)
        a[k] = sqrtf(a[k]);
    return a;
}

/* Which lanes hold a NaN: the one comparison that is emulated. */
EMULATED __mmask16 emulated_CMP_UNORD_Q(__m512 a, __m512 b)
{
    unsigned mask = 0;
    for (int k = 0; k < 16; k++)
        mask |= (unsigned)(isnan(a[k]) || isnan(b[k])) << k;
    return (__mmask16)mask;
}

EMULATED __mmask16 emulated_test(__m512i a, __m512i b)
{
    int32_t both[16];
    unsigned mask = 0;
    __m512i v = a & b;
    memcpy(both, &v, sizeof both);
    for (int k = 0; k < 16; k++)
        mask |= (unsigned)(both[k] != 0) << k;
    return (__mmask16)mask;
}

EMULATED __m512 emulated_from_halves(__m256i halves)
{
    __m256 v[2] = {_mm256_cvtph_ps(_mm256_castsi256_si128(halves)),
                   _mm256_cvtph_ps(_mm256_extracti128_si256(halves, 1))};
    return emulated_load(v);
}

/* To nearest, ties to even: nothing else is emulated. */
EMULATED __m256i emulated_to_halves(__m512 a, int rounding)
{
    __m256 v[2];
    if (rounding & ~_MM_FROUND_NO_EXC)
        abort();
    emulated_store(v, a);
    return _mm256_set_m128i(_mm256_cvtps_ph(v[1], _MM_FROUND_TO_NEAREST_INT),
                            _mm256_cvtps_ph(v[0], _MM_FROUND_TO_NEAREST_INT));
}

EMULATED __m512i emulated_widen_bytes(__m128i bytes)
{
    return (__m512i) __builtin_convertvector((emulated_u8)bytes, emulated_i32);
}

EMULATED __m512i emulated_widen_words(__m256i words)
{
    return (__m512i) __builtin_convertvector((emulated_u16)words, emulated_i32);
}

EMULATED __m512 emulated_floats(__m512i a)
{
    return __builtin_convertvector((emulated_i32)a, __m512);
}

/* The lowest byte of each, not saturated. */
EMULATED __m128i emulated_low_bytes(__m512i a)
{
    return (__m128i) __builtin_convertvector((emulated_i32)a, emulated_u8);
}

/* Some of these are macros of the compiler's. */
#undef _mm512_cmp_ps_mask
#undef _mm512_cvtps_ph

#define _mm512_maskz_loadu_ps emulated_maskz_load
#define _mm512_mask_storeu_ps emulated_mask_store
#define _mm256_maskz_loadu_epi16 emulated_maskz_load_words
#define _mm256_mask_storeu_epi16 emulated_mask_store_words
#define _mm512_loadu_ps emulated_load
#define _mm512_storeu_ps emulated_store
#define _mm512_set1_ps emulated_all
#define _mm512_setzero_ps emulated_zero
#define _mm512_add_ps emulated_add
#define _mm512_sub_ps emulated_subtract
#define _mm512_fmadd_ps emulated_fma
#define _mm512_max_ps emulated_max
#define _mm512_min_ps emulated_min
#define _mm512_sqrt_ps emulated_root
#define _mm512_cmp_ps_mask(a, b, how) emulated##how(a, b)
#define _mm512_test_epi32_mask emulated_test
#define _mm512_cvtph_ps emulated_from_halves
#define _mm512_cvtps_ph emulated_to_halves
#define _mm512_cvtepu8_epi32 emulated_widen_bytes
#define _mm512_cvtepu16_epi32 emulated_widen_words
#define _mm512_cvtepi32_ps emulated_floats
#define _mm512_cvtepi32_epi8 emulated_low_bytes

#endif
