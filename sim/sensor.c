#include "sim/sensor.h"

#include <math.h>
#include <stdlib.h>

enum { BLOCK = 256 };

/* x with P(normal < x) = p, by bisection. */
static double quantile(double p)
{
    double lo = -9, hi = 9;
    for (int i = 0; i < 60; i++) {
        double mid = 0.5 * (lo + hi);
        if (0.5 * erfc(-mid * M_SQRT1_2) < p)
            lo = mid;
        else
            hi = mid;
    }
    return 0.5 * (lo + hi);
}

double sim_normal(uint64_t hash)
{
    return quantile(((double)(hash >> 11) + 0.5) * 0x1p-53);
}

static void fill_normal(float *table)
{
    double square = 0;
    for (int i = 0; i < SIM_NOISE_LEVELS; i++) {
        double x = quantile(0.5 + 0.5 * (i + 0.5) / SIM_NOISE_LEVELS);
        table[i] = (float)x;
        square += x * x;
    }
    for (int i = 0; i < SIM_NOISE_LEVELS; i++)
        table[i] *= (float)sqrt(SIM_NOISE_LEVELS / square);
}

/* Normal numbers of the pixels [first, first + n); first a multiple of 4. */
static void draw(const float *table, uint64_t key, uint64_t first, uint32_t n, float *out)
{
    for (uint32_t i = 0; i < n; i += 4) {
        uint64_t h = sim_hash(key + ((first + i) >> 2));
        for (int lane = 0; lane < 4; lane++, h >>= 16) {
            union {
                float f;
                uint32_t bits;
            } x = {table[h & (SIM_NOISE_LEVELS - 1)]};
            x.bits ^= (uint32_t)(h & 0x8000) << 16; /* a branch would be mispredicted */
            out[i + (uint32_t)lane] = x.f;
        }
    }
}

static void spread(struct sim_sensor *s, double prnu, double dark_e_s, uint64_t seed)
{
    uint64_t n = (uint64_t)s->width * s->height, key = sim_hash(seed ^ 0x50524e55);
    float block[BLOCK];
    for (uint64_t i = 0; i < n; i++) {
        if (i % BLOCK == 0)
            draw(s->normal, key, i, BLOCK, block);
        s->gain[i] = 1 + (float)prnu * block[i % BLOCK];
        s->dark_e_s[i] = (float)dark_e_s;
    }
}

static void heat(struct sim_sensor *s, uint64_t seed)
{
    for (uint32_t i = 0; i < s->n_hot; i++) {
        uint64_t h = sim_hash(seed ^ (0x484f54u + ((uint64_t)i << 24)));
        s->hot[i][0] = (uint32_t)(h >> 32) % s->width;
        s->hot[i][1] = (uint32_t)h % s->height;
        double leak = s->full_well_e * (2 + (double)(h >> 11 & 63)); /* full in 0.5 s to 15 ms */
        s->dark_e_s[(size_t)s->hot[i][1] * s->width + s->hot[i][0]] = (float)leak;
    }
}

enum ls_err sim_sensor_build(const struct sim_view_config *config, uint64_t seed,
                             struct sim_sensor *out, struct ls_diag *diag)
{
    size_t n = (size_t)config->width * config->height;
    *out = (struct sim_sensor){.width = config->width,
                               .height = config->height,
                               .full_well_e = config->full_well_e,
                               .read_noise_e = config->read_noise_e,
                               .black = config->black};
    out->n_hot = (uint32_t)lround(config->hot_per_mpixel * (double)n / 1e6);
    out->gain = calloc(n, sizeof *out->gain);
    out->dark_e_s = calloc(n, sizeof *out->dark_e_s);
    out->hot = calloc(out->n_hot + 1, sizeof *out->hot);
    if (!out->gain || !out->dark_e_s || !out->hot) {
        sim_sensor_finish(out);
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for a sensor of %u x %u", config->width,
                       config->height);
    }
    fill_normal(out->normal);
    spread(out, config->prnu, config->dark_current_e_s, seed);
    heat(out, seed);
    return LS_OK;
}

void sim_sensor_finish(struct sim_sensor *sensor)
{
    free(sensor->gain);
    free(sensor->dark_e_s);
    free(sensor->hot);
    sensor->gain = sensor->dark_e_s = NULL;
    sensor->hot = NULL;
}

uint64_t sim_sensor_key(uint64_t seed, uint32_t camera, uint64_t sequence)
{
    return sim_hash(sim_hash(seed ^ 0x534e4f49) + sim_hash(camera) + sequence);
}

double sim_sensor_black_dn(const struct sim_sensor *sensor, uint32_t max_dn)
{
    return floor(sensor->black * max_dn + 0.5);
}

static void read_block(const struct sim_sensor *s, const struct sim_readout *r, size_t at,
                       uint32_t n, const float *signal_e, const float *normal, uint16_t *dn)
{
    float to_dn = (float)(r->gain * r->max_dn / s->full_well_e), max = (float)r->max_dn;
    float black = (float)sim_sensor_black_dn(s, r->max_dn), t = (float)r->exposure_s;
    float read2 = (float)(s->read_noise_e * s->read_noise_e);
    const float *gain = s->gain + at, *dark = s->dark_e_s + at;
    for (uint32_t i = 0; i < n; i++) {
        float e = signal_e[i] * gain[i] + dark[i] * t;
        float x = black + (e + normal[i] * sqrtf(e + read2)) * to_dn + 0.5f;
        x = x < 0 ? 0 : x;
        dn[i] = (uint16_t)(x < max ? x : max);
    }
}

void sim_sensor_row(const struct sim_sensor *sensor, const struct sim_readout *readout, uint32_t x,
                    uint32_t y, uint32_t n, const float *signal_e, uint16_t *dn)
{
    float normal[BLOCK + 8];
    uint64_t first = (uint64_t)y * sensor->width + x;
    for (uint32_t done = 0; done < n; done += BLOCK) {
        uint32_t count = n - done < BLOCK ? n - done : BLOCK;
        uint64_t at = first + done, aligned = at & ~(uint64_t)3;
        draw(sensor->normal, readout->key, aligned, (uint32_t)(at - aligned) + count, normal);
        read_block(sensor, readout, at, count, signal_e + done, normal + (at - aligned), dn + done);
    }
}
