/* Three exposures of 4 Mpixel, 8 bits, with darks, to halves; beside it the float merge of OpenCV.
 */
#include "tests/bench/against_copy.h"

#include "tests/core/merge_cases.h"

#include <stdio.h>

enum { EXPOSURES = 3 };

struct pictures {
    struct image image;
    uint16_t *half;
};

/* A lit subject before a dark ground: radiance over four decades, some of it too bright. */
static void shoot(struct image *image)
{
    struct noise noise = {1};
    double scale = ls_pixel_max_dn(image->p.format) / 255.0;
    for (size_t k = 0; k < image->n; k++) {
        double x = (double)(k % image->p.width) / image->p.width;
        double signal = 8 * pow(10, 3 * fabs(sin(9 * x)) - 1);
        for (int i = 0; i < EXPOSURES; i++) {
            double dn = signal * image->p.exposure_s[i] / image->p.exposure_s[0];
            dn += 8 + sqrt(0.64 + dn / 40) * (2 * noise_uniform(&noise) - 1);
            image->dn[i][k] = (uint16_t)(scale * fmin(255, fmax(0, dn)) + 0.5);
            image->dark[i][k] = (float)(scale * (8 + 0.1 * noise_uniform(&noise)));
        }
    }
    image_pack(image);
}

static void merge(void *data)
{
    struct pictures *p = data;
    struct ls_merge_spans s = image_spans(&p->image);
    s.e = s.variance = NULL;
    s.half = p->half;
    ls_merge_rows(&p->image.p, &s, 0, p->image.p.height);
}

/* Of E, as merge.h says what it is relative to. */
static double error_of(struct pictures *p)
{
    struct image *image = &p->image;
    long double largest = 0;
    image_merge(image);
    for (size_t k = 0; k < image->n; k += 13) {
        uint16_t x[EXPOSURES];
        float d[EXPOSURES];
        for (int i = 0; i < EXPOSURES; i++) {
            x[i] = image->dn[i][k];
            d[i] = image->dark[i][k];
        }
        struct reference r = reference_merge(&image->p, x, d);
        if (!r.borderline && r.scale > 0)
            largest = fmaxl(largest, fabsl((long double)image->e[k] - r.e) / r.scale);
    }
    return (double)largest;
}

/* Seconds per merge that a program prints for a picture of @width x @width; NAN where it has no
 * OpenCV or NumPy. Best of its rounds. */
static double other_s(const char *what, uint32_t width)
{
    char command[512];
    double best = NAN, s;
    snprintf(command, sizeof command, "/usr/bin/python3 -B '%s/merge_opencv.py' %s %u",
             BENCH_SOURCE, what, width);
    FILE *program = popen(command, "r");
    while (program && fscanf(program, "%lf", &s) == 1)
        best = fmin(best, s);
    if (program)
        pclose(program);
    return best;
}

static void other_row(const struct bench *bench, struct pictures *p, const char *name,
                      const char *what, const char *reference, double wanted)
{
    struct bench_task task = {.name = "merge", .run = merge, .data = p};
    double mpx = (double)p->image.n * 1e-6, theirs = other_s(what, p->image.p.width);
    bench_time(bench, &task, 1);
    bench_row(bench, &(struct bench_row){.name = name,
                                         .unit = "Mpx/s",
                                         .value = mpx / task.best_s,
                                         .median = mpx / task.median_s,
                                         .error = NAN,
                                         .reference = reference,
                                         .reference_value = mpx / theirs,
                                         .ratio = theirs / task.best_s,
                                         .wanted = wanted});
}

static void pictures_init(struct pictures *p, const char *format, uint32_t width)
{
    static const double bracket[EXPOSURES] = {0.001, 0.004, 0.016};
    struct ls_merge_params params = params_for(format, width, width, EXPOSURES, bracket);
    params.reference_exposure_s = bracket[1];
    image_init(&p->image, &params);
    p->half = bench_alloc(p->image.n * sizeof *p->half);
    shoot(&p->image);
}

static void pictures_finish(struct pictures *p)
{
    image_finish(&p->image);
    free(p->half);
}

static void speed(const struct bench *bench, struct pictures *p, const char *name, double wanted)
{
    double raw = (double)p->image.bytes / (double)p->image.n;
    const struct against_copy row = {
        .name = name,
        .run = merge,
        .data = p,
        .bytes = (double)p->image.n * (EXPOSURES * (raw + 4) + 2 + 1), /* dark; half, validity */
        .error = error_of(p),
        .wanted = wanted,
    };
    against_copy_rows(bench, &row, 1);
}

int main(int argc, char **argv)
{
    static const struct {
        const char *name, *format;
    } packings[] = {{"merge_16_bits", "BayerRG12"},
                    {"merge_12p", "BayerRG12p"},
                    {"merge_12_packed", "BayerRG12Packed"}};
    struct bench bench;
    bench_init(&bench, argc, argv);
    uint32_t width = (uint32_t)bench_size(&bench, 2048, 64);
    struct pictures p;
    pictures_init(&p, "BayerRG8", width);
    speed(&bench, &p, "merge", 0.4);
    other_row(&bench, &p, "merge_beside_debevec", "debevec", "OpenCV MergeDebevec, 1 thread", 20);
    other_row(&bench, &p, "merge_beside_weighted", "weighted", "OpenCV weighted mean, 1 thread",
              NAN);
    pictures_finish(&p);
    for (size_t k = 0; k < G_N_ELEMENTS(packings); k++) {
        pictures_init(&p, packings[k].format, width);
        speed(&bench, &p, packings[k].name, NAN);
        pictures_finish(&p);
    }
    return 0;
}
