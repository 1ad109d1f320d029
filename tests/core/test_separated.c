/* Sums of a polarised field: against double, over every instruction set, split in any way. */
#include "core/half.h"
#include "core/separated_kernels.h"

#include "tests/core/isas.h"
#include "tests/core/noise.h"

#include <float.h>
#include <math.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

enum { LIGHTS = 19, ROWS = 8, KINDS = 2 };

struct fixture {
    struct ls_separated_field field;
    uint32_t tiles_x, n_tiles;
    uint8_t *bytes; /* odd addresses on purpose */
    const void **tiles;
    struct ls_picture pictures[KINDS][LIGHTS];
    struct ls_split split[LIGHTS];
    float weights[ROWS][LIGHTS];
    double *plain[KINDS]; /* [light][pixel] as floats of the halves, not finite as 0 */
    uint32_t hostile;     /* samples that are not finite */
    float *max[KINDS];    /* [tile][light], once found */
    double max_error;     /* of the sums that run makes */
};

static const double white[3] = {0.8, 1, 0.6};

/* Every fifth light is dark: half of them so that no share of conductor passes the gate anywhere,
 * half a little brighter. */
static uint16_t draw(struct fixture *f, struct noise *noise, uint32_t light, bool hostile)
{
    static const uint16_t bad[] = {0x7c00, 0xfc00, 0x7e01, 0x7bff, 0xfbff, 1, 0x8001, 0x8000};
    if (hostile && noise_bits(noise) % 16 == 0) {
        uint16_t bits = bad[noise_bits(noise) % G_N_ELEMENTS(bad)];
        f->hostile += (bits & 0x7c00) == 0x7c00;
        return bits;
    }
    double level = light % 5 == 1 ? (light % 2 ? 1e-3 : 6e-2) : 1;
    return ls_half_from_float((float)(level * (0.1 * noise_normal(noise) + noise_uniform(noise))));
}

static void fill_tile(struct fixture *f, struct noise *noise, uint32_t kind, uint32_t light,
                      uint32_t tile, bool hostile, uint8_t *to)
{
    uint32_t x0 = tile % f->tiles_x * LS_TILE_SIDE, y0 = tile / f->tiles_x * LS_TILE_SIDE;
    uint32_t w = MIN(LS_TILE_SIDE, f->field.width - x0),
             h = MIN(LS_TILE_SIDE, f->field.height - y0);
    size_t n_px = (size_t)f->field.width * f->field.height;
    for (uint32_t j = 0; j < w * h; j++) {
        uint16_t bits = draw(f, noise, light, hostile);
        float value = ls_half_to_float(bits);
        memcpy(to + 2 * (size_t)j, &bits, 2);
        f->plain[kind][light * n_px + (y0 + j / w) * f->field.width + x0 + j % w] =
            isfinite(value) ? (double)value : 0;
    }
}

static void fixture_init(struct fixture *f, uint32_t width, uint32_t height, enum ls_cfa cfa,
                         bool hostile, uint64_t seed)
{
    struct noise noise = {.state = seed};
    size_t n_px = (size_t)width * height;
    *f = (struct fixture){.field = {.n_lights = LIGHTS,
                                    .n_channels = cfa == LS_CFA_NONE ? 1 : 3,
                                    .width = width,
                                    .height = height,
                                    .cfa = cfa,
                                    .noise = {1e-5, 1e-6, 1e-4}}};
    f->tiles_x = (width + LS_TILE_SIDE - 1) / LS_TILE_SIDE;
    f->n_tiles = f->tiles_x * ((height + LS_TILE_SIDE - 1) / LS_TILE_SIDE);
    size_t tile_bytes = 2 * LS_TILE_SIDE * LS_TILE_SIDE + 1;
    f->bytes = g_malloc(KINDS * LIGHTS * f->n_tiles * tile_bytes);
    f->tiles = g_new0(const void *, KINDS *LIGHTS * f->n_tiles);
    for (uint32_t kind = 0; kind < KINDS; kind++) {
        f->plain[kind] = g_new0(double, LIGHTS *n_px);
        for (uint32_t i = 0; i < LIGHTS; i++) {
            size_t first = (size_t)(kind * LIGHTS + i) * f->n_tiles;
            f->pictures[kind][i].tiles = f->tiles + first;
            for (uint32_t t = 0; t < f->n_tiles; t++) {
                if (i % 5 == 3 && (t + kind) % 2)
                    continue; /* nothing stored */
                uint8_t *to = f->bytes + (first + t) * tile_bytes;
                f->tiles[first + t] = to;
                fill_tile(f, &noise, kind, i, t, hostile, to);
            }
        }
    }
    for (uint32_t i = 0; i < LIGHTS; i++) {
        struct ls_polarisation a = {i == 4 ? 0.55 : 0.8 + 0.2 * noise_uniform(&noise), 0};
        a.h = 1 - a.v;
        g_assert_cmpint(
            ls_split_make(a, 0.9 + 0.2 * noise_uniform(&noise), 1.1, &f->split[i], NULL), ==,
            LS_OK);
        for (uint32_t q = 0; q < ROWS; q++)
            f->weights[q][i] = i == 7 ? 0 : (float)noise_normal(&noise);
    }
    f->field.v = f->pictures[0];
    f->field.h = f->pictures[1];
    f->field.split = f->split;
    g_assert_cmpint(ls_conductor_make(white, 0.3, false, &f->field.conductor, NULL), ==, LS_OK);
}

static void fixture_finish(struct fixture *f)
{
    g_free(f->bytes);
    g_free(f->tiles);
    for (uint32_t kind = 0; kind < KINDS; kind++) {
        g_free(f->plain[kind]);
        g_free(f->max[kind]);
    }
}

struct sums {
    size_t n;
    float *d, *s, *c;
};

static struct sums sums_new(const struct fixture *f, struct ls_demosaic_region r)
{
    struct sums out = {.n = (size_t)ROWS * r.width * r.height * f->field.n_channels};
    out.d = g_new0(float, out.n);
    out.s = g_new0(float, out.n);
    out.c = g_new0(float, out.n);
    return out;
}

static void sums_free(struct sums *s)
{
    g_free(s->d);
    g_free(s->s);
    g_free(s->c);
}

static struct sums run(const struct fixture *f, enum ls_isa isa, struct ls_demosaic_region r,
                       struct ls_separated_report *report)
{
    struct ls_separated_job job = {.field = &f->field,
                                   .n_rows = ROWS,
                                   .weights = f->weights[0],
                                   .region = r,
                                   .max_error = f->max_error};
    struct sums out = sums_new(f, r);
    g_assert_cmpint(ls_separated_accumulate_with(ls_separated_kernels(isa), &job, out.d, out.s,
                                                 out.c, report, NULL),
                    ==, LS_OK);
    return out;
}

static void demosaic(const struct fixture *f, const float *mosaic, float *out)
{
    const struct ls_separated_field *g = &f->field;
    struct ls_demosaic_region all = {0, 0, g->width, g->height};
    struct ls_demosaic_source source = {mosaic, g->width, all, g->width, g->height, g->cfa};
    struct ls_demosaic_target target = {{out, out + 1, out + 2}, 3, 3 * (size_t)g->width};
    if (g->n_channels == 1)
        memcpy(out, mosaic, sizeof *out * g->width * g->height);
    else
        g_assert_cmpint(ls_demosaic(&source, all, LS_DEMOSAIC_GRADIENT, &target), ==, LS_OK);
}

/* Noise of S of the worst sample in the 2 x 2 cell right of and below a pixel. */
static double gate_sigma(const struct fixture *f, uint32_t light, uint32_t x, uint32_t y)
{
    const struct ls_separated_field *g = &f->field;
    double most = 0, v = (double)f->split[light].s_v, h = (double)f->split[light].s_h;
    for (uint32_t k = 0; k < 4; k++) {
        uint32_t i = x + k % 2, j = y + k / 2;
        i = i < g->width ? i : x ? x - 1 : 0;
        j = j < g->height ? j : y ? y - 1 : 0;
        size_t at = ((size_t)light * g->height + j) * g->width + i;
        double variance =
            v * v * (g->noise.read_variance + g->noise.shot * fmax(f->plain[0][at], 0)) +
            h * h * (g->noise.read_variance + g->noise.shot * fmax(f->plain[1][at], 0)) +
            (v + h) * (v + h) * g->noise.dark_variance;
        most = fmax(most, variance);
    }
    return sqrt(most) / 0.6;
}

static double gate(double snr)
{
    double q = fmin(1, fmax(0, (snr - 10) / 20));
    return q * q * (3 - 2 * q);
}

static double share_of(const float s[3], double sigma)
{
    double r = (double)s[0] / white[0], g = (double)s[1] / white[1], b = (double)s[2] / white[2];
    double m = fmax(fabs(r), fmax(fabs(g), fabs(b)));
    double a = g == 0 ? 1 : fmin(1, fabs(g - r) / (0.3 * fabs(g)));
    double o = b == 0 ? 1 : fmin(1, fabs(b - r) / (0.3 * fabs(b)));
    return gate(m / sigma) * (a + o) / 2;
}

/* sums[3][ROWS][pixels][channels] light by light in double, and what |error| may be of each pixel:
 * rounding of sums, and for the share 1e-5 of |S| wherever demosaicing moved S by an ulp. */
static void reference(const struct fixture *f, double *sums[3], double *size)
{
    const struct ls_separated_field *g = &f->field;
    size_t n_px = (size_t)g->width * g->height, n = n_px * g->n_channels;
    float *mosaic = g_new(float, n_px), *d = g_new(float, n), *s = g_new(float, n);
    for (uint32_t i = 0; i < LIGHTS; i++) {
        const double *v = f->plain[0] + i * n_px, *h = f->plain[1] + i * n_px;
        struct ls_split c = f->split[i];
        for (size_t k = 0; k < n_px; k++)
            mosaic[k] = (float)((double)c.d_v * v[k] + (double)c.d_h * h[k]);
        demosaic(f, mosaic, d);
        for (size_t k = 0; k < n_px; k++)
            mosaic[k] = (float)((double)c.s_v * v[k] + (double)c.s_h * h[k]);
        demosaic(f, mosaic, s);
        for (size_t k = 0; k < n; k++) {
            size_t px = k / g->n_channels;
            double share = g->n_channels == 1
                               ? 0
                               : share_of(s + 3 * px, gate_sigma(f, i, (uint32_t)(px % g->width),
                                                                 (uint32_t)(px / g->width)));
            size[0] = fmax(size[0], fabs((double)d[k]));
            size[0] = fmax(size[0], fabs((double)s[k]));
            for (uint32_t q = 0; q < ROWS; q++) {
                double w = (double)f->weights[q][i];
                sums[0][q * n + k] += w * (double)d[k];
                sums[1][q * n + k] += w * (double)s[k];
                sums[2][q * n + k] += w * share * (double)s[k];
            }
        }
    }
    g_free(mosaic);
    g_free(d);
    g_free(s);
}

static void compare(const struct fixture *f, enum ls_isa isa)
{
    struct ls_demosaic_region all = {0, 0, f->field.width, f->field.height};
    struct ls_separated_report report;
    struct sums found = run(f, isa, all, &report);
    double *sums[3], size = 0;
    for (int k = 0; k < 3; k++)
        sums[k] = g_new0(double, found.n);
    reference(f, sums, &size);
    /* 19 lights of weights up to about 4: sums of 8, the demosaic's 2e-6 on each */
    double bound = LIGHTS * 3 * size * 4e-6;
    for (size_t k = 0; k < found.n; k++) {
        g_assert_cmpfloat(fabs((double)found.d[k] - sums[0][k]), <=, bound);
        g_assert_cmpfloat(fabs((double)found.s[k] - sums[1][k]), <=, bound);
        /* the share's slope is 1/(2 t) per unit of a quotient, and steep in the gate */
        g_assert_cmpfloat(fabs((double)found.c[k] - sums[2][k]), <=, 20 * bound);
    }
    g_assert_cmpuint(report.tiles_read + report.tiles_skipped, ==, LIGHTS * f->n_tiles);
    for (int k = 0; k < 3; k++)
        g_free(sums[k]);
    sums_free(&found);
}

static const struct {
    uint32_t width, height;
    enum ls_cfa cfa;
} shapes[] = {{70, 67, LS_CFA_RGGB}, {64, 64, LS_CFA_GBRG}, {131, 20, LS_CFA_BGGR},
              {1, 1, LS_CFA_RGGB},   {2, 3, LS_CFA_GRBG},   {1, 40, LS_CFA_RGGB},
              {66, 1, LS_CFA_GRBG},  {70, 67, LS_CFA_NONE}, {3, 1, LS_CFA_NONE}};

static void test_reference(const void *data)
{
    for (size_t k = 0; k < G_N_ELEMENTS(shapes); k++) {
        struct fixture f;
        fixture_init(&f, shapes[k].width, shapes[k].height, shapes[k].cfa, false, 100 + k);
        compare(&f, isas_of(data));
        fixture_finish(&f);
    }
}

static void same(const float *a, const float *b, size_t n)
{
    g_assert_cmpint(memcmp(a, b, sizeof *a * n), ==, 0);
}

static void test_same_bits(const void *data)
{
    for (size_t k = 0; k < G_N_ELEMENTS(shapes); k++) {
        struct fixture f;
        fixture_init(&f, shapes[k].width, shapes[k].height, shapes[k].cfa, true, 200 + k);
        struct ls_demosaic_region all = {0, 0, f.field.width, f.field.height};
        struct ls_separated_report first, second;
        struct sums a = run(&f, LS_ISA_C, all, &first), b = run(&f, isas_of(data), all, &second);
        same(a.d, b.d, a.n);
        same(a.s, b.s, a.n);
        same(a.c, b.c, a.n);
        g_assert_cmpuint(first.not_finite, ==, second.not_finite);
        for (size_t j = 0; j < a.n; j++)
            g_assert_true(isfinite(a.d[j]) && isfinite(a.s[j]) && isfinite(a.c[j]));
        sums_free(&a);
        sums_free(&b);
        fixture_finish(&f);
    }
}

static void test_not_finite(void)
{
    struct fixture f;
    fixture_init(&f, 40, 14, LS_CFA_RGGB, true, 300);
    for (uint32_t q = 0; q < ROWS; q++)
        f.weights[q][7] = 1;
    struct ls_demosaic_region all = {0, 0, 40, 14};
    struct ls_separated_report report;
    struct sums a = run(&f, LS_ISA_C, all, &report);
    g_assert_cmpuint(f.hostile, >, 100);
    g_assert_cmpuint(report.not_finite, ==, f.hostile); /* one strip: each counted once */
    sums_free(&a);
    fixture_finish(&f);
}

/* Tiles that end, or begin, at a page nobody may read: a byte too many is a crash. */
static void test_guards(const void *data)
{
    size_t page = (size_t)sysconf(_SC_PAGESIZE);
    for (int at_end = 0; at_end < 2; at_end++) {
        struct fixture f;
        fixture_init(&f, 37, 29, LS_CFA_GBRG, true, 350);
        struct ls_demosaic_region all = {0, 0, 37, 29};
        struct sums before = run(&f, isas_of(data), all, NULL);
        uint8_t *map[KINDS * LIGHTS];
        for (size_t k = 0; k < KINDS * LIGHTS; k++) {
            size_t bytes = 2 * 37 * 29;
            map[k] = mmap(NULL, 3 * page, PROT_NONE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
            g_assert_true(map[k] != MAP_FAILED);
            if (!f.tiles[k])
                continue;
            g_assert_cmpint(mprotect(map[k] + page, page, PROT_READ | PROT_WRITE), ==, 0);
            uint8_t *to = at_end ? map[k] + 2 * page - bytes : map[k] + page;
            memcpy(to, f.tiles[k], bytes);
            f.tiles[k] = to;
        }
        struct sums after = run(&f, isas_of(data), all, NULL);
        same(before.d, after.d, before.n);
        same(before.s, after.s, before.n);
        same(before.c, after.c, before.n);
        for (size_t k = 0; k < KINDS * LIGHTS; k++)
            munmap(map[k], 3 * page);
        sums_free(&before);
        sums_free(&after);
        fixture_finish(&f);
    }
}

/* A part is the same bits as that part of the whole. */
static void check_part(const struct fixture *f, const struct sums *whole,
                       struct ls_demosaic_region r)
{
    struct sums part = run(f, ls_cpu_isa(), r, NULL);
    size_t channels = f->field.n_channels, row = r.width * channels;
    for (uint32_t q = 0; q < ROWS; q++)
        for (uint32_t y = 0; y < r.height; y++) {
            size_t from = ((size_t)q * f->field.height + r.y + y) * f->field.width + r.x;
            size_t to = ((size_t)q * r.height + y) * row;
            same(part.d + to, whole->d + from * channels, row);
            same(part.s + to, whole->s + from * channels, row);
            same(part.c + to, whole->c + from * channels, row);
        }
    sums_free(&part);
}

static void test_parts(void)
{
    const uint64_t seed = 400;
    struct noise noise = {.state = seed};
    struct fixture f;
    g_test_message("seed %" G_GUINT64_FORMAT, seed);
    fixture_init(&f, 150, 137, LS_CFA_GRBG, false, seed);
    struct ls_demosaic_region all = {0, 0, 150, 137};
    struct sums whole = run(&f, ls_cpu_isa(), all, NULL);
    check_part(&f, &whole, (struct ls_demosaic_region){0, 64, 150, 64});
    check_part(&f, &whole, (struct ls_demosaic_region){149, 136, 1, 1});
    for (int n = 0; n < 12; n++) {
        struct ls_demosaic_region r = {(uint32_t)(noise_bits(&noise) % 150),
                                       (uint32_t)(noise_bits(&noise) % 137), 0, 0};
        r.width = 1 + (uint32_t)(noise_bits(&noise) % (150 - r.x));
        r.height = 1 + (uint32_t)(noise_bits(&noise) % (137 - r.y));
        check_part(&f, &whole, r);
    }
    sums_free(&whole);
    fixture_finish(&f);
}

/* Summing S and blending its sum is not blending every light: the counter-example. */
static void test_blend_is_per_light(void)
{
    struct fixture f;
    fixture_init(&f, 32, 32, LS_CFA_RGGB, false, 500);
    struct ls_demosaic_region all = {0, 0, 32, 32};
    struct sums a = run(&f, ls_cpu_isa(), all, NULL);
    double apart = 0, all_of_it = 0;
    for (size_t k = 0; k < 32 * 32; k++) {
        double share = share_of(a.s + 3 * k, 1e-9);
        apart += pow(share * (double)a.s[3 * k] - (double)a.c[3 * k], 2);
        all_of_it += pow((double)a.c[3 * k], 2);
    }
    g_assert_cmpfloat(sqrt(apart / all_of_it), >, 0.1);
    sums_free(&a);
    fixture_finish(&f);
}

/* Maxima of the tiles; those of light 8 that are left of a border of tiles are taken away first, so
 * that it reaches them over the border alone. */
static void find_maxima(struct fixture *f)
{
    uint32_t width = f->field.width;
    size_t n_px = (size_t)width * f->field.height;
    for (uint32_t kind = 0; kind < KINDS; kind++) {
        f->max[kind] = g_new0(float, (size_t)f->n_tiles *LIGHTS);
        for (uint32_t t = 0; t < f->n_tiles; t += f->tiles_x)
            f->tiles[(size_t)(kind * LIGHTS + 8) * f->n_tiles + t] = NULL;
        for (size_t k = 0; k < LIGHTS * n_px; k++) {
            size_t light = k / n_px, x = k % n_px % width, y = k % n_px / width;
            size_t tile = y / LS_TILE_SIDE * f->tiles_x + x / LS_TILE_SIDE;
            float *max = &f->max[kind][tile * LIGHTS + light];
            if (f->tiles[(kind * LIGHTS + light) * f->n_tiles + tile])
                *max = fmaxf(*max, fabsf((float)f->plain[kind][k]));
        }
    }
    f->field.v_max = f->max[0];
    f->field.h_max = f->max[1];
}

/* The largest change of what a ratio, and of what a tint, would multiply. */
static double largest_change(const struct sums *a, const struct sums *b)
{
    double most = 0;
    for (size_t k = 0; k < a->n; k++) {
        double material = (double)(a->d[k] + a->c[k]) - (double)(b->d[k] + b->c[k]);
        double light = (double)(a->s[k] - a->c[k]) - (double)(b->s[k] - b->c[k]);
        most = fmax(most, fmax(fabs(material), fabs(light)));
    }
    return most;
}

static void test_skips_stay_under_their_bound(void)
{
    const struct ls_demosaic_region all = {0, 0, 150, 137};
    static const double errors[] = {1e-3, 0.3, 10, 30};
    struct fixture f;
    uint64_t skipped = 0;
    fixture_init(&f, 150, 137, LS_CFA_RGGB, false, 700);
    find_maxima(&f);
    for (uint32_t q = 0; q < ROWS; q++)
        f.weights[q][8] = 1e-2f; /* the dimmest, so the first to go */
    struct ls_separated_report report;
    struct sums exact = run(&f, ls_cpu_isa(), all, NULL);
    for (size_t e = 0; e < G_N_ELEMENTS(errors); e++) {
        f.max_error = errors[e];
        struct sums some = run(&f, ls_cpu_isa(), all, &report);
        double change = largest_change(&some, &exact);
        g_test_message("%g: %u of %u tiles skipped, bound %.3g, changed by %.3g", errors[e],
                       (unsigned)report.tiles_skipped, (unsigned)f.n_tiles * LIGHTS, report.bound,
                       change);
        g_assert_cmpfloat(report.bound, <=, errors[e]);
        /* sums of 19 lights of about 2 each in float: 1e-5 */
        g_assert_cmpfloat(change, <=, 2.5 * report.bound + 1e-5);
        g_assert_true(report.tiles_skipped > skipped || errors[e] < 0.01);
        skipped = report.tiles_skipped;
        check_part(&f, &some, (struct ls_demosaic_region){37, 11, 80, 100});
        check_part(&f, &some, (struct ls_demosaic_region){0, 96, 65, 41});
        sums_free(&some);
    }
    g_assert_cmpfloat(report.bound, >, 0);
    sums_free(&exact);
    fixture_finish(&f);
}

static void test_refusals(void)
{
    struct fixture f;
    fixture_init(&f, 32, 32, LS_CFA_RGGB, false, 600);
    struct ls_separated_job job = {
        .field = &f.field, .n_rows = ROWS, .weights = f.weights[0], .region = {0, 0, 32, 32}};
    float *out = g_new(float, ROWS * 32 * 32 * 3);
    struct ls_separated_job bad[6] = {job, job, job, job, job, job};
    bad[0].region.x = 1;
    bad[1].region.height = 0;
    bad[2].n_rows = LS_SEPARATED_MAX_ROWS + 1;
    bad[3].n_rows = 0;
    bad[4].max_error = 1; /* without the maxima of the tiles */
    bad[5].max_error = NAN;
    for (int k = 0; k < 6; k++)
        g_assert_cmpint(ls_separated_accumulate(&bad[k], out, NULL, NULL, NULL, NULL), ==,
                        LS_ERR_INVALID);
    f.weights[2][3] = NAN;
    g_assert_cmpint(ls_separated_accumulate(&job, out, NULL, NULL, NULL, NULL), ==, LS_ERR_INVALID);
    f.weights[2][3] = 0;
    g_assert_cmpint(ls_separated_accumulate(&job, NULL, NULL, out, NULL, NULL), ==, LS_OK);
    f.field.n_channels = 1;
    g_assert_cmpint(ls_separated_accumulate(&job, out, NULL, NULL, NULL, NULL), ==, LS_ERR_INVALID);
    g_free(out);
    fixture_finish(&f);
}

static void test_finish(void)
{
    const float d[3] = {4, 2, 1}, s[3] = {1, 1, 1}, c[3] = {0.25f, 0.5f, 1};
    const float ratio[3] = {0.8f, 0.2f, 0.1f};
    const double tint[3] = {0.9, 0.3, 0.05};
    float out[3] = {1, 1, 1}, plain[3] = {0};
    ls_separated_finish(d, s, c, ratio, tint, 2, 1, 3, out);
    ls_separated_finish(d, s, NULL, NULL, NULL, 1, 1, 3, plain);
    for (int k = 0; k < 3; k++) {
        double wanted =
            1 + 2 * ((double)ratio[k] * (double)(d[k] + c[k]) + tint[k] * (double)(s[k] - c[k]));
        g_assert_cmpfloat(fabs((double)out[k] - wanted), <, 4 * (double)FLT_EPSILON * wanted);
        g_assert_cmpfloat(plain[k], ==, d[k] + s[k]);
    }
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    isas_add("/separated/agrees-with-double", test_reference);
    isas_add("/separated/same-bits-as-the-reference", test_same_bits);
    isas_add("/separated/reads-nothing-beside-its-tiles", test_guards);
    g_test_add_func("/separated/not-finite-counts-as-zero-and-is-reported", test_not_finite);
    g_test_add_func("/separated/parts-are-bit-identical-to-the-whole", test_parts);
    g_test_add_func("/separated/skips-stay-under-their-bound", test_skips_stay_under_their_bound);
    g_test_add_func("/separated/blend-is-per-light-not-of-the-sum", test_blend_is_per_light);
    g_test_add_func("/separated/nonsense-is-refused", test_refusals);
    g_test_add_func("/separated/finish-adds-its-three-parts", test_finish);
    return g_test_run();
}
