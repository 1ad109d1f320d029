/*
 * maps: domes and environment maps that the tests of both kinds of cells share.
 * Layer: tests. Threads: one. Ownership: a random map's texels are freed with g_free.
 */
#ifndef LS_TESTS_CORE_MAPS_H
#define LS_TESTS_CORE_MAPS_H

#include "core/environment.h"

#include <glib.h>
#include <math.h>

/** The zenith and rings of lights every 10 degrees down to @lowest_deg; every ring in a plane, as
 * degenerate as domes are built. Returns how many, at most 480. */
static inline size_t ring_dome(float (*d)[3], double lowest_deg)
{
    size_t n = 0;
    d[n][0] = d[n][2] = 0;
    d[n++][1] = 1;
    for (double t = 10; t <= lowest_deg; t += 10) {
        int around = MAX(6, (int)lround(36 * sin(t * M_PI / 180)));
        for (int k = 0; k < around; k++, n++) {
            double phi = 2 * M_PI * k / around;
            d[n][0] = (float)(sin(t * M_PI / 180) * sin(phi));
            d[n][1] = (float)cos(t * M_PI / 180);
            d[n][2] = (float)(-sin(t * M_PI / 180) * cos(phi));
        }
    }
    return n;
}

/** Sum of every @stride-th weight. */
static inline double total(const double *w, size_t n, size_t stride)
{
    double sum = 0;
    for (size_t i = 0; i < n; i++)
        sum += w[i * stride];
    return sum;
}

struct random_map {
    float *rgb;
    struct ls_map map;
    long double exact[3], size; /* its integral, and that of all magnitudes */
};

/** Noise, with negative values in the last channel. */
static inline struct random_map random_map(GRand *rand, uint32_t width, uint32_t height)
{
    struct random_map m = {.rgb = g_new(float, 3 * (size_t)width * height)};
    m.map = (struct ls_map){.rgb = m.rgb, .width = width, .height = height};
    for (uint32_t y = 0; y < height; y++)
        for (size_t k = 3 * (size_t)y * width; k < 3 * (size_t)(y + 1) * width; k++) {
            float v = (float)g_rand_double_range(rand, k % 3 == 2 ? -1 : 0, 1);
            long double sr =
                2 * M_PIl / width * (cosl(M_PIl * y / height) - cosl(M_PIl * (y + 1) / height));
            m.rgb[k] = v;
            m.exact[k % 3] += sr * v;
            m.size += sr * fabsf(v);
        }
    return m;
}

/** weights[n][3] add up to the map's integral, to 1e-9 of what was added up. */
static inline void assert_energy_kept(const double *weights, size_t n, const struct random_map *m)
{
    for (int c = 0; c < 3; c++)
        g_assert_cmpfloat_with_epsilon(total(weights + c, n, 3), (double)m->exact[c],
                                       1e-9 * (double)m->size);
}

#endif
