#include "tests/bench/still_maps.h"

#include "core/linear.h"
#include "core/promote.h"
#include "core/relight.h"
#include "tests/bench/bench.h"

#include <stdio.h>
#include <stdlib.h>

enum { LIGHTS = STILL_LIFE_LIGHTS, SPECTRA = STILL_TAKE_SPECTRA, SEGMENTS = STILL_TAKE_SEGMENTS };

static void must(enum ls_err err, const struct ls_diag *diag)
{
    if (err) {
        fprintf(stderr, "maps: %s\n", diag->text);
        exit(1);
    }
}

static float *floats(size_t n)
{
    return bench_alloc(n * sizeof(float));
}

static void to_rgb(const struct still_take *take, const float *mosaic,
                   enum ls_demosaic_method method, float *rgb)
{
    struct ls_field field = take->field;
    struct ls_demosaic_region all = {0, 0, take->side, take->side};
    struct ls_diag diag = {"the picture cannot be demosaiced"};
    field.demosaic = method;
    must(ls_relight_demosaic(&field, mosaic, all, all, rgb), &diag);
}

/* sums [n][pixels] of white */
static float *sum_white(const struct still_take *take, const float *rows, uint32_t n)
{
    uint32_t tiles = take->side / LS_TILE_SIDE;
    struct ls_tile_region all = {0, 0, tiles, tiles};
    struct ls_accumulate_job job = {
        .pictures = take->field.white, .n_pictures = LIGHTS, .n_sums = n, .weights = rows};
    struct ls_diag diag = {""};
    float *sums = floats(n * take->pixels);
    must(ls_accumulate(&take->field, &job, &all, sums, NULL, &diag), &diag);
    return sums;
}

static void denominator_row(const struct still_take *take, uint32_t s, float *row)
{
    for (uint32_t i = 0; i < LIGHTS; i++)
        row[i] = (float)(take->g[s][i] * take->k[0][i]);
}

void still_ratio(const struct still_take *take, uint32_t s, enum ls_demosaic_method method,
                 float *out)
{
    size_t n = 3 * take->pixels;
    float row[LIGHTS], *f = floats(n), *v = floats(n), *sigma = floats(n);
    double neutral[3];
    struct ls_diag diag = {""};
    denominator_row(take, s, row);
    float *sum = sum_white(take, row, 1);
    to_rgb(take, take->sphere[s], method, f);
    to_rgb(take, sum, method, v);
    ls_promote_sigma(&take->field, row, LIGHTS, v, n, sigma);
    ls_promote_add_contrast(v, take->side, take->side, 3, sigma);
    for (int c = 0; c < 3; c++)
        neutral[c] = take->p[s][c] / take->p[0][c];
    must(ls_promote_ratio(f, v, sigma, take->side, take->side, 3, neutral, out, &diag), &diag);
    free(sum);
    free(f);
    free(v);
    free(sigma);
}

static struct ls_linear_noise noise_of(double n_lights)
{
    const struct still_life_camera camera = {.noise = true};
    return still_life_noise(&camera, still_life_rate(n_lights));
}

void still_matrix(const struct still_take *take, uint32_t s, float *out)
{
    size_t n = 3 * take->pixels;
    float *rows = floats(SEGMENTS * LIGHTS), row[LIGHTS], *v[SEGMENTS], *f[SEGMENTS];
    struct ls_linear_noise v_noise[SEGMENTS] = {{0}}, f_noise[SEGMENTS], one = noise_of(1);
    struct ls_linear_pictures pictures = {.width = take->side,
                                          .height = take->side,
                                          .n_segments = SEGMENTS,
                                          .n_lights = LIGHTS,
                                          .n_in = 3,
                                          .n_out = 3,
                                          .v = (const float *const *)v,
                                          .f = (const float *const *)f,
                                          .v_noise = v_noise,
                                          .f_noise = f_noise,
                                          .p_in = take->p[0],
                                          .p_out = take->p[s],
                                          .inputs = {0, 1, 2},
                                          .demosaiced = true};
    struct ls_linear_options options;
    struct ls_diag diag = {""};
    denominator_row(take, s, row);
    for (uint32_t i = 0; i < LIGHTS; i++) {
        struct ls_linear_noise *noise = &v_noise[take->segment_of[i]];
        double w = (double)row[i];
        rows[take->segment_of[i] * LIGHTS + i] = row[i];
        noise->floor += w * w * one.floor;
        noise->shot = noise->shot > w * one.shot ? noise->shot : w * one.shot;
    }
    float *sums = sum_white(take, rows, SEGMENTS);
    for (int g = 0; g < SEGMENTS; g++) {
        v[g] = floats(n);
        f[g] = floats(n);
        to_rgb(take, sums + (size_t)g * take->pixels, LS_DEMOSAIC_GRADIENT, v[g]);
        to_rgb(take, take->segment[s][g], LS_DEMOSAIC_GRADIENT, f[g]);
        f_noise[g] = noise_of(take->segment_size[g]);
        pictures.total_noise.floor += v_noise[g].floor;
        if (pictures.total_noise.shot < v_noise[g].shot)
            pictures.total_noise.shot = v_noise[g].shot;
    }
    ls_linear_options_default(&options);
    const struct ls_linear_part all = {.width = take->side, .height = take->side, .out = out};
    must(ls_linear_fit(&pictures, &options, &all, &diag), &diag);
    for (int g = 0; g < SEGMENTS; g++) {
        free(v[g]);
        free(f[g]);
    }
    free(sums);
    free(rows);
}

void still_tint(const struct still_take *take, uint32_t s, double tint[3])
{
    for (int c = 0; c < 3; c++)
        tint[c] = take->p[s][c] / (take->p[STILL_TAKE_V][c] + take->p[STILL_TAKE_H][c]);
}

/* as the daemon makes it: what is lit for its noise, what is left for the fraction */
static void separated_ratio(const struct still_take *take, uint32_t s, const float *row,
                            float *const sums[3], float *out)
{
    size_t n = 3 * take->pixels;
    float *f = floats(n), *v = floats(n), *sigma = floats(n);
    double tint[3];
    struct ls_diag diag = {""};
    still_tint(take, s, tint);
    to_rgb(take, take->sphere[s], LS_DEMOSAIC_GRADIENT, f);
    for (size_t j = 0; j < n; j++)
        v[j] = sums[0][j] + sums[1][j];
    ls_separated_sigma(&take->polarised, row, v, n, sigma);
    ls_separate_remainder(f, sums[0], sums[1], sums[2], tint, take->pixels, 3, f, v);
    ls_promote_add_contrast(v, take->side, take->side, 3, sigma);
    must(ls_promote_ratio(f, v, sigma, take->side, take->side, 3, tint, out, &diag), &diag);
    free(f);
    free(v);
    free(sigma);
}

void still_separated_ratios(const struct still_take *take, float *out)
{
    size_t n = 3 * take->pixels;
    float *rows = floats(SPECTRA * LIGHTS), *sums[3];
    struct ls_separated_job job = {.field = &take->polarised,
                                   .n_rows = SPECTRA,
                                   .weights = rows,
                                   .region = {0, 0, take->side, take->side},
                                   .method = LS_DEMOSAIC_GRADIENT};
    struct ls_diag diag = {""};
    for (int k = 0; k < 3; k++)
        sums[k] = floats(SPECTRA * n);
    for (uint32_t s = 0; s < SPECTRA; s++)
        for (uint32_t i = 0; i < LIGHTS; i++)
            rows[s * LIGHTS + i] = (float)take->g[s][i];
    must(ls_separated_accumulate(&job, sums[0], sums[1], sums[2], NULL, &diag), &diag);
    for (uint32_t s = 0; s < SPECTRA; s++) {
        float *const of[3] = {sums[0] + s * n, sums[1] + s * n, sums[2] + s * n};
        separated_ratio(take, s, rows + s * LIGHTS, of, out + s * n);
    }
    for (int k = 0; k < 3; k++)
        free(sums[k]);
    free(rows);
}
