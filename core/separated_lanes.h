/*
 * separated_lanes: the text of the separated kernels; each instruction set includes it once and
 * names its instance. See separated_kernels.h for the contract.
 * Layer: core, inside the kernels only. Threads: any. Ownership: none.
 */
#ifndef LS_CORE_SEPARATED_LANES_H
#define LS_CORE_SEPARATED_LANES_H

#include "core/lanes.h"
#include "core/separated_kernels.h"

enum { ROWS_AT_ONCE = 6, VECTORS_AT_ONCE = LS_SEPARATED_PAD / LANES };

#if LANES == 16
LANES_INLINE floats lanes_fma(floats a, floats b, floats c)
{
    return (floats)_mm512_fmadd_ps((__m512)a, (__m512)b, (__m512)c);
}

LANES_INLINE floats lanes_root(floats a)
{
    return (floats)_mm512_sqrt_ps((__m512)a);
}
#else
LANES_INLINE floats lanes_fma(floats a, floats b, floats c)
{
    return (floats)_mm256_fmadd_ps((__m256)a, (__m256)b, (__m256)c);
}

LANES_INLINE floats lanes_root(floats a)
{
    return (floats)_mm256_sqrt_ps((__m256)a);
}
#endif

LANES_INLINE floats lanes_larger(floats a, floats b)
{
    return lanes_select(a > b, a, b);
}

LANES_INLINE unsigned widen_vector(const void *halfs, float *out)
{
    uint16_t bits[LANES];
    memcpy(bits, halfs, sizeof bits);
    floats v = lanes_load_half(bits);
    ints finite = lanes_magnitude(v) < lanes_all(__builtin_inff());
    lanes_store(out, lanes_keep(finite, v));
    unsigned found = 0;
    for (int k = 0; !lanes_are_all_set(finite) && k < LANES; k++)
        found += finite[k] == 0;
    return found;
}

static unsigned widen(const void *halfs, size_t n, float *out)
{
    const char *from = halfs;
    unsigned not_finite = 0;
    size_t j = 0;
    for (; j + LANES <= n; j += LANES)
        not_finite += widen_vector(from + 2 * j, out + j);
    if (j < n) {
        uint16_t rest[LANES] = {0};
        float wide[LANES];
        memcpy(rest, from + 2 * j, 2 * (n - j));
        not_finite += widen_vector(rest, wide);
        memcpy(out + j, wide, sizeof *wide * (n - j));
    }
    return not_finite;
}

static void split(const struct ls_separated_terms *terms, const float *v, const float *h, size_t n,
                  float *d, float *s, float *variance)
{
    floats d_v = lanes_all(terms->split.d_v), d_h = lanes_all(terms->split.d_h);
    floats s_v = lanes_all(terms->split.s_v), s_h = lanes_all(terms->split.s_h);
    floats constant = lanes_all(terms->variance);
    floats shot_v = lanes_all(terms->shot_v), shot_h = lanes_all(terms->shot_h);
    for (size_t j = 0; j < n; j += LANES) {
        floats x = lanes_load(v + j), y = lanes_load(h + j);
        lanes_store(d + j, d_v * x + d_h * y);
        lanes_store(s + j, s_v * x + s_h * y);
        lanes_store(variance + j,
                    (constant + shot_v * lanes_positive(x)) + shot_h * lanes_positive(y));
    }
}

static void sigma(const float *row, const float *next, size_t n, float scale, float *out)
{
    for (size_t j = 0; j < n; j += LANES) {
        floats here = lanes_larger(lanes_load(row + j), lanes_load(next + j));
        floats right = lanes_larger(lanes_load(row + j + 1), lanes_load(next + j + 1));
        lanes_store(out + j, scale * lanes_root(lanes_larger(here, right)));
    }
}

/* As departure and gate of conductor.c. */
LANES_INLINE floats departure(floats r, floats c, float t)
{
    floats x = lanes_magnitude(c - r), y = t * lanes_magnitude(c), one = lanes_all(1);
    return lanes_select(x < y, x / lanes_select(y > 0, y, one), one);
}

LANES_INLINE floats gate(floats m, floats noise)
{
    floats x = m - LS_CONDUCTOR_SIGMA_FROM * noise, one = lanes_all(1);
    floats y = (LS_CONDUCTOR_SIGMA_FULL - LS_CONDUCTOR_SIGMA_FROM) * noise;
    floats q = lanes_select(x < y, x / lanes_select(y > 0, y, one), one);
    q = lanes_keep(x > 0, q);
    return q * q * (3 - 2 * q);
}

static void conductor(const struct ls_conductor *o, float *const s[3], const float *sigmas,
                      size_t n)
{
    for (size_t j = 0; j < n; j += LANES) {
        floats part[3], scaled[3];
        for (int c = 0; c < 3; c++) {
            part[c] = lanes_load(s[c] + j);
            scaled[c] = part[c] * o->scale[c];
        }
        floats m = lanes_magnitude(scaled[0]);
        m = lanes_larger(lanes_magnitude(scaled[1]), m);
        m = lanes_larger(lanes_magnitude(scaled[2]), m);
        floats sum = departure(scaled[0], scaled[1], o->threshold_a) +
                     departure(scaled[0], scaled[2], o->threshold_b);
        floats share = gate(m, lanes_load(sigmas + j)) * (0.5f * sum);
        for (int c = 0; c < 3; c++)
            lanes_store(s[c] + j, share * part[c]);
    }
}

/* @n_rows rows from @q on, LS_SEPARATED_PAD pixels; @n_rows is a constant wherever this is called.
 */
LANES_INLINE void add_block(const struct ls_separated_add *a, uint32_t q, uint32_t n_rows, size_t j)
{
    floats part[ROWS_AT_ONCE][VECTORS_AT_ONCE];
    LANES_UNROLL for (uint32_t b = 0; b < n_rows; b++)
        LANES_UNROLL for (int v = 0; v < VECTORS_AT_ONCE; v++) part[b][v] = (floats){0};
    for (uint32_t k = 0; k < a->n_lights; k++) {
        floats x[VECTORS_AT_ONCE];
        LANES_UNROLL for (int v = 0; v < VECTORS_AT_ONCE; v++) x[v] =
            lanes_load(a->values + k * a->stride + j + (size_t)v * LANES);
        LANES_UNROLL for (uint32_t b = 0; b < n_rows; b++)
        {
            floats w = lanes_all(a->w[q + b][k]);
            LANES_UNROLL for (int v = 0; v < VECTORS_AT_ONCE; v++) part[b][v] =
                lanes_fma(w, x[v], part[b][v]);
        }
    }
    LANES_UNROLL for (uint32_t b = 0; b < n_rows; b++)
    {
        float *sum = a->sum + (q + b) * a->sum_stride + j;
        LANES_UNROLL for (int v = 0; v < VECTORS_AT_ONCE; v++)
            lanes_store(sum + v * LANES, lanes_load(sum + v * LANES) + part[b][v]);
    }
}

static void add(const struct ls_separated_add *a)
{
    for (size_t j = 0; j < a->n; j += LS_SEPARATED_PAD) {
        uint32_t q = 0;
        for (; q + ROWS_AT_ONCE <= a->n_rows; q += ROWS_AT_ONCE)
            add_block(a, q, ROWS_AT_ONCE, j);
        for (; q + 3 <= a->n_rows; q += 3)
            add_block(a, q, 3, j);
        for (; q < a->n_rows; q++)
            add_block(a, q, 1, j);
    }
}

#endif
