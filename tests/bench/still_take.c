#include "tests/bench/still_take.h"

#include "core/half.h"
#include "core/polarisation.h"
#include "core/segments.h"
#include "sim/geometry.h"
#include "sim/truth.h"
#include "tests/bench/bench.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum {
    LIGHTS = STILL_LIFE_LIGHTS,
    SPECTRA = STILL_TAKE_SPECTRA,
    CHANNELS = STILL_TAKE_CHANNELS,
    SEGMENTS = STILL_TAKE_SEGMENTS,
    THREADS = STILL_TAKE_THREADS,
    TILE = LS_TILE_SIDE,
};

static void must(enum ls_err err, const struct ls_diag *diag)
{
    if (err) {
        fprintf(stderr, "still life: %s\n", diag->text);
        exit(1);
    }
}

/* ---- noise ---- */

static uint64_t mix(uint64_t x)
{
    x += 0x9e3779b97f4a7c15u; /* Steele, Lea and Flood's SplitMix64 */
    x = (x ^ x >> 30) * 0xbf58476d1ce4e5b9u;
    x = (x ^ x >> 27) * 0x94d049bb133111ebu;
    return x ^ x >> 31;
}

/* Mean 0, variance 1: the sum of four uniform numbers. */
static double deviate(uint64_t x)
{
    double sum = 0;
    for (int k = 0; k < 4; k++, x >>= 16)
        sum += (double)(x & 0xffff);
    return (sum / 65536 - 2 + 2.0 / 65536) * sqrt(3);
}

static float photographed(double x, double n_lights, uint64_t picture, size_t pixel)
{
    double variance = still_life_variance(x, still_life_rate(n_lights));
    return (float)(x + sqrt(variance) * deviate(mix(picture << 32 | pixel)));
}

/* ---- the environment ---- */

/* strengths of W R A G C B */
static const double sky[SPECTRA] = {0.15, 0, 0, 0.05, 0.2, 0.35};
static const double sun[SPECTRA] = {0.6, 0.2, 0.5, 0.05, 0, 0};

static void shine(struct still_take *take)
{
    const double at[3] = {-0.48, 0.64, 0.6}, width = 12 * M_PI / 180;
    double lobe[LIGHTS], all = 0;
    for (int i = 0; i < LIGHTS; i++) {
        double dot = 0;
        for (int a = 0; a < 3; a++)
            dot += at[a] * (double)take->directions[i][a];
        lobe[i] = exp((dot - 1) / (width * width));
        all += lobe[i];
    }
    for (int s = 0; s < SPECTRA; s++)
        for (int i = 0; i < LIGHTS; i++) {
            double up = 0.5 + 0.5 * (double)take->directions[i][1];
            take->environment[s][i] =
                0.1 * take->omega_sr[i] * up * sky[s] + lobe[i] / all * sun[s];
        }
}

/* ---- pictures ---- */

struct making {
    struct still_take *take;
    const struct sim_scene *scene;
    float *sphere[THREADS], *truth[THREADS]; /* [SPECTRA][pixels], [pixels][3] */
};

static size_t tiled(uint32_t side, uint32_t x, uint32_t y)
{
    size_t tile = (size_t)(y / TILE) * (side / TILE) + x / TILE;
    return tile * TILE * TILE + y % TILE * TILE + x % TILE;
}

static void keep(struct still_take *take, uint32_t channel, uint32_t light, size_t at, float value)
{
    size_t picture = (size_t)channel * LIGHTS + light, tile = at / (TILE * TILE);
    uint16_t half = ls_half_from_float(value);
    take->halves[picture * take->pixels + at] = half;
    if (channel != 0)
        return;
    float *most = &take->tile_max[tile * LIGHTS + light];
    take->white[light * take->pixels + at] = value;
    *most = fmaxf(*most, fabsf(ls_half_to_float(half)));
}

/* @r: [CHANNELS][side][side][3] of one light */
static void photograph(const struct making *m, unsigned thread, uint32_t light, const float *r)
{
    struct still_take *take = m->take;
    uint32_t side = take->side;
    for (uint32_t y = 0; y < side; y++)
        for (uint32_t x = 0; x < side; x++) {
            size_t pixel = (size_t)y * side + x, at = tiled(side, x, y);
            const float *of = r + 3 * pixel + (unsigned)ls_cfa_channel(LS_CFA_RGGB, x, y);
            for (uint32_t s = 0; s < CHANNELS; s++) {
                double e = take->g[s][light] * (double)of[s * take->pixels * 3];
                keep(take, s, light, at, photographed(e, 1, s * LIGHTS + light, pixel));
                if (s >= SPECTRA)
                    continue;
                m->sphere[thread][s * take->pixels + pixel] += (float)e;
                if (s > 0)
                    take->segment[s][take->segment_of[light]][pixel] += (float)e;
            }
        }
    for (uint32_t s = 0; s < SPECTRA; s++)
        for (size_t j = 0; j < 3 * take->pixels; j++)
            m->truth[thread][j] += (float)take->environment[s][light] * r[s * take->pixels * 3 + j];
}

/* Every other segment's lights, so that segments need no second sum. */
static void photograph_some(void *data, unsigned thread, unsigned n)
{
    const struct making *m = data;
    struct still_take *take = m->take;
    const struct sim_region all = {0, 0, 0, take->side, take->side};
    float *r = bench_alloc(sizeof *r * CHANNELS * 3 * take->pixels);
    struct ls_diag diag = {""};
    for (uint32_t i = 0; i < LIGHTS; i++)
        if (take->segment_of[i] % n == thread) {
            must(sim_truth_field(m->scene, &all, i, r, &diag), &diag);
            photograph(m, thread, i, r);
        }
    free(r);
}

static void photograph_many(struct making *m)
{
    struct still_take *take = m->take;
    for (uint32_t s = 0; s < SPECTRA; s++)
        for (size_t j = 0; j < take->pixels; j++) {
            double sum = 0;
            for (unsigned t = 0; t < THREADS; t++)
                sum += (double)m->sphere[t][s * take->pixels + j];
            take->sphere[s][j] = photographed(sum, LIGHTS, CHANNELS * LIGHTS + s, j);
        }
    for (uint32_t s = 1; s < SPECTRA; s++)
        for (uint32_t g = 0; g < SEGMENTS; g++)
            for (size_t j = 0; j < take->pixels; j++) {
                float *f = &take->segment[s][g][j];
                *f = photographed((double)*f, take->segment_size[g],
                                  CHANNELS * LIGHTS + SPECTRA * (g + 1) + s, j);
            }
}

static void photograph_all(struct still_take *take, const struct sim_scene *scene)
{
    struct making m = {take, scene, {NULL}, {NULL}};
    for (unsigned t = 0; t < THREADS; t++) {
        m.sphere[t] = bench_alloc(sizeof(float) * SPECTRA * take->pixels);
        m.truth[t] = bench_alloc(sizeof(float) * 3 * take->pixels);
    }
    bench_parallel(THREADS, photograph_some, &m);
    photograph_many(&m);
    for (unsigned t = 0; t < THREADS; t++) {
        for (size_t j = 0; j < 3 * take->pixels; j++)
            take->truth[j] += m.truth[t][j];
        free(m.sphere[t]);
        free(m.truth[t]);
    }
}

/* ---- numbers of the rig ---- */

static void measure_rig(struct still_take *take, const struct sim_scene *scene)
{
    const struct sim_geometry *geometry = sim_scene_geometry(scene);
    const struct sim_scene_config *config = sim_scene_config(scene);
    const double duties[CHANNELS] = {0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5};
    struct ls_calibration *calibration = NULL;
    struct ls_diag diag = {""};
    must(sim_truth_calibration(scene, 0, "BayerRG8", duties, CHANNELS, &calibration, &diag), &diag);
    for (uint32_t s = 0; s < CHANNELS; s++) {
        for (int c = 0; c < 3; c++)
            take->p[s][c] = (double)calibration->p[s][c];
        for (uint32_t i = 0; i < LIGHTS; i++) {
            take->g[s][i] = sim_scene_gain(scene, i, s);
            take->k[s][i] = 1 / take->g[s][i];
        }
    }
    for (uint32_t i = 0; i < LIGHTS; i++) {
        struct ls_polarisation_path path = {.camera_up = {0, 1, 0}};
        struct ls_polarisation a;
        take->omega_sr[i] = (double)geometry->omega_sr[i];
        memcpy(take->directions[i], geometry->direction[i], sizeof take->directions[i]);
        for (int k = 0; k < 3; k++) {
            path.light[k] = (double)geometry->position_m[i][k];
            path.camera[k] = config->views[0].position_m[k];
        }
        must(ls_polarisation_assume(&path, &a, &diag), &diag);
        must(ls_split_make(a, take->k[STILL_TAKE_V][i], take->k[STILL_TAKE_H][i], &take->split[i],
                           &diag),
             &diag);
    }
    ls_calibration_destroy(calibration);
}

static void find_white(struct still_take *take, const struct sim_scene *scene)
{
    struct sim_sample sample[SIM_SAMPLES];
    struct ls_diag diag = {""};
    must(sim_truth_samples(scene, 0, sample, &diag), &diag);
    for (int k = 0; k < SIM_SAMPLES; k++) {
        double sum[3] = {0};
        const struct sim_sample *at = &sample[k];
        if (strcmp(at->name, "white") != 0)
            continue;
        for (uint32_t y = at->y; y < at->y + at->height; y++)
            for (uint32_t x = at->x; x < at->x + at->width; x++)
                for (int c = 0; c < 3; c++)
                    sum[c] += (double)take->truth[3 * ((size_t)y * take->side + x) + (size_t)c];
        take->white_level = fmax(sum[0], fmax(sum[1], sum[2])) / ((double)at->width * at->height);
    }
}

/* ---- life ---- */

static void make_room(struct still_take *take)
{
    size_t pixels = take->pixels, tiles = pixels / (TILE * TILE);
    size_t pictures = (size_t)CHANNELS * LIGHTS;
    take->picture = bench_alloc(pictures * sizeof *take->picture);
    take->halves = bench_alloc(pictures * pixels * sizeof *take->halves);
    take->tiles = bench_alloc(pictures * tiles * sizeof *take->tiles);
    take->white = bench_alloc(LIGHTS * pixels * sizeof(float));
    take->tile_max = bench_alloc(LIGHTS * tiles * sizeof(float));
    take->truth = bench_alloc(3 * pixels * sizeof(float));
    for (size_t p = 0; p < pictures; p++) {
        for (size_t t = 0; t < tiles; t++)
            take->tiles[p * tiles + t] = take->halves + p * pixels + t * TILE * TILE;
        take->picture[p].tiles = take->tiles + p * tiles;
    }
    for (int s = 0; s < SPECTRA; s++) {
        take->sphere[s] = bench_alloc(pixels * sizeof(float));
        for (int g = 0; g < SEGMENTS && s > 0; g++)
            take->segment[s][g] = bench_alloc(pixels * sizeof(float));
    }
}

static void make_fields(struct still_take *take)
{
    static const double ones[SPECTRA] = {1, 1, 1, 1, 1, 1};
    const struct still_life_camera camera = {.noise = true};
    struct ls_linear_noise noise = still_life_noise(&camera, still_life_rate(1));
    const struct ls_field_noise of_light = {.read_variance = noise.floor, .shot = noise.shot};
    struct ls_diag diag = {""};
    double white[3];
    take->field = (struct ls_field){.n_lights = LIGHTS,
                                    .n_spectra = SPECTRA,
                                    .n_channels = 3,
                                    .width = take->side,
                                    .height = take->side,
                                    .cfa = LS_CFA_RGGB,
                                    .scale = 1,
                                    .white = take->picture,
                                    .k = take->k[0],
                                    .g = take->g[0],
                                    .omega_sr = take->omega_sr,
                                    .directions = (const float(*)[3])take->directions,
                                    .p = take->p[0],
                                    .duty = ones,
                                    .factor = ones,
                                    .noise = of_light};
    take->polarised = (struct ls_separated_field){.n_lights = LIGHTS,
                                                  .n_channels = 3,
                                                  .width = take->side,
                                                  .height = take->side,
                                                  .cfa = LS_CFA_RGGB,
                                                  .v = take->picture + STILL_TAKE_V * LIGHTS,
                                                  .h = take->picture + STILL_TAKE_H * LIGHTS,
                                                  .split = take->split,
                                                  .noise = of_light};
    for (int c = 0; c < 3; c++)
        white[c] = take->p[STILL_TAKE_V][c] + take->p[STILL_TAKE_H][c];
    must(ls_conductor_make(white, LS_CONDUCTOR_THRESHOLD, false, &take->polarised.conductor, &diag),
         &diag);
}

struct still_take *still_take_create(uint32_t side)
{
    struct still_take *take = bench_alloc(sizeof *take);
    struct sim_scene_config config;
    struct sim_scene *scene = NULL;
    struct ls_diag diag = {""};
    sim_scene_config_default(&config);
    sim_view_config_default(&config.views[0], side, side);
    must(sim_scene_create(&config, &scene, &diag), &diag);
    take->side = side;
    take->pixels = (size_t)side * side;
    make_room(take);
    measure_rig(take, scene);
    shine(take);
    must(ls_segments_partition((const float(*)[3])take->directions, LIGHTS, SEGMENTS,
                               take->segment_of, &diag),
         &diag);
    for (int i = 0; i < LIGHTS; i++)
        take->segment_size[take->segment_of[i]]++;
    photograph_all(take, scene);
    find_white(take, scene);
    make_fields(take);
    sim_scene_destroy(scene);
    return take;
}

void still_take_destroy(struct still_take *take)
{
    if (!take)
        return;
    for (int s = 0; s < SPECTRA; s++) {
        free(take->sphere[s]);
        for (int g = 0; g < SEGMENTS; g++)
            free(take->segment[s][g]);
    }
    free(take->picture);
    free(take->halves);
    free(take->tiles);
    free(take->white);
    free(take->tile_max);
    free(take->truth);
    free(take);
}
