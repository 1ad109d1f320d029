/* Fitting the matrices of the linear model (core/linear.h): what the first picture asked for by it
 * waits for. One core, in memory: G = 14 segments of RGB, as demosaiced. */
#include "core/linear.h"
#include "tests/bench/bench.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

enum { SEGMENTS = 14, COLOURS = 3, STEP = 5 };
static const double frame_px = 5 * 4e6, wanted_s = 10; /* five spectra of 4 Mpx */

struct setting {
    uint32_t width, height;
    const float *v[SEGMENTS], *f[SEGMENTS];
    struct ls_linear_noise noise[SEGMENTS];
    struct ls_linear_pictures pictures;
    struct ls_linear_options options;
    struct ls_linear_error error;
    float *m;
};

static float *picture(uint32_t width, uint32_t height, uint32_t g, float scale)
{
    size_t n = (size_t)width * height * COLOURS;
    float *out = bench_alloc(n * sizeof *out);
    for (size_t j = 0; j < n; j++) {
        double x = (double)(j / COLOURS % width), c = (double)(j % COLOURS);
        double a = 0.5 + 0.4 * sin(0.01 * x + g + 0.7 * c);
        out[j] = scale * (float)(a * (1 + 0.002 * (double)(j * 7919 % 101)));
    }
    return out;
}

static void setting_init(struct setting *s, const struct bench *bench)
{
    static const double p_in[COLOURS] = {0.8, 1, 0.7}, p_out[COLOURS] = {0.9, 0.3, 0.05};
    *s = (struct setting){.width = (uint32_t)bench_size(bench, 1024, 96),
                          .height = (uint32_t)bench_size(bench, 128, 24)};
    for (uint32_t g = 0; g < SEGMENTS; g++) {
        s->v[g] = picture(s->width, s->height, g, 1);
        s->f[g] = picture(s->width, s->height, g + 3, 0.5f);
        s->noise[g] = (struct ls_linear_noise){1e-6, 1e-5};
    }
    s->pictures = (struct ls_linear_pictures){.width = s->width,
                                              .height = s->height,
                                              .n_segments = SEGMENTS,
                                              .n_lights = 346,
                                              .n_in = COLOURS,
                                              .n_out = COLOURS,
                                              .v = s->v,
                                              .f = s->f,
                                              .v_noise = s->noise,
                                              .f_noise = s->noise,
                                              .total_noise = {1e-5, 1e-5},
                                              .p_in = p_in,
                                              .p_out = p_out,
                                              .inputs = {0, 1, 2},
                                              .demosaiced = true};
    s->m = bench_alloc(sizeof(float) * s->width * s->height * COLOURS * COLOURS);
    ls_linear_options_default(&s->options);
}

static void setting_finish(struct setting *s)
{
    for (uint32_t g = 0; g < SEGMENTS; g++) {
        free((void *)s->v[g]);
        free((void *)s->f[g]);
    }
    free(s->m);
}

static void stop(enum ls_err err, const struct ls_diag *diag)
{
    if (!err)
        return;
    fprintf(stderr, "%s\n", diag->text);
    exit(1);
}

static void fit(void *data)
{
    struct setting *s = data;
    struct ls_diag diag = {""};
    const struct ls_linear_part part = {.width = s->width, .height = s->height, .out = s->m};
    stop(ls_linear_fit(&s->pictures, &s->options, &part, &diag), &diag);
}

static void leave_out(void *data)
{
    struct setting *s = data;
    struct ls_diag diag = {""};
    const struct ls_linear_part part = {
        .width = s->width, .height = s->height, .step = STEP, .error = &s->error};
    stop(ls_linear_fit(&s->pictures, &s->options, &part, &diag), &diag);
}

static void print(const struct bench *bench, const struct setting *s, const char *name,
                  const struct bench_task *task, double wanted)
{
    double scale = frame_px / ((double)s->width * s->height);
    bench_row(bench, &(struct bench_row){.name = name,
                                         .unit = "s",
                                         .value = task->best_s * scale,
                                         .median = task->median_s * scale,
                                         .error = NAN,
                                         .reference = "10 s for five spectra of 4 Mpx",
                                         .reference_value = wanted_s,
                                         .ratio = wanted_s / (task->best_s * scale),
                                         .wanted = wanted});
}

int main(int argc, char **argv)
{
    struct bench bench;
    struct setting s;
    bench_init(&bench, argc, argv);
    setting_init(&s, &bench);
    struct bench_task tasks[] = {{.name = "linear fit", .run = fit, .data = &s},
                                 {.name = "leave one out", .run = leave_out, .data = &s}};
    bench_time(&bench, tasks, 2);
    print(&bench, &s, "linear_fit", &tasks[0], 1);
    print(&bench, &s, "linear_leave_one_out", &tasks[1], NAN);
    setting_finish(&s);
    return 0;
}
