/* Run time against error: the still life relit under six spectra, halves and floats, bilinear and
 * gradient, exact and with what may be left out, by every model. Two threads. */
#include "core/half.h"
#include "tests/bench/bench.h"
#include "tests/bench/relight.h"
#include "tests/bench/still_maps.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum {
    LIGHTS = STILL_LIFE_LIGHTS,
    SPECTRA = STILL_TAKE_SPECTRA,
    THREADS = STILL_TAKE_THREADS,
    SKIPS = 3,
};

static const struct {
    double of_white;
    const char *name;
} skips[SKIPS] = {{1e-4, "skip_1e-4"}, {1e-3, "skip_1e-3"}, {1e-2, "skip_1e-2"}};

struct setting {
    const struct bench *bench;
    struct still_take *take;
    struct ls_field bilinear, every; /* the white field; all spectra's pictures in a row */
    float *weights, *every_weights;  /* [SPECTRA][n_lights], [SPECTRA * n_lights] */
    float *ratio, *plain_ratio, *matrix, *separated_ratio; /* [SPECTRA][pixels][3 or 9] */
    float *float_sums;                                     /* [SPECTRA][pixels] */
    float *part[3];                                        /* of separated: [SPECTRA][pixels][3] */
    uint16_t *half_out;
};

enum way {
    GRADIENT,
    HALF_OUT,
    FLOATS,
    BILINEAR,
    SKIP,
    LINEAR = SKIP + SKIPS,
    MEASURED,
    SEPARATED,
    WAYS,
};

static const char *const way_name[WAYS] = {"half_gradient",  "half_gradient_half_out",
                                           "float_gradient", "half_bilinear",
                                           "skip_1e-4",      "skip_1e-3",
                                           "skip_1e-2",      "linear_14",
                                           "measured",       "separated"};

/** One way to the picture. */
struct contestant {
    struct setting *s;
    struct bench_relight relight;
    float *out; /* [pixels][3] */
};

static float *floats(size_t n)
{
    return bench_alloc(n * sizeof(float));
}

/* ---- the ways ---- */

static void ordinary(void *data)
{
    struct contestant *c = data;
    bench_relight(&c->relight);
}

static void to_halves_part(void *data, unsigned thread, unsigned n)
{
    const struct contestant *c = data;
    size_t all = 3 * c->s->take->pixels, from = all * thread / n, to = all * (thread + 1) / n;
    ls_half_from_floats(c->out + from, c->s->half_out + from, to - from);
}

static void half_out(void *data)
{
    ordinary(data);
    bench_parallel(THREADS, to_halves_part, data);
}

enum { PANEL = 128, TILE_PX = LS_TILE_SIDE * LS_TILE_SIDE };

/* Pixels [first, first + PANEL) of a tile: as ls_accumulate, of floats. */
static void sum_panel(const struct setting *s, const float *first, float acc[SPECTRA][PANEL])
{
    memset(acc, 0, sizeof(float) * SPECTRA * PANEL);
    for (uint32_t i = 0; i < LIGHTS; i += 2) {
        const float *a = first + i * s->take->pixels, *b = a + s->take->pixels;
        for (uint32_t q = 0; q < SPECTRA; q++) {
            float wa = s->weights[q * LIGHTS + i], wb = s->weights[q * LIGHTS + i + 1];
            float *restrict sum = acc[q];
            for (int j = 0; j < PANEL; j++)
                sum[j] += wa * a[j] + wb * b[j];
        }
    }
}

static void sum_floats_part(void *data, unsigned thread, unsigned n)
{
    const struct setting *s = ((struct contestant *)data)->s;
    size_t side = s->take->side, tiles_x = side / LS_TILE_SIDE, tiles = tiles_x * tiles_x;
    float acc[SPECTRA][PANEL];
    for (size_t t = tiles * thread / n; t < tiles * (thread + 1) / n; t++)
        for (size_t at = 0; at < TILE_PX; at += PANEL) {
            size_t x = t % tiles_x * LS_TILE_SIDE, y = t / tiles_x * LS_TILE_SIDE + at / 64;
            sum_panel(s, s->take->white + t * TILE_PX + at, acc);
            for (uint32_t q = 0; q < SPECTRA; q++)
                for (size_t r = 0; r < PANEL / LS_TILE_SIDE; r++)
                    memcpy(s->float_sums + q * s->take->pixels + (y + r) * side + x,
                           acc[q] + r * LS_TILE_SIDE, LS_TILE_SIDE * sizeof(float));
        }
}

static void finish_floats_part(void *data, unsigned thread, unsigned n)
{
    const struct contestant *c = data;
    const struct still_take *take = c->s->take;
    uint32_t side = take->side, y0 = side * thread / n, y1 = side * (thread + 1) / n;
    struct ls_relight_term terms[SPECTRA];
    for (uint32_t q = 0; q < SPECTRA; q++)
        terms[q] = (struct ls_relight_term){
            .sum = c->s->float_sums + q * take->pixels,
            .ratio = q ? c->s->ratio + (q * take->pixels + (size_t)y0 * side) * 3 : NULL,
            .channel = -1};
    if (ls_relight_finish(&take->field, (struct ls_demosaic_region){0, 0, side, side},
                          (struct ls_demosaic_region){0, y0, side, y1 - y0}, terms, SPECTRA, NULL,
                          c->out + (size_t)y0 * side * 3, NULL))
        abort();
}

static void from_floats(void *data)
{
    bench_parallel(THREADS, sum_floats_part, data);
    bench_parallel(THREADS, finish_floats_part, data);
}

static void separated_part(void *data, unsigned thread, unsigned n)
{
    const struct contestant *c = data;
    const struct setting *s = c->s;
    uint32_t side = s->take->side, tiles = side / LS_TILE_SIDE;
    uint32_t y0 = tiles * thread / n * LS_TILE_SIDE, y1 = tiles * (thread + 1) / n * LS_TILE_SIDE;
    size_t first = (size_t)y0 * side * 3, share = (size_t)(y1 - y0) * side * 3;
    struct ls_separated_job job = {.field = &s->take->polarised,
                                   .n_rows = SPECTRA,
                                   .weights = s->weights,
                                   .region = {0, y0, side, y1 - y0},
                                   .method = LS_DEMOSAIC_GRADIENT};
    float *part[3];
    if (y0 == y1)
        return;
    for (int k = 0; k < 3; k++)
        part[k] = s->part[k] + SPECTRA * first;
    if (ls_separated_accumulate(&job, part[0], part[1], part[2], NULL, NULL))
        abort();
    memset(c->out + first, 0, share * sizeof(float));
    for (uint32_t q = 0; q < SPECTRA; q++) {
        double tint[3];
        still_tint(s->take, q, tint);
        ls_separated_finish(part[0] + q * share, part[1] + q * share, part[2] + q * share,
                            s->separated_ratio + q * s->take->pixels * 3 + first, tint, 1,
                            share / 3, 3, c->out + first);
    }
}

static void separated(void *data)
{
    bench_parallel(THREADS, separated_part, data);
}

/* ---- the setting ---- */

static void make_maps(struct setting *s)
{
    size_t n = 3 * s->take->pixels;
    s->ratio = floats(SPECTRA * n);
    s->plain_ratio = floats(SPECTRA * n);
    s->matrix = floats(SPECTRA * 3 * n);
    s->separated_ratio = floats(SPECTRA * n);
    for (uint32_t q = 1; q < SPECTRA; q++) {
        still_ratio(s->take, q, LS_DEMOSAIC_GRADIENT, s->ratio + q * n);
        still_ratio(s->take, q, LS_DEMOSAIC_BILINEAR, s->plain_ratio + q * n);
        still_matrix(s->take, q, s->matrix + q * 3 * n);
    }
    still_separated_ratios(s->take, s->separated_ratio);
}

static void setting_init(struct setting *s, const struct bench *bench)
{
    *s = (struct setting){.bench = bench,
                          .take = still_take_create((uint32_t)bench_size(bench, 384, 128))};
    size_t n = 3 * s->take->pixels;
    s->weights = floats(SPECTRA * LIGHTS);
    s->every_weights = floats(SPECTRA * LIGHTS);
    s->float_sums = floats(SPECTRA * s->take->pixels);
    s->half_out = bench_alloc(n * sizeof *s->half_out);
    for (int k = 0; k < 3; k++)
        s->part[k] = floats(SPECTRA * n);
    for (uint32_t q = 0; q < SPECTRA; q++)
        for (uint32_t i = 0; i < LIGHTS; i++) {
            double w = s->take->environment[q][i];
            s->weights[q * LIGHTS + i] = (float)(w * s->take->k[0][i]);
            s->every_weights[q * LIGHTS + i] = (float)(w * s->take->k[q][i]);
        }
    s->bilinear = s->every = s->take->field;
    s->bilinear.demosaic = LS_DEMOSAIC_BILINEAR;
    s->every.n_lights = SPECTRA * LIGHTS;
    make_maps(s);
}

static void setting_finish(struct setting *s)
{
    free(s->weights);
    free(s->every_weights);
    free(s->ratio);
    free(s->plain_ratio);
    free(s->matrix);
    free(s->separated_ratio);
    free(s->float_sums);
    free(s->half_out);
    for (int k = 0; k < 3; k++)
        free(s->part[k]);
    still_take_destroy(s->take);
}

/* What an error of each sum may become in a picture that is not promoted: the gradient filter's
 * coefficients add to 2.5 in magnitude, and the spectra's sums meet in every channel. */
static const double amplification = 2.5 * SPECTRA;

static void contestant_init(struct contestant *c, struct setting *s, enum way way)
{
    size_t n = 3 * s->take->pixels;
    const float *ratio = way == BILINEAR ? s->plain_ratio : s->ratio;
    *c = (struct contestant){.s = s, .out = floats(n)};
    c->relight = (struct bench_relight){.field = way == BILINEAR   ? &s->bilinear
                                                 : way == MEASURED ? &s->every
                                                                   : &s->take->field,
                                        .n_threads = THREADS,
                                        .n_sums = way == MEASURED ? 1 : SPECTRA,
                                        .weights = way == MEASURED ? s->every_weights : s->weights,
                                        .out = c->out};
    for (uint32_t q = 1; q < SPECTRA && way != MEASURED; q++)
        if (way == LINEAR)
            c->relight.matrix[q] = s->matrix + q * 3 * n;
        else
            c->relight.ratio[q] = ratio + q * n;
    if (way >= SKIP && way < SKIP + SKIPS) {
        c->relight.tile_max = s->take->tile_max;
        c->relight.max_error = skips[way - SKIP].of_white * s->take->white_level / amplification;
    }
}

static void contestant_finish(struct contestant *c)
{
    free(c->out);
}

/* ---- errors and rows ---- */

/* Root mean square over the picture, of white. */
static double rms(const struct setting *s, const float *a, const float *b)
{
    double sum = 0;
    size_t n = 3 * s->take->pixels;
    for (size_t j = 0; j < n; j++)
        sum += pow((double)a[j] - (double)b[j], 2);
    return sqrt(sum / (double)n) / s->take->white_level;
}

static double largest(const struct setting *s, const float *a, const float *b)
{
    double most = 0;
    for (size_t j = 0; j < 3 * s->take->pixels; j++)
        most = fmax(most, fabs((double)a[j] - (double)b[j]));
    return most / s->take->white_level;
}

/* The truth as the mosaic sees it: what is left of a model's error is its own, and noise. */
static float *seen_truth(const struct setting *s)
{
    const struct still_take *take = s->take;
    uint32_t side = take->side;
    struct ls_demosaic_region all = {0, 0, side, side};
    float *mosaic = floats(take->pixels), *rgb = floats(3 * take->pixels);
    for (uint32_t y = 0; y < side; y++)
        for (uint32_t x = 0; x < side; x++) {
            size_t j = (size_t)y * side + x;
            mosaic[j] = take->truth[3 * j + (unsigned)ls_cfa_channel(take->field.cfa, x, y)];
        }
    if (ls_relight_demosaic(&take->field, mosaic, all, all, rgb))
        abort();
    free(mosaic);
    return rgb;
}

static void row(const struct setting *s, const char *prefix, enum way way,
                const struct bench_task *task, double error, const struct bench_task *reference)
{
    char name[64];
    snprintf(name, sizeof name, "%s_%s", prefix, way_name[way]);
    bench_row(s->bench, &(struct bench_row){.name = name,
                                            .unit = "s",
                                            .value = task->median_s,
                                            .median = task->median_s,
                                            .error = error,
                                            .reference = "half_gradient",
                                            .reference_value = reference->median_s,
                                            .ratio = reference->median_s / task->median_s,
                                            .wanted = NAN});
}

/* After promotion an error of a sum grows by its ratio. */
static bool promoted_within(const struct setting *s, const float *cut, const float *whole,
                            double bound)
{
    size_t n = 3 * s->take->pixels;
    double most = 0;
    for (size_t j = 0; j < n; j++)
        most = fmax(most, fabs((double)whole[j]));
    for (size_t j = 0; j < n; j++) {
        double allowed = 1;
        for (uint32_t q = 1; q < SPECTRA; q++)
            allowed += fabs((double)s->ratio[q * n + j]);
        /* 1e-5: 43 roundings of a sum, times the filter's 2.5, twice */
        if (fabs((double)cut[j] - (double)whole[j]) > 2.5 * bound * allowed + 1e-5 * most)
            return false;
    }
    return true;
}

/* The bound that comes back is of the sums before promotion: against what happened to them. */
static void bound_row(struct setting *s, enum way way, const struct contestant *cut,
                      const struct contestant *whole)
{
    char name[64];
    struct bench_relight sums[2] = {whole->relight, cut->relight};
    float *out[2];
    double bound = cut->relight.report.bound;
    for (int k = 0; k < 2; k++) {
        out[k] = sums[k].out = floats(3 * s->take->pixels);
        memset(sums[k].ratio, 0, sizeof sums[k].ratio);
        bench_relight(&sums[k]);
    }
    double happened = largest(s, out[0], out[1]);
    double allowed = amplification * bound / s->take->white_level;
    snprintf(name, sizeof name, "bound_%s", way_name[way]);
    bench_row(s->bench, &(struct bench_row){.name = name,
                                            .unit = "of white",
                                            .value = happened,
                                            .median = happened,
                                            .error = largest(s, cut->out, whole->out),
                                            .reference = "the bound that came back",
                                            .reference_value = allowed,
                                            .ratio = allowed > 0 ? happened / allowed : 0,
                                            .wanted = 1,
                                            .at_most = true});
    if (happened > allowed + 1e-5 * largest(s, out[0], out[0]) ||
        !promoted_within(s, cut->out, whole->out, bound)) {
        fprintf(stderr, "%s: the error is beyond the bound that came back\n", name);
        exit(1);
    }
    free(out[0]);
    free(out[1]);
}

int main(int argc, char **argv)
{
    struct bench bench;
    struct setting s;
    bench_init(&bench, argc, argv);
    setting_init(&s, &bench);
    struct contestant c[WAYS];
    struct bench_task tasks[WAYS];
    for (enum way w = 0; w < WAYS; w++) {
        contestant_init(&c[w], &s, w);
        tasks[w] = (struct bench_task){.name = way_name[w], .run = ordinary, .data = &c[w]};
    }
    tasks[HALF_OUT].run = half_out;
    tasks[FLOATS].run = from_floats;
    tasks[SEPARATED].run = separated;
    bench_time(&bench, tasks, WAYS);
    ls_half_to_floats(s.half_out, c[HALF_OUT].out, 3 * s.take->pixels);
    for (enum way w = 0; w < WAYS; w++)
        row(&s, "truth", w, &tasks[w], rms(&s, c[w].out, s.take->truth), &tasks[GRADIENT]);
    static const enum way models[] = {GRADIENT, LINEAR, SEPARATED, MEASURED};
    float *seen = seen_truth(&s);
    for (size_t k = 0; k < sizeof models / sizeof *models; k++)
        row(&s, "model", models[k], &tasks[models[k]], rms(&s, c[models[k]].out, seen),
            &tasks[GRADIENT]);
    free(seen);
    row(&s, "exact", GRADIENT, &tasks[GRADIENT], rms(&s, c[GRADIENT].out, c[FLOATS].out),
        &tasks[GRADIENT]);
    row(&s, "exact", HALF_OUT, &tasks[HALF_OUT], rms(&s, c[HALF_OUT].out, c[FLOATS].out),
        &tasks[GRADIENT]);
    for (enum way w = SKIP; w < SKIP + SKIPS; w++) {
        row(&s, "exact", w, &tasks[w], rms(&s, c[w].out, c[GRADIENT].out), &tasks[GRADIENT]);
        bound_row(&s, w, &c[w], &c[GRADIENT]);
    }
    for (enum way w = 0; w < WAYS; w++)
        contestant_finish(&c[w]);
    setting_finish(&s);
    return 0;
}
