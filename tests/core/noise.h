/*
 * noise: seeded random numbers for the statistical tests of core (splitmix64, Box-Muller).
 * Layer: tests. Threads: one per generator. Ownership: the caller's struct is all there is.
 */
#ifndef LS_TESTS_CORE_NOISE_H
#define LS_TESTS_CORE_NOISE_H

#include <math.h>
#include <stdint.h>

struct noise {
    uint64_t state;
    double spare;
    int has_spare;
};

static inline uint64_t noise_bits(struct noise *noise)
{
    uint64_t z = noise->state += 0x9e3779b97f4a7c15u;
    z = (z ^ z >> 30) * 0xbf58476d1ce4e5b9u;
    z = (z ^ z >> 27) * 0x94d049bb133111ebu;
    return z ^ z >> 31;
}

/* Uniform in (0, 1). */
static inline double noise_uniform(struct noise *noise)
{
    return ((double)(noise_bits(noise) >> 12) + 0.5) * 0x1p-52;
}

/* Mean 0, sigma 1. */
static inline double noise_normal(struct noise *noise)
{
    if (noise->has_spare) {
        noise->has_spare = 0;
        return noise->spare;
    }
    double r = sqrt(-2 * log(noise_uniform(noise))), phi = 2 * M_PI * noise_uniform(noise);
    noise->spare = r * sin(phi);
    noise->has_spare = 1;
    return r * cos(phi);
}

#endif
