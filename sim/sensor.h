/*
 * sensor: from light to digital numbers: black, photon, dark and read noise, unequal and hot
 * pixels, saturation, quantisation.
 * Layer: sim. Threads: built on one, then read only. Ownership: finish frees.
 *
 *   e  = signal * prnu + dark * t           electrons, mean
 *   x  = black + (e + n sqrt(e + read^2)) * gain * max_dn / full_well
 *   DN = x rounded to the nearest integer, clamped to [0, max_dn]
 *
 * n is a standard normal number looked up by a hash of (key, pixel): 8192 levels, unit variance,
 * none beyond 3.9. Photon noise is taken as normal, which read noise of several electrons allows.
 */
#ifndef LS_SIM_SENSOR_H
#define LS_SIM_SENSOR_H

#include "core/error.h"
#include "sim/scene.h"

#include <stdint.h>

enum { SIM_NOISE_LEVELS = 4096 };

struct sim_sensor {
    uint32_t width, height;
    double full_well_e, read_noise_e, black;
    float *gain;     /* [pixel] relative, mean 1 */
    float *dark_e_s; /* [pixel] */
    uint32_t n_hot;
    uint32_t (*hot)[2];
    float normal[SIM_NOISE_LEVELS]; /* magnitudes */
};

LS_MUST_CHECK enum ls_err sim_sensor_build(const struct sim_view_config *config, uint64_t seed,
                                           struct sim_sensor *out, struct ls_diag *diag);
void sim_sensor_finish(struct sim_sensor *sensor);

/** The number that makes an exposure's noise its own. */
uint64_t sim_sensor_key(uint64_t seed, uint32_t camera, uint64_t sequence);

/** Black level in whole DN of a format whose largest value is @max_dn. */
double sim_sensor_black_dn(const struct sim_sensor *sensor, uint32_t max_dn);

/** How a row is read out. */
struct sim_readout {
    uint64_t key;
    double exposure_s;
    double gain; /* analogue, 1 = unity */
    uint32_t max_dn;
};

/** Read @n <= width pixels from (x, y) on; @signal_e: mean photo-electrons of a perfect pixel. */
void sim_sensor_row(const struct sim_sensor *sensor, const struct sim_readout *readout, uint32_t x,
                    uint32_t y, uint32_t n, const float *signal_e, uint16_t *dn);

/** A well mixed 64-bit hash of @x (the finaliser of SplitMix64, Steele, Lea and Flood 2014). */
static inline uint64_t sim_hash(uint64_t x)
{
    x += 0x9e3779b97f4a7c15u;
    x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9u;
    x = (x ^ (x >> 27)) * 0x94d049bb133111ebu;
    return x ^ (x >> 31);
}

/** A standard normal number from a hash, by inversion; for what is drawn once. */
double sim_normal(uint64_t hash);

#endif
