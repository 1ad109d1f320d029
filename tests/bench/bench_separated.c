/* Relighting a polarised field: every light's specular part demosaiced and judged, six spectra. Two
 * threads, from mapped files to sums in RGB. */
#include "core/separated_kernels.h"
#include "tests/bench/references.h"
#include "tests/bench/relight.h"
#include "tests/bench/take.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { SPECTRA = 6, THREADS = 2 };

struct setting {
    const struct bench *bench;
    struct bench_take *take; /* V of every light, then H of every light */
    uint32_t n_lights;
    struct ls_split *split;
    float *weights, *both; /* [SPECTRA][n_lights]; for V and H, as Eq. 1 would have it */
    struct ls_separated_field field;
    const struct ls_separated_kernels *kernels;
    float *out[3];
};

static void setting_init(struct setting *s, const struct bench *bench)
{
    const double white[3] = {0.8, 1, 0.6};
    uint32_t size = (uint32_t)bench_size(bench, 768, 128);
    uint32_t n = (uint32_t)bench_size(bench, 346, 20);
    size_t bytes = sizeof(float) * SPECTRA * size * size * 3;
    *s = (struct setting){.bench = bench, .n_lights = n};
    s->take = bench_take_create(2 * n, SPECTRA, size);
    s->split = bench_alloc(n * sizeof *s->split);
    s->weights = bench_alloc(sizeof(float) * SPECTRA * n);
    s->both = bench_alloc(sizeof(float) * SPECTRA * 2 * n);
    for (int k = 0; k < 3; k++)
        s->out[k] = bench_alloc(bytes);
    for (uint32_t i = 0; i < n; i++) {
        double a = 0.75 + 0.25 * (i % 16) / 16;
        if (ls_split_make((struct ls_polarisation){a, 1 - a}, 1, 1, &s->split[i], NULL))
            abort();
        for (uint32_t q = 0; q < SPECTRA; q++) {
            float w = 0.01f + 0.001f * (float)((7 * i + q) % 10);
            s->weights[q * n + i] = w;
            s->both[q * 2 * n + i] = s->both[q * 2 * n + n + i] = w;
        }
    }
    s->field = (struct ls_separated_field){.n_lights = n,
                                           .n_channels = 3,
                                           .width = size,
                                           .height = size,
                                           .cfa = s->take->field.cfa,
                                           .v = s->take->white,
                                           .h = s->take->white + n,
                                           .split = s->split,
                                           .noise = {1e-6, 1e-7, 1e-5}};
    if (ls_conductor_make(white, LS_CONDUCTOR_THRESHOLD, false, &s->field.conductor, NULL))
        abort();
}

static void setting_finish(struct setting *s)
{
    free(s->split);
    free(s->weights);
    free(s->both);
    for (int k = 0; k < 3; k++)
        free(s->out[k]);
    bench_take_destroy(s->take);
}

/* Rows of tiles, an equal share for each thread; sums of a share lie at its own part of the room.
 */
static void run_share(void *data, unsigned thread, unsigned n)
{
    const struct setting *s = data;
    uint32_t height = s->field.height, y0 = height * thread / n / 64 * 64;
    uint32_t y1 = thread + 1 == n ? height : height * (thread + 1) / n / 64 * 64;
    size_t at = (size_t)y0 * s->field.width * 3 * SPECTRA;
    struct ls_separated_job job = {.field = &s->field,
                                   .n_rows = SPECTRA,
                                   .weights = s->weights,
                                   .region = {0, y0, s->field.width, y1 - y0}};
    struct ls_diag diag = {""};
    if (ls_separated_accumulate_with(s->kernels, &job, s->out[0] + at, s->out[1] + at,
                                     s->out[2] ? s->out[2] + at : NULL, NULL, &diag)) {
        fprintf(stderr, "%s\n", diag.text);
        exit(1);
    }
}

static void separated(void *data)
{
    bench_parallel(THREADS, run_share, data);
}

static void print(const struct setting *s, const char *name, const struct bench_task *task,
                  const char *reference, double reference_s)
{
    bench_row(s->bench, &(struct bench_row){.name = name,
                                            .unit = "s",
                                            .value = task->best_s,
                                            .median = task->median_s,
                                            .error = NAN,
                                            .reference = reference,
                                            .reference_value = reference_s,
                                            .ratio = reference_s / task->best_s,
                                            .wanted = NAN});
}

int main(int argc, char **argv)
{
    struct bench bench;
    struct setting s;
    bench_init(&bench, argc, argv);
    setting_init(&s, &bench);
    s.kernels = ls_separated_kernels(ls_cpu_isa());
    struct setting dielectric = s;
    dielectric.out[2] = NULL;
    struct bench_relight plain = {
        .field = &s.take->field, .n_threads = THREADS, .n_sums = SPECTRA, .weights = s.both};
    struct reference_fma fma = {ls_cpu_isa(), THREADS, bench_size(&bench, 1u << 22, 1u << 10), 0,
                                0};
    struct bench_task tasks[] = {
        {.name = "fma, 2 threads", .run = reference_fma, .data = &fma},
        {.name = "six sums of V and H", .run = bench_relight, .data = &plain},
        {.name = "separated, all dielectric", .run = separated, .data = &dielectric},
        {.name = "separated", .run = separated, .data = &s}};
    bench_time(&bench, tasks, 4);
    /* D, S and three colours of conductor, for each light, spectrum and pixel */
    double adds = 5.0 * SPECTRA * s.n_lights * s.field.width * s.field.height;
    print(&s, "relight_separated", &tasks[3], "six sums of V and H, as Eq. 1", tasks[1].best_s);
    print(&s, "relight_separated_dielectric", &tasks[2], "six sums of V and H, as Eq. 1",
          tasks[1].best_s);
    print(&s, "relight_separated_peak", &tasks[3], "its multiply-adds at their peak",
          adds / ((double)fma.done / tasks[0].best_s));
    setting_finish(&s);
    return 0;
}
