/*
 * draw: numbers that look random and are the same in every run.
 * Layer: sim. Threads: any. Ownership: none.
 */
#ifndef LS_SIM_DRAW_H
#define LS_SIM_DRAW_H

#include <stdint.h>

/** The @n-th of @seed, in [0, 1): splitmix64 of a counter. */
static inline double sim_draw(uint64_t seed, uint64_t n)
{
    uint64_t z = seed + n * 0x9e3779b97f4a7c15u;
    z = (z ^ z >> 30) * 0xbf58476d1ce4e5b9u;
    z = (z ^ z >> 27) * 0x94d049bb133111ebu;
    z ^= z >> 31;
    return (double)(z >> 11) * 0x1p-53;
}

#endif
