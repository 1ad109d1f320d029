/*
 * lanes: as many pixels at a time as one vector register of the instruction set compiled for holds.
 * Layer: core, inside kernels only: every instruction set's library compiles the same kernel text
 * against its own LANES. Threads: any. Ownership: none.
 *
 * Arithmetic on `floats` and `ints` is the compilers' own (+ - * / < are per lane, masks are all
 * ones or all zeros); here is what they do not spell: loads that widen, stores that narrow, blends,
 * and the colours woven together. Lanes never mix, nothing is fused but by lanes_fma and nothing
 * approximated, so every instruction set gives the same bits.
 */
#ifndef LS_CORE_LANES_H
#define LS_CORE_LANES_H

#include "core/half.h"

#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <string.h>

#if defined(__AVX512F__) && defined(__AVX512BW__) && defined(__AVX512VL__)
#include <immintrin.h>
#define LANES 16
#elif defined(__AVX2__) && defined(__F16C__)
#include <immintrin.h>
#define LANES 8
#else
#define LANES 4
#endif

#define LANES_INLINE static inline __attribute__((always_inline, unused))

#if defined(__clang__)
#define LANES_UNROLL _Pragma("unroll")
#else
#define LANES_UNROLL _Pragma("GCC unroll 8")
#endif

typedef float floats __attribute__((vector_size(LANES * 4)));
typedef int32_t ints __attribute__((vector_size(LANES * 4)));
typedef uint16_t halves __attribute__((vector_size(LANES * 2)));

LANES_INLINE floats lanes_all(float value)
{
    return value - (floats){0};
}

LANES_INLINE floats lanes_load(const float *p)
{
    floats v;
    memcpy(&v, p, sizeof v);
    return v;
}

LANES_INLINE void lanes_store(float *p, floats v)
{
    memcpy(p, &v, sizeof v);
}

LANES_INLINE void lanes_store_half(uint16_t *p, halves v)
{
    memcpy(p, &v, sizeof v);
}

/* a where the mask is set, else 0. */
LANES_INLINE floats lanes_keep(ints mask, floats a)
{
    return (floats)((ints)a & mask);
}

/* a where the mask is not set, else 0. */
LANES_INLINE floats lanes_drop(ints mask, floats a)
{
    return (floats)((ints)a & ~mask);
}

/* a where the mask is set, else b. */
LANES_INLINE floats lanes_select(ints mask, floats a, floats b)
{
#if LANES == 8
    return (floats)_mm256_blendv_ps((__m256)b, (__m256)a, (__m256)mask);
#else
    return (floats)(((ints)a & mask) | ((ints)b & ~mask));
#endif
}

LANES_INLINE floats lanes_magnitude(floats a)
{
    return (floats)((ints)a & 0x7fffffff);
}

#if LANES == 16

LANES_INLINE floats lanes_load_u8(const uint8_t *p)
{
    return (floats)_mm512_cvtepi32_ps(_mm512_cvtepu8_epi32(_mm_loadu_si128((const __m128i *)p)));
}

LANES_INLINE floats lanes_load_u16(const void *p)
{
    return (floats)_mm512_cvtepi32_ps(
        _mm512_cvtepu16_epi32(_mm256_loadu_si256((const __m256i *)p)));
}

/* a b + c, rounded once; of the instruction sets that have it. */
LANES_INLINE floats lanes_fma(floats a, floats b, floats c)
{
    return (floats)_mm512_fmadd_ps((__m512)a, (__m512)b, (__m512)c);
}

LANES_INLINE halves lanes_max_half(halves a, halves b)
{
    return (halves)_mm256_max_epu16((__m256i)a, (__m256i)b);
}

LANES_INLINE floats lanes_load_half(const uint16_t *p)
{
    return (floats)_mm512_cvtph_ps(_mm256_loadu_si256((const __m256i *)p));
}

LANES_INLINE floats lanes_from_half(halves v)
{
    return (floats)_mm512_cvtph_ps((__m256i)v);
}

LANES_INLINE halves lanes_to_half(floats v)
{
    return (halves)_mm512_cvtps_ph((__m512)v, _MM_FROUND_TO_NEAREST_INT | _MM_FROUND_NO_EXC);
}

LANES_INLINE void lanes_store_u8(uint8_t *p, ints v)
{
    _mm_storeu_si128((__m128i *)p, _mm512_cvtepi32_epi8((__m512i)v));
}

LANES_INLINE bool lanes_are_all_set(ints mask)
{
    return _mm512_test_epi32_mask((__m512i)mask, (__m512i)mask) == 0xffff;
}

/* max(a, 0) of numbers. */
LANES_INLINE floats lanes_positive(floats a)
{
    return (floats)_mm512_max_ps((__m512)a, _mm512_setzero_ps());
}

/* Into the range of half; NaN stays. */
LANES_INLINE floats lanes_clamp_half(floats a)
{
    __m512 low = _mm512_min_ps(_mm512_set1_ps(LS_HALF_MAX), (__m512)a);
    return (floats)_mm512_max_ps(_mm512_set1_ps(-LS_HALF_MAX), low);
}

/* Column 3 i mod 16 of a woven triple belongs to pixel i of its colour: one permutation per colour
 * puts every value in its column, and three blends pick who owns which. */
#define WEAVE_OF(a, k)                                                                        \
    __builtin_shufflevector(                                                                  \
        a, a, (16 - k) * 11 % 16, (17 - k) * 11 % 16, (18 - k) * 11 % 16, (19 - k) * 11 % 16, \
        (20 - k) * 11 % 16, (21 - k) * 11 % 16, (22 - k) * 11 % 16, (23 - k) * 11 % 16,       \
        (24 - k) * 11 % 16, (25 - k) * 11 % 16, (26 - k) * 11 % 16, (27 - k) * 11 % 16,       \
        (28 - k) * 11 % 16, (29 - k) * 11 % 16, (30 - k) * 11 % 16, (31 - k) * 11 % 16)
/* Columns 0, 3, 6 .. of a, 1, 4 .. of b, 2, 5 .. of c. */
#define WEAVE_PICK(a, b, c)                                                                        \
    __builtin_shufflevector(                                                                       \
        __builtin_shufflevector(a, b, 0, 17, 2, 3, 20, 5, 6, 23, 8, 9, 26, 11, 12, 29, 14, 15), c, \
        0, 1, 18, 3, 4, 21, 6, 7, 24, 9, 10, 27, 12, 13, 30, 15)

#elif LANES == 8

LANES_INLINE floats lanes_load_u8(const uint8_t *p)
{
    return (floats)_mm256_cvtepi32_ps(_mm256_cvtepu8_epi32(_mm_loadl_epi64((const __m128i *)p)));
}

LANES_INLINE floats lanes_load_u16(const void *p)
{
    return (floats)_mm256_cvtepi32_ps(_mm256_cvtepu16_epi32(_mm_loadu_si128((const __m128i *)p)));
}

LANES_INLINE floats lanes_fma(floats a, floats b, floats c)
{
    return (floats)_mm256_fmadd_ps((__m256)a, (__m256)b, (__m256)c);
}

LANES_INLINE halves lanes_max_half(halves a, halves b)
{
    return (halves)_mm_max_epu16((__m128i)a, (__m128i)b);
}

LANES_INLINE floats lanes_load_half(const uint16_t *p)
{
    return (floats)_mm256_cvtph_ps(_mm_loadu_si128((const __m128i *)p));
}

LANES_INLINE floats lanes_from_half(halves v)
{
    return (floats)_mm256_cvtph_ps((__m128i)v);
}

LANES_INLINE halves lanes_to_half(floats v)
{
    return (halves)_mm256_cvtps_ph((__m256)v, _MM_FROUND_TO_NEAREST_INT);
}

LANES_INLINE void lanes_store_u8(uint8_t *p, ints v)
{
    __m128i low = _mm256_castsi256_si128((__m256i)v);
    __m128i words = _mm_packs_epi32(low, _mm256_extracti128_si256((__m256i)v, 1));
    _mm_storel_epi64((__m128i *)p, _mm_packus_epi16(words, words));
}

LANES_INLINE bool lanes_are_all_set(ints mask)
{
    return _mm256_movemask_ps((__m256)mask) == 0xff;
}

LANES_INLINE floats lanes_positive(floats a)
{
    return (floats)_mm256_max_ps((__m256)a, _mm256_setzero_ps());
}

LANES_INLINE floats lanes_clamp_half(floats a)
{
    __m256 low = _mm256_min_ps(_mm256_set1_ps(LS_HALF_MAX), (__m256)a);
    return (floats)_mm256_max_ps(_mm256_set1_ps(-LS_HALF_MAX), low);
}

#define WEAVE_OF(a, k)                                                                \
    __builtin_shufflevector(a, a, (8 - k) * 3 % 8, (9 - k) * 3 % 8, (10 - k) * 3 % 8, \
                            (11 - k) * 3 % 8, (12 - k) * 3 % 8, (13 - k) * 3 % 8,     \
                            (14 - k) * 3 % 8, (15 - k) * 3 % 8)
#define WEAVE_PICK(a, b, c)                                                                       \
    __builtin_shufflevector(__builtin_shufflevector(a, b, 0, 9, 2, 3, 12, 5, 6, 15), c, 0, 1, 10, \
                            3, 4, 13, 6, 7)

#else

LANES_INLINE floats lanes_load_u8(const uint8_t *p)
{
    return (floats){p[0], p[1], p[2], p[3]};
}

LANES_INLINE floats lanes_load_u16(const void *p)
{
    uint16_t v[LANES];
    memcpy(v, p, sizeof v);
    return (floats){v[0], v[1], v[2], v[3]};
}

LANES_INLINE floats lanes_fma(floats a, floats b, floats c)
{
    return (floats){fmaf(a[0], b[0], c[0]), fmaf(a[1], b[1], c[1]), fmaf(a[2], b[2], c[2]),
                    fmaf(a[3], b[3], c[3])};
}

LANES_INLINE halves lanes_max_half(halves a, halves b)
{
    halves greater = (halves)(a > b);
    return (a & greater) | (b & ~greater);
}

LANES_INLINE floats lanes_load_half(const uint16_t *p)
{
    return (floats){ls_half_to_float(p[0]), ls_half_to_float(p[1]), ls_half_to_float(p[2]),
                    ls_half_to_float(p[3])};
}

LANES_INLINE floats lanes_from_half(halves v)
{
    return (floats){ls_half_to_float(v[0]), ls_half_to_float(v[1]), ls_half_to_float(v[2]),
                    ls_half_to_float(v[3])};
}

LANES_INLINE halves lanes_to_half(floats v)
{
    return (halves){ls_half_from_float(v[0]), ls_half_from_float(v[1]), ls_half_from_float(v[2]),
                    ls_half_from_float(v[3])};
}

LANES_INLINE void lanes_store_u8(uint8_t *p, ints v)
{
    for (int k = 0; k < LANES; k++)
        p[k] = (uint8_t)v[k];
}

LANES_INLINE bool lanes_are_all_set(ints mask)
{
    return mask[0] & mask[1] & mask[2] & mask[3];
}

LANES_INLINE floats lanes_positive(floats a)
{
    return lanes_keep(a > 0, a);
}

LANES_INLINE floats lanes_clamp_half(floats a)
{
    a = lanes_select(a > LS_HALF_MAX, lanes_all(LS_HALF_MAX), a);
    return lanes_select(a < -LS_HALF_MAX, lanes_all(-LS_HALF_MAX), a);
}

#define WEAVE_OF(a, k)                                                               \
    __builtin_shufflevector(a, a, (4 - k) * 3 % 4, (5 - k) * 3 % 4, (6 - k) * 3 % 4, \
                            (7 - k) * 3 % 4)
#define WEAVE_PICK(a, b, c) \
    __builtin_shufflevector(__builtin_shufflevector(a, b, 0, 5, 2, 3), c, 0, 1, 6, 3)

#endif

/* Vector j of r0 g0 b0 r1 g1 b1 ..: columns j LANES .. Owner of column 0 of vector j: j LANES mod
 * 3, and LANES mod 3 is 1 or 2. */
#if LANES % 3 == 1
#define WEAVE(r, g, b, first, second, third) \
    first = WEAVE_PICK(r, g, b), second = WEAVE_PICK(g, b, r), third = WEAVE_PICK(b, r, g)
#else
#define WEAVE(r, g, b, first, second, third) \
    first = WEAVE_PICK(r, g, b), second = WEAVE_PICK(b, r, g), third = WEAVE_PICK(g, b, r)
#endif

/* 3 LANES floats r0 g0 b0 r1 .. */
LANES_INLINE void lanes_weave(floats r, floats g, floats b, floats woven[3])
{
    floats red = WEAVE_OF(r, 0), green = WEAVE_OF(g, 1), blue = WEAVE_OF(b, 2);
    WEAVE(red, green, blue, woven[0], woven[1], woven[2]);
}

LANES_INLINE void lanes_store_woven(float *p, floats r, floats g, floats b)
{
    floats a[3];
    lanes_weave(r, g, b, a);
    for (int k = 0; k < 3; k++) /* each from its register */
        memcpy(p + k * LANES, &a[k], sizeof a[k]);
}

/* 3 LANES halves r0 g0 b0 r1 .. */
LANES_INLINE void lanes_weave_half(halves r, halves g, halves b, halves woven[3])
{
    halves red = WEAVE_OF(r, 0), green = WEAVE_OF(g, 1), blue = WEAVE_OF(b, 2);
    WEAVE(red, green, blue, woven[0], woven[1], woven[2]);
}

LANES_INLINE void lanes_store_woven_half(uint16_t *p, halves r, halves g, halves b)
{
    halves a[3];
    lanes_weave_half(r, g, b, a);
    for (int k = 0; k < 3; k++)
        memcpy(p + k * LANES, &a[k], sizeof a[k]);
}

#endif
