/* Relighting: one picture under six spectra, by ratios and by matrices, 24 environments at once,
 * and what it takes in memory. Two threads, from mapped files to RGB floats. */
#include "core/half.h"
#include "tests/bench/references.h"
#include "tests/bench/relight.h"
#include "tests/bench/served.h"
#include "tests/bench/take.h"

#include <cblas.h>
#include <malloc.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { SPECTRA = 6, ENVIRONMENTS = 24, THREADS = 2, CEILING_MIB = 256 };

struct setting {
    const struct bench *bench;
    struct bench_take *take;
    size_t pixels;
    float *ratio, *matrix; /* [SPECTRA - 1][pixels][3], [9] */
    float *weights;        /* [ENVIRONMENTS * SPECTRA][n_lights] */
    float *out;
};

static float uniform(uint64_t *state)
{
    *state = *state * 6364136223846793005u + 1442695040888963407u;
    return (float)(*state >> 40) * 0x1p-24f;
}

static void setting_init(struct setting *s, const struct bench *bench)
{
    uint64_t random = 1;
    uint32_t size = (uint32_t)bench_size(bench, 2048, 192);
    uint32_t lights = (uint32_t)bench_size(bench, 346, 40);
    *s = (struct setting){.bench = bench,
                          .take = bench_take_create(lights, SPECTRA, size),
                          .pixels = (size_t)size * size};
    s->ratio = bench_map_floats((SPECTRA - 1) * s->pixels * 3);
    s->matrix = bench_map_floats((SPECTRA - 1) * s->pixels * 9);
    for (size_t k = 0; k < (SPECTRA - 1) * s->pixels * 3; k++)
        s->ratio[k] = 0.1f + uniform(&random);
    for (size_t k = 0; k < (SPECTRA - 1) * s->pixels * 9; k++)
        s->matrix[k] = k % 4 == 0 ? 0.5f : 0.1f * uniform(&random);
    s->weights = bench_alloc(sizeof(float) * ENVIRONMENTS * SPECTRA * lights);
    for (size_t k = 0; k < (size_t)ENVIRONMENTS * SPECTRA * lights; k++)
        s->weights[k] = 0.01f + uniform(&random) / 100;
    s->out = bench_alloc(s->pixels * 3 * sizeof *s->out);
}

static void setting_finish(struct setting *s)
{
    bench_map_free(s->ratio, (SPECTRA - 1) * s->pixels * 3);
    bench_map_free(s->matrix, (SPECTRA - 1) * s->pixels * 9);
    free(s->weights);
    free(s->out);
    bench_take_destroy(s->take);
}

static struct bench_relight relight_of(const struct setting *s)
{
    return (struct bench_relight){.field = &s->take->field,
                                  .n_threads = THREADS,
                                  .n_sums = SPECTRA,
                                  .weights = s->weights,
                                  .out = s->out};
}

/* ---- what it is held against ---- */

static void read_files_part(void *data, unsigned thread, unsigned n)
{
    const struct setting *s = data;
    for (uint32_t i = thread; i < s->take->n_lights; i += n) {
        struct reference_bytes one = {NULL, s->take->file[i].map, s->take->file[i].bytes, 1, 0};
        reference_read(&one);
    }
}

static void read_files(void *data)
{
    bench_parallel(THREADS, read_files_part, data);
}

/* A sixteenth of the picture the plain way: every light's mosaic to RGB, times every ratio, as one
 * matrix of floats [conditions][samples], and a product with the row of weights. */
struct plain {
    const struct setting *s;
    float *matrix, *mosaic, *rgb, *row, *out;
};

enum { PLAIN_ROWS = 16 };

static void plain_strip(const struct plain *p, uint32_t y, uint32_t side)
{
    const struct setting *s = p->s;
    uint32_t n = s->take->n_lights, size = s->take->field.width;
    size_t samples = (size_t)side * PLAIN_ROWS * 3;
    uint32_t y0 = y < 2 ? 0 : y - 2, rows = PLAIN_ROWS + 4;
    struct ls_demosaic_region window = {0, y0, side + 4, y0 + rows > size ? size - y0 : rows};
    for (uint32_t i = 0; i < n; i++) {
        for (uint32_t r = 0; r < window.height; r++)
            for (uint32_t x = 0; x < window.width; x += LS_TILE_SIDE) {
                uint32_t yy = y0 + r, tile = yy / 64 * (size / 64) + x / 64;
                uint32_t count = window.width - x < 64 ? window.width - x : 64;
                uint16_t half[64];
                memcpy(half, (const char *)s->take->white[i].tiles[tile] + (size_t)(yy % 64) * 128,
                       2 * (size_t)count);
                ls_half_to_floats(half, p->mosaic + (size_t)r * window.width + x, count);
            }
        if (ls_relight_demosaic(&s->take->field, p->mosaic, window,
                                (struct ls_demosaic_region){0, y, side, PLAIN_ROWS}, p->rgb))
            abort();
        for (uint32_t q = 0; q < SPECTRA; q++) {
            float *to = p->matrix + ((size_t)q * n + i) * samples;
            for (uint32_t r = 0; r < PLAIN_ROWS; r++)
                for (uint32_t k = 0; k < 3 * side; k++)
                    to[r * 3 * side + k] =
                        p->rgb[r * 3 * side + k] *
                        (q ? s->ratio[((q - 1) * s->pixels + (size_t)(y + r) * size) * 3 + k] : 1);
        }
    }
    cblas_sgemm(CblasRowMajor, CblasNoTrans, CblasNoTrans, 1, (int)samples, (int)(n * SPECTRA), 1,
                p->row, (int)(n * SPECTRA), p->matrix, (int)samples, 0, p->out, (int)samples);
}

static void plain_sixteenth(void *data)
{
    const struct plain *p = data;
    uint32_t side = p->s->take->field.width / 4;
    for (uint32_t y = 0; y < side; y += PLAIN_ROWS)
        plain_strip(p, y, side);
}

static void plain_init(struct plain *p, const struct setting *s)
{
    uint32_t side = s->take->field.width / 4, n = s->take->n_lights;
    size_t samples = (size_t)side * PLAIN_ROWS * 3;
    p->s = s;
    p->matrix = bench_alloc(samples * n * SPECTRA * sizeof(float));
    p->mosaic = bench_alloc((size_t)(side + 4) * (PLAIN_ROWS + 4) * sizeof(float));
    p->rgb = bench_alloc(samples * sizeof(float));
    p->row = bench_alloc((size_t)n * SPECTRA * sizeof(float));
    p->out = bench_alloc(samples * sizeof(float));
    memcpy(p->row, s->weights, (size_t)n * SPECTRA * sizeof(float));
}

static void plain_finish(struct plain *p)
{
    free(p->matrix);
    free(p->mosaic);
    free(p->rgb);
    free(p->row);
    free(p->out);
}

/* ---- rows ---- */

/* Seconds that the input's bytes, of the lights and @n_ratios maps of ratios, and the sums'
 * multiply-adds cannot do without. */
static double roofline_s(const struct setting *s, uint32_t n_ratios, const struct bench_task *read,
                         const struct bench_task *fma, uint64_t fma_done)
{
    double done = 0, pixels = (double)s->pixels, adds = pixels * s->take->n_lights * SPECTRA;
    for (uint32_t i = 0; i < s->take->n_lights; i++)
        done += (double)s->take->file[i].bytes;
    double bytes = pixels * (2.0 * s->take->n_lights + 3.0 * sizeof *s->ratio * n_ratios);
    return fmax(read->best_s * bytes / done, adds / ((double)fma_done / fma->best_s));
}

static void print(const struct setting *s, const char *name, const struct bench_task *task,
                  double error, const char *reference, double reference_s, double wanted)
{
    bench_row(s->bench, &(struct bench_row){.name = name,
                                            .unit = "s",
                                            .value = task->best_s,
                                            .median = task->median_s,
                                            .error = error,
                                            .reference = reference,
                                            .reference_value = reference_s,
                                            .ratio = reference_s / task->best_s,
                                            .wanted = wanted});
}

static double stored(const struct setting *s, uint32_t light, uint32_t x, uint32_t y)
{
    uint16_t half;
    uint32_t tile = y / 64 * ls_field_tiles_x(&s->take->field) + x / 64;
    memcpy(&half, (const char *)s->take->white[light].tiles[tile] + (y % 64 * 64 + x % 64) * 2, 2);
    return (double)ls_half_to_float(half);
}

/* Largest error of some sums, relative to the sum of magnitudes, against double. */
static double error_of_sums(const struct setting *s)
{
    const struct ls_field *field = &s->take->field;
    double worst = 0;
    float *sums = bench_alloc((size_t)SPECTRA * 64 * 64 * sizeof *sums);
    struct ls_tile_region tile = {1, 1, 2, 2};
    struct ls_accumulate_job job = {.pictures = field->white,
                                    .n_pictures = field->n_lights,
                                    .n_sums = SPECTRA,
                                    .weights = s->weights};
    if (ls_accumulate(field, &job, &tile, sums, NULL, NULL))
        abort();
    for (uint32_t q = 0; q < SPECTRA; q++)
        for (uint32_t j = 0; j < 64 * 64; j += 7) {
            double sum = 0, size = 0;
            for (uint32_t i = 0; i < field->n_lights; i++) {
                double term = (double)s->weights[q * field->n_lights + i] *
                              stored(s, i, 64 + j % 64, 64 + j / 64);
                sum += term;
                size += fabs(term);
            }
            worst = fmax(worst, fabs((double)sums[q * 64 * 64 + j] - sum) / size);
        }
    free(sums);
    return worst;
}

/* The daemon's picture, under the weights of @picture, must be what the bench's own loop makes of
 * its ratios: the same bits. */
static void check_relit(const struct setting *s, const struct bench_relit *relit,
                        const struct bench_relight *picture)
{
    struct bench_relight again = *picture;
    struct bench_relit kept = *relit;
    size_t n = s->pixels * 3, k = 0;
    kept.out = bench_alloc(n * sizeof *kept.out);
    bench_relit(&kept);
    for (uint32_t q = 1; q < SPECTRA; q++)
        again.ratio[q] = bench_served_ratio(relit->served, q);
    bench_relight(&again);
    while (k < n && kept.out[k] == again.out[k])
        k++;
    if (k < n) {
        fprintf(stderr, "the daemon's picture differs at value %zu: %g, not %g\n", k,
                (double)kept.out[k], (double)again.out[k]);
        exit(1);
    }
    free(kept.out);
}

static void one(const struct setting *s)
{
    struct bench_relight picture = relight_of(s), sums = picture, linear = picture;
    struct reference_fma fma = {ls_cpu_isa(), THREADS, bench_size(s->bench, 1u << 22, 1u << 10), 0,
                                0};
    struct plain plain;
    const uint32_t lights = s->take->n_lights;
    double *weights = bench_alloc(sizeof *weights * SPECTRA * lights);
    float *gained = bench_alloc(sizeof *gained * SPECTRA * lights);
    struct bench_relit relit = {bench_served_create(s->take), THREADS, weights, NULL};
    for (uint32_t k = 0; k < SPECTRA * lights; k++)
        weights[k] = (double)s->weights[k];
    for (uint32_t q = 0; q < SPECTRA; q++)
        ls_relight_row(s->take->k, weights + q * lights, lights, gained + q * lights);
    picture.weights = gained;
    plain_init(&plain, s);
    sums.out = NULL;
    for (uint32_t q = 1; q < SPECTRA; q++) {
        picture.ratio[q] = s->ratio + (q - 1) * s->pixels * 3;
        linear.matrix[q] = s->matrix + (q - 1) * s->pixels * 9;
    }
    malloc_trim(0); /* what making the take left behind is not counted */
    double before = bench_anonymous_mib();
    struct bench_task tasks[] = {
        {.name = "read the files", .run = read_files, .data = (void *)(uintptr_t)s},
        {.name = "fma, 2 threads", .run = reference_fma, .data = &fma},
        {.name = "six sums", .run = bench_relight, .data = &sums},
        {.name = "a picture", .run = bench_relight, .data = &picture},
        {.name = "a picture by matrices", .run = bench_relight, .data = &linear},
        {.name = "plainly, 1/16", .run = plain_sixteenth, .data = &plain},
        {.name = "a picture by the daemon", .run = bench_relit, .data = &relit}};
    bench_time(s->bench, tasks, 7);
    check_relit(s, &relit, &picture);
    double lights_s = roofline_s(s, 0, &tasks[0], &tasks[1], fma.done);
    double limit_s = roofline_s(s, SPECTRA - 1, &tasks[0], &tasks[1], fma.done);
    double error = error_of_sums(s);
    print(s, "relight_one", &tasks[3], error, "roofline of reading lights and ratios", limit_s,
          0.6);
    print(s, "relight_daemon", &tasks[6], error, "roofline of reading lights and ratios", limit_s,
          0.6);
    print(s, "relight_one_sums", &tasks[2], error, "roofline of reading lights", lights_s, NAN);
    print(s, "relight_one_plainly", &tasks[3], error, "materialise + sgemm, 1/16 scaled",
          16 * tasks[5].best_s, 20);
    bench_row(s->bench, &(struct bench_row){.name = "relight_linear",
                                            .unit = "s",
                                            .value = tasks[4].best_s,
                                            .median = tasks[4].median_s,
                                            .error = error,
                                            .reference = "relight_one",
                                            .reference_value = tasks[3].best_s,
                                            .ratio = tasks[4].best_s / tasks[3].best_s,
                                            .wanted = 1.3,
                                            .at_most = true});
    /* with what the calls allocate */
    double used = fmax(picture.anonymous_mib, linear.anonymous_mib) - before;
    bench_row(s->bench, &(struct bench_row){.name = "relight_memory",
                                            .unit = "MiB",
                                            .value = used,
                                            .median = used,
                                            .error = NAN,
                                            .reference = "ceiling beside files and output",
                                            .reference_value = CEILING_MIB,
                                            .ratio = used / CEILING_MIB,
                                            .wanted = 1,
                                            .at_most = true});
    plain_finish(&plain);
    bench_served_destroy(relit.served);
    free(weights);
    free(gained);
}

/* A quarter of the picture: enough to leave the caches. */
static void many(const struct setting *s)
{
    struct ls_field quarter = s->take->field;
    quarter.height = (uint32_t)bench_size(s->bench, quarter.height / 4, quarter.height);
    struct bench_relight sums = relight_of(s);
    sums.field = &quarter;
    sums.n_sums = ENVIRONMENTS * SPECTRA;
    sums.out = NULL;
    struct reference_fma fma = {ls_cpu_isa(), THREADS, bench_size(s->bench, 1u << 22, 1u << 10), 0,
                                0};
    struct bench_task tasks[] = {{.name = "fma, 2 threads", .run = reference_fma, .data = &fma},
                                 {.name = "144 sums", .run = bench_relight, .data = &sums}};
    bench_time(s->bench, tasks, 2);
    double adds = (double)quarter.width * quarter.height * s->take->n_lights * sums.n_sums;
    double at_peak_s = adds / ((double)fma.done / tasks[0].best_s);
    print(s, "relight_many", &tasks[1], error_of_sums(s), "multiply-add peak", at_peak_s, 0.6);
}

int main(int argc, char **argv)
{
    struct bench bench;
    struct setting setting;
    bench_init(&bench, argc, argv);
    setting_init(&setting, &bench);
    one(&setting);
    many(&setting);
    setting_finish(&setting);
    return 0;
}
