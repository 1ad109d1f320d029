/*
 * still_take: the simulated still life photographed in every way, as a take in memory.
 * Layer: tests. Threads: made by one (it starts two), read by any. Ownership: still_take_destroy.
 *
 * 346 lights through a Bayer mosaic, with the noise of tests/core/still_life.h: every light alone
 * under W R A G C B and under the polarised V and H, the full sphere of every spectrum, and 14
 * segments of R A G C B. Beside them what a picture relit from them should be: the noise-free truth
 * at every pixel in RGB, under a dim sky with a warm sun of 12 degrees.
 */
#ifndef LS_TESTS_BENCH_STILL_TAKE_H
#define LS_TESTS_BENCH_STILL_TAKE_H

#include "core/field.h"
#include "core/separated.h"
#include "tests/core/still_life.h"

enum {
    STILL_TAKE_SPECTRA = STILL_LIFE_SPECTRA,
    STILL_TAKE_V = STILL_TAKE_SPECTRA,
    STILL_TAKE_H,
    STILL_TAKE_CHANNELS,
    STILL_TAKE_SEGMENTS = 14,
    STILL_TAKE_THREADS = 2,
};

struct still_take {
    struct ls_field field; /* white, ungained; no spheres */
    struct ls_separated_field polarised;
    uint32_t side;
    size_t pixels;
    struct ls_picture *picture; /* [STILL_TAKE_CHANNELS][n_lights], halves */
    float *white;               /* [n_lights][tile][64 * 64], floats, before they became halves */
    float *tile_max;            /* [tile][n_lights] of the halves of white */
    float *sphere[STILL_TAKE_SPECTRA]; /* [side][side], F of core/promote.h */
    float *segment[STILL_TAKE_SPECTRA][STILL_TAKE_SEGMENTS];
    uint32_t segment_of[STILL_LIFE_LIGHTS];
    uint32_t segment_size[STILL_TAKE_SEGMENTS];
    double k[STILL_TAKE_CHANNELS][STILL_LIFE_LIGHTS], g[STILL_TAKE_CHANNELS][STILL_LIFE_LIGHTS];
    double p[STILL_TAKE_CHANNELS][STILL_LIFE_COLOURS];
    double omega_sr[STILL_LIFE_LIGHTS];
    float directions[STILL_LIFE_LIGHTS][3];
    struct ls_split split[STILL_LIFE_LIGHTS];
    double environment[STILL_TAKE_SPECTRA][STILL_LIFE_LIGHTS]; /* weights, radiance x sr */
    float *truth;                                              /* [side][side][3] */
    double white_level; /* what the chart's white patch reads in it, largest channel */
    /* where it lies */
    uint16_t *halves;
    const void **tiles;
};

/** @side: a multiple of LS_TILE_SIDE. Takes 6 KiB per pixel, 45 us per pixel on one core. Ends the
 * program where that cannot be had. */
struct still_take *still_take_create(uint32_t side);

/** NULL is allowed. */
void still_take_destroy(struct still_take *take);

#endif
