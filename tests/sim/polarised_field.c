#include "polarised_field.h"

#include "core/half.h"
#include "core/promote.h"
#include "sim/truth.h"

#include <glib.h>
#include <string.h>

static const double full_well = 42000, read_noise = 5;
static const uint32_t channel_of[POLARISED_KINDS] = {POLARISED_W, POLARISED_V, POLARISED_H};

static void make_scene(struct polarised_field *f, const char *name)
{
    struct sim_scene_config config;
    sim_scene_config_default(&config);
    sim_view_config_default(&config.views[0], f->size, f->size);
    g_strlcpy(config.scene, name, sizeof config.scene);
    config.sphere_radius_m = 0.1;
    config.n_lights = f->n_lights;
    config.views[0].focal_length_mm *= 2.8; /* 0.26 m wide at the centre */
    g_assert_cmpint(sim_scene_create(&config, &f->scene, NULL), ==, LS_OK);
}

void polarised_field_p(const struct polarised_field *f, uint32_t channel, double p[3])
{
    for (uint32_t c = 0; c < 3; c++)
        p[c] = (double)sim_response_of(&f->scene->response[0], channel, c, SIM_MAT_FLAT);
}

static void add_noise(struct polarised_field *f, float *e)
{
    double variance = f->field.noise.read_variance + f->field.noise.shot * fmax((double)*e, 0);
    *e += (float)(sqrt(variance) * noise_normal(&f->noise));
}

static void to_mosaic(const struct polarised_field *f, const float *rgb, double scale, float *out)
{
    for (uint32_t k = 0; k < f->n_px; k++)
        out[k] = (float)(scale * (double)rgb[3 * k + (uint32_t)ls_cfa_channel(
                                                         f->field.cfa, k % f->size, k / f->size)]);
}

static void demosaic(const struct polarised_field *f, const float *mosaic, float *out)
{
    struct ls_demosaic_region all = {0, 0, f->size, f->size};
    struct ls_demosaic_source source = {mosaic, f->size, all, f->size, f->size, f->field.cfa};
    struct ls_demosaic_target target = {{out, out + 1, out + 2}, 3, 3 * (size_t)f->size};
    g_assert_cmpint(ls_demosaic(&source, all, LS_DEMOSAIC_GRADIENT, &target), ==, LS_OK);
}

/* In turn: tiles of the picture, rows of a tile; the last ones as small as the picture leaves. */
static void store(struct polarised_field *f, uint32_t kind, uint32_t light, const float *mosaic)
{
    uint32_t across = (f->size + LS_TILE_SIDE - 1) / LS_TILE_SIDE, n = 0;
    size_t picture = (size_t)kind * f->n_lights + light;
    uint16_t *to = f->halves + picture * f->n_px;
    const void **tiles = f->tiles + picture * across * across;
    f->pictures[kind][light].tiles = tiles;
    for (uint32_t y = 0; y < f->size; y += LS_TILE_SIDE)
        for (uint32_t x = 0; x < f->size; x += LS_TILE_SIDE) {
            uint32_t w = MIN(LS_TILE_SIDE, f->size - x), h = MIN(LS_TILE_SIDE, f->size - y);
            tiles[n++] = to;
            for (uint32_t j = 0; j < h; j++, to += w)
                ls_half_from_floats(mosaic + (y + j) * f->size + x, to, w);
        }
}

static void expose(struct polarised_field *f)
{
    struct sim_region all = {0, 0, 0, f->size, f->size};
    size_t plane = 3 * (size_t)f->n_px;
    float *truth = g_new(float, f->scene->config.n_channels *plane);
    float *mosaic = g_new(float, f->n_px);
    for (uint32_t i = 0; i < f->n_lights; i++) {
        g_assert_cmpint(sim_truth_field(f->scene, &all, i, truth, NULL), ==, LS_OK);
        for (uint32_t kind = 0; kind < POLARISED_KINDS; kind++) {
            uint32_t channel = channel_of[kind];
            to_mosaic(f, truth + channel * plane, f->to_stored * (double)f->strength[channel][i],
                      mosaic);
            for (uint32_t k = 0; f->noisy && k < f->n_px; k++)
                add_noise(f, &mosaic[k]);
            store(f, kind, i, mosaic);
        }
    }
    g_free(truth);
    g_free(mosaic);
}

void polarised_field_split(struct polarised_field *f, const struct ls_polarisation *a)
{
    for (uint32_t i = 0; i < f->n_lights; i++)
        g_assert_cmpint(ls_split_make(a[i], 1 / (double)f->strength[POLARISED_V][i],
                                      1 / (double)f->strength[POLARISED_H][i], &f->split[i], NULL),
                        ==, LS_OK);
}

void polarised_field_factors(struct polarised_field *f, double radius_m)
{
    const struct sim_view_config *view = &f->scene->config.views[0];
    struct ls_polarisation_path path = {.camera_up = {0, 1, 0}};
    memcpy(path.camera, view->position_m, sizeof path.camera);
    for (uint32_t i = 0; i < f->n_lights; i++) {
        double point[3];
        for (int k = 0; k < 3; k++)
            path.light[k] = (double)f->scene->geometry.position_m[i][k];
        g_assert_cmpint(ls_polarisation_highlight(&path, radius_m, point, NULL), ==, LS_OK);
        g_assert_cmpint(
            ls_polarisation_reflect(&path, point, LS_POLARISATION_INDEX, &f->a[i], NULL), ==,
            LS_OK);
    }
    polarised_field_split(f, f->a);
}

void polarised_field_init(struct polarised_field *f, const char *scene, uint32_t size,
                          uint32_t n_lights, uint64_t seed)
{
    *f = (struct polarised_field){.size = size,
                                  .n_px = size * size,
                                  .n_lights = n_lights,
                                  .noisy = seed != 0,
                                  .noise = {.state = seed}};
    make_scene(f, scene);
    f->to_stored = 0.5 / (0.9 / M_PI);
    uint32_t across = (size + LS_TILE_SIDE - 1) / LS_TILE_SIDE;
    size_t pictures = (size_t)POLARISED_KINDS * f->n_lights;
    f->halves = g_new(uint16_t, pictures * f->n_px);
    f->tiles = g_new(const void *, pictures *across *across);
    f->a = g_new(struct ls_polarisation, f->n_lights);
    f->split = g_new(struct ls_split, f->n_lights);
    for (uint32_t kind = 0; kind < POLARISED_KINDS; kind++)
        f->pictures[kind] = g_new(struct ls_picture, f->n_lights);
    for (uint32_t s = 0; s < f->scene->config.n_channels; s++) {
        f->strength[s] = g_new(float, f->n_lights);
        for (uint32_t i = 0; i < f->n_lights; i++) /* a polariser's loss belongs to its scale */
            f->strength[s][i] = (float)(sim_scene_gain(f->scene, i, s) /
                                        (s < POLARISED_V ? 1 : f->scene->polariser_gain));
    }
    f->field = (struct ls_separated_field){
        .n_lights = f->n_lights,
        .n_channels = 3,
        .width = size,
        .height = size,
        .cfa = f->scene->view[0].cfa,
        .v = f->pictures[1],
        .h = f->pictures[2],
        .split = f->split,
        .noise = {.read_variance = pow(read_noise / full_well, 2), .shot = 1 / full_well}};
    polarised_field_p(f, POLARISED_V, f->white);
    g_assert_cmpint(
        ls_conductor_make(f->white, LS_CONDUCTOR_THRESHOLD, false, &f->field.conductor, NULL), ==,
        LS_OK);
    expose(f);
    polarised_field_factors(f, 0);
}

void polarised_field_finish(struct polarised_field *f)
{
    for (uint32_t s = 0; s < f->scene->config.n_channels; s++)
        g_free(f->strength[s]);
    for (uint32_t kind = 0; kind < POLARISED_KINDS; kind++)
        g_free(f->pictures[kind]);
    g_free(f->halves);
    g_free(f->tiles);
    g_free(f->a);
    g_free(f->split);
    sim_scene_destroy(f->scene);
}

void polarised_field_sums(const struct polarised_field *f, const float *row, float *d, float *s,
                          float *c)
{
    struct ls_separated_job job = {.field = &f->field,
                                   .n_rows = 1,
                                   .weights = row,
                                   .region = {0, 0, f->size, f->size},
                                   .method = LS_DEMOSAIC_GRADIENT};
    g_assert_cmpint(ls_separated_accumulate(&job, d, s, c, NULL, NULL), ==, LS_OK);
}

static void add_stored(const struct polarised_field *f, uint32_t kind, uint32_t light, float weight,
                       float *mosaic)
{
    uint32_t n = 0;
    const void *const *tiles = f->pictures[kind][light].tiles;
    for (uint32_t y = 0; y < f->size; y += LS_TILE_SIDE)
        for (uint32_t x = 0; x < f->size; x += LS_TILE_SIDE) {
            uint32_t w = MIN(LS_TILE_SIDE, f->size - x), h = MIN(LS_TILE_SIDE, f->size - y);
            const uint16_t *from = tiles[n++];
            for (uint32_t j = 0; j < h; j++)
                for (uint32_t k = 0; k < w; k++)
                    mosaic[(y + j) * f->size + x + k] += weight * ls_half_to_float(*from++);
        }
}

void polarised_field_mosaic(const struct polarised_field *f, uint32_t kind, uint32_t light,
                            float *out)
{
    memset(out, 0, sizeof *out * f->n_px);
    add_stored(f, kind, light, 1 / f->strength[channel_of[kind]][light], out);
}

void polarised_field_white(const struct polarised_field *f, const float *row, float *out)
{
    float *mosaic = g_new0(float, f->n_px);
    for (uint32_t i = 0; i < f->n_lights; i++)
        if (row[i] != 0)
            add_stored(f, 0, i, row[i] / f->strength[POLARISED_W][i], mosaic);
    demosaic(f, mosaic, out);
    g_free(mosaic);
}

/* One channel's truth, each pixel times @share or, if NULL, 1; without the mosaic in @plain. */
static void look(const struct polarised_field *f, uint32_t light, uint32_t channel,
                 const float *share, float *plain, float *out)
{
    struct sim_region all = {0, 0, 0, f->size, f->size};
    size_t plane = 3 * (size_t)f->n_px;
    float *truth = g_new(float, f->scene->config.n_channels *plane);
    float *mosaic = g_new(float, f->n_px);
    g_assert_cmpint(sim_truth_field(f->scene, &all, light, truth, NULL), ==, LS_OK);
    to_mosaic(f, truth + channel * plane, f->to_stored, mosaic);
    for (size_t k = 0; plain && k < plane; k++)
        plain[k] = (float)(f->to_stored * (double)truth[channel * plane + k]);
    for (uint32_t k = 0; share && k < f->n_px; k++)
        mosaic[k] *= share[k];
    demosaic(f, mosaic, out);
    g_free(mosaic);
    g_free(truth);
}

void polarised_field_truth(const struct polarised_field *f, uint32_t light, uint32_t channel,
                           float *plain, float *out)
{
    look(f, light, channel, NULL, plain, out);
}

void polarised_field_specular(const struct polarised_field *f, uint32_t light, float *out)
{
    struct sim_region all = {0, 0, 0, f->size, f->size};
    float *share = g_new(float, f->n_px);
    g_assert_cmpint(sim_truth_specular(f->scene, &all, light, share, NULL), ==, LS_OK);
    look(f, light, POLARISED_W, share, NULL, out);
    g_free(share);
}

void polarised_field_sphere(struct polarised_field *f, const float *row, uint32_t channel,
                            bool noisy, float *out)
{
    struct sim_region all = {0, 0, 0, f->size, f->size};
    float *weights = g_new0(float, f->scene->config.n_channels * f->n_lights);
    float *truth = g_new0(float, 3 * (size_t)f->n_px), *mosaic = g_new(float, f->n_px);
    memcpy(weights + channel * f->n_lights, row, sizeof *row * f->n_lights);
    g_assert_cmpint(sim_truth_relight(f->scene, &all, weights, 1, truth, NULL), ==, LS_OK);
    double dim = 1 / 90.0; /* a full sphere is dimmed to be exposed like one light */
    to_mosaic(f, truth, f->to_stored * dim, mosaic);
    for (uint32_t k = 0; k < f->n_px; k++) {
        if (noisy)
            add_noise(f, &mosaic[k]);
        mosaic[k] = (float)((double)mosaic[k] / dim);
    }
    demosaic(f, mosaic, out);
    g_free(weights);
    g_free(truth);
    g_free(mosaic);
}

void polarised_field_ratio(struct polarised_field *f, uint32_t channel, bool separated,
                           float *ratio)
{
    size_t n = 3 * (size_t)f->n_px;
    const float *row = f->strength[channel];
    float *sphere = g_new(float, n), *v = g_new(float, n), *sigma = g_new(float, n);
    float *s = g_new(float, n), *c = g_new(float, n), *total = g_new(float, n);
    double p[3], white[3], neutral[3], tint[3];
    polarised_field_p(f, channel, p);
    polarised_field_p(f, POLARISED_W, white);
    for (int k = 0; k < 3; k++) {
        tint[k] = p[k] / f->white[k];
        neutral[k] = separated ? tint[k] : p[k] / white[k];
    }
    polarised_field_sphere(f, row, channel, f->noisy, sphere);
    if (separated) {
        polarised_field_sums(f, row, v, s, c);
        for (size_t k = 0; k < n; k++)
            total[k] = v[k] + s[k];
        ls_separate_remainder(sphere, v, s, c, tint, f->n_px, 3, sphere, v);
    } else {
        polarised_field_white(f, row, v);
        memcpy(total, v, sizeof *v * n);
    }
    ls_separated_sigma(&f->field, row, total, n, sigma);
    ls_promote_add_contrast(v, f->size, f->size, 3, sigma);
    g_assert_cmpint(ls_promote_ratio(sphere, v, sigma, f->size, f->size, 3, neutral, ratio, NULL),
                    ==, LS_OK);
    g_free(sphere);
    g_free(v);
    g_free(sigma);
    g_free(s);
    g_free(c);
    g_free(total);
}
