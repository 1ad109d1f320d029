/* Mosaic to RGB, 4 Mpixel, against a copy of as many bytes; and what each way costs and errs, on a
 * scene whose colours are known. */
#include "tests/bench/against_copy.h"

#include "core/demosaic.h"
#include "core/half.h"

#include <stdio.h>
#include <string.h>

struct pictures {
    uint32_t width;
    size_t n;
    float *mosaic, *rgb;
    uint16_t *half, *half_rgb;
};

struct way {
    struct pictures *pictures;
    enum ls_demosaic_method method;
    bool half, woven;
};

/* Detail that all colours share, down to three pixels a period, colours that vary slowly, and
 * edges. */
static double scene(unsigned c, double x, double y)
{
    double detail = 0.15 * sin(0.9 * x + 0.3 * y) * sin(0.002 * x) + 0.1 * sin(2.1 * y - 0.2 * x);
    double edge = sin(0.05 * x) * sin(0.04 * y) > 0.5 ? 0.4 : 0;
    return (0.5 + detail + edge) * (1 + 0.3 * sin(0.01 * x + 2.0 * c) * cos(0.013 * y));
}

static void make(struct pictures *p)
{
    p->mosaic = bench_alloc(4 * p->n);
    p->rgb = bench_alloc(12 * p->n);
    p->half = bench_alloc(2 * p->n);
    p->half_rgb = bench_alloc(6 * p->n);
    for (uint32_t y = 0; y < p->width; y++)
        for (uint32_t x = 0; x < p->width; x++)
            p->mosaic[(size_t)y * p->width + x] =
                (float)scene(ls_cfa_channel(LS_CFA_RGGB, x, y), x, y);
    ls_half_from_floats(p->mosaic, p->half, p->n);
}

static void demosaic(void *data)
{
    const struct way *way = data;
    struct pictures *p = way->pictures;
    struct ls_demosaic_region all = {0, 0, p->width, p->width};
    struct ls_demosaic_source s = {.data = way->half ? NULL : p->mosaic,
                                   .half = way->half ? p->half : NULL,
                                   .stride = p->width,
                                   .window = all,
                                   .image_width = p->width,
                                   .image_height = p->width,
                                   .cfa = LS_CFA_RGGB};
    size_t step = way->woven ? 3 : 1, apart = way->woven ? 1 : p->n;
    struct ls_demosaic_target t = {.pixel_step = step, .row_step = step * p->width};
    for (size_t c = 0; c < 3; c++) {
        t.plane[c] = way->half ? NULL : p->rgb + c * apart;
        t.half[c] = way->half ? p->half_rgb + c * apart : NULL;
    }
    if (ls_demosaic(&s, all, way->method, &t))
        abort();
}

static double result(const struct way *way, unsigned c, size_t k)
{
    const struct pictures *p = way->pictures;
    size_t at = way->woven ? 3 * k + c : c * p->n + k;
    return (double)(way->half ? ls_half_to_float(p->half_rgb[at]) : p->rgb[at]);
}

/* Root mean square of the difference from the scene, relative to its own. */
static double scene_error(struct way *way)
{
    double square = 0, reference = 0;
    uint32_t width = way->pictures->width;
    demosaic(way);
    for (uint32_t y = 2; y + 2 < width; y++)
        for (uint32_t x = 2; x + 2 < width; x++)
            for (unsigned c = 0; c < 3; c++) {
                double truth = scene(c, x, y);
                double d = result(way, c, (size_t)y * width + x) - truth;
                square += d * d;
                reference += truth * truth;
            }
    return sqrt(square / reference);
}

/* Green at the red and blue pixels, in double; what of it the result differs, relative to 1, which
 * no sample exceeds by much. */
static double rounding_error(struct way *way)
{
    const struct pictures *p = way->pictures;
    double largest = 0;
    demosaic(way);
    for (uint32_t y = 2; y + 2 < p->width; y += 3)
        for (uint32_t x = 2 + y % 2; x + 2 < p->width; x += 2) {
            size_t k = (size_t)y * p->width + x, row = p->width;
            double m[25];
            for (size_t j = 0; j < 25; j++) {
                size_t at = k + (j / 5) * row + j % 5 - 2 * row - 2;
                m[j] = (double)(way->half ? ls_half_to_float(p->half[at]) : p->mosaic[at]);
            }
            double near = m[7] + m[11] + m[13] + m[17], far = m[2] + m[10] + m[14] + m[22];
            double exact =
                way->method == LS_DEMOSAIC_GRADIENT ? near / 4 + (m[12] - far / 4) / 2 : near / 4;
            largest = fmax(largest, fabs(result(way, 1, k) - exact));
        }
    return largest;
}

static void speed(const struct bench *bench, struct pictures *p)
{
    struct way ways[] = {{p, LS_DEMOSAIC_GRADIENT, true, true},
                         {p, LS_DEMOSAIC_GRADIENT, true, false},
                         {p, LS_DEMOSAIC_BILINEAR, true, true},
                         {p, LS_DEMOSAIC_GRADIENT, false, true}};
    static const char *const names[] = {"demosaic", "demosaic_planes", "demosaic_bilinear",
                                        "demosaic_float"};
    struct against_copy rows[4];
    for (int k = 0; k < 4; k++)
        rows[k] = (struct against_copy){.name = names[k],
                                        .run = demosaic,
                                        .data = &ways[k],
                                        .bytes = (double)p->n * (ways[k].half ? 8 : 16),
                                        .error = rounding_error(&ways[k]),
                                        .wanted = k == 0 ? 0.25 : NAN};
    against_copy_rows(bench, rows, 4);
}

/* Time against error: a point for each way. */
static void points(const struct bench *bench, struct pictures *p)
{
    struct way ways[4];
    struct bench_task tasks[4];
    static const char *const names[] = {"picture_gradient_half", "picture_gradient_float",
                                        "picture_bilinear_half", "picture_bilinear_float"};
    for (int k = 0; k < 4; k++) {
        ways[k] =
            (struct way){p, k < 2 ? LS_DEMOSAIC_GRADIENT : LS_DEMOSAIC_BILINEAR, k % 2 == 0, true};
        tasks[k] = (struct bench_task){.name = names[k], .run = demosaic, .data = &ways[k]};
    }
    bench_time(bench, tasks, 4);
    for (int k = 0; k < 4; k++)
        bench_row(bench, &(struct bench_row){.name = names[k],
                                             .unit = "s",
                                             .value = tasks[k].best_s,
                                             .median = tasks[k].median_s,
                                             .error = scene_error(&ways[k]),
                                             .reference = "the scene",
                                             .reference_value = NAN,
                                             .ratio = NAN,
                                             .wanted = NAN});
}

int main(int argc, char **argv)
{
    struct bench bench;
    bench_init(&bench, argc, argv);
    struct pictures p = {.width = (uint32_t)bench_size(&bench, 2048, 64)};
    p.n = (size_t)p.width * p.width;
    make(&p);
    speed(&bench, &p);
    points(&bench, &p);
    free(p.mosaic);
    free(p.rgb);
    free(p.half);
    free(p.half_rgb);
    return 0;
}
