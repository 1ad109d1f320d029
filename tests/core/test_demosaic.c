#include "core/demosaic_kernels.h"

#include "core/half.h"

#include "tests/core/isas.h"
#include "tests/core/noise.h"

#include <glib.h>
#include <math.h>
#include <string.h>

static const enum ls_demosaic_method methods[] = {LS_DEMOSAIC_GRADIENT, LS_DEMOSAIC_BILINEAR};

/* A mosaic and its RGB, planar: rgb[c * n + y * width + x]. */
struct picture {
    uint32_t width, height;
    enum ls_cfa cfa;
    size_t n;
    float *mosaic, *rgb;
    enum ls_isa isa; /* the processor's best, unless a test says otherwise */
};

static struct picture picture_new(uint32_t width, uint32_t height, enum ls_cfa cfa)
{
    struct picture p = {width, height, cfa, (size_t)width * height, NULL, NULL, ls_cpu_isa()};
    p.mosaic = g_new0(float, p.n);
    p.rgb = g_new0(float, 3 * p.n);
    return p;
}

static void picture_finish(struct picture *p)
{
    g_free(p->mosaic);
    g_free(p->rgb);
}

static void demosaic(struct picture *p, enum ls_demosaic_method method)
{
    struct ls_demosaic_region all = {0, 0, p->width, p->height};
    struct ls_demosaic_source s = {p->mosaic, p->width, all, p->width, p->height, p->cfa};
    struct ls_demosaic_target t = {{p->rgb, p->rgb + p->n, p->rgb + 2 * p->n}, 1, p->width};
    g_assert_cmpint(ls_demosaic_with(p->isa, &s, all, method, &t), ==, LS_OK);
}

static float at(const struct picture *p, unsigned c, uint32_t x, uint32_t y)
{
    return p->rgb[c * p->n + (size_t)y * p->width + x];
}

typedef double scene(unsigned channel, double x, double y);

static void sample(struct picture *p, scene *f)
{
    for (uint32_t y = 0; y < p->height; y++)
        for (uint32_t x = 0; x < p->width; x++)
            p->mosaic[(size_t)y * p->width + x] = (float)f(ls_cfa_channel(p->cfa, x, y), x, y);
}

static void randomise(struct picture *p, struct noise *noise)
{
    for (size_t i = 0; i < p->n; i++)
        p->mosaic[i] = (float)noise_normal(noise);
}

static double flat(unsigned c, double x, double y)
{
    return c == 0 ? 0.7 : c == 1 ? 0.2 : 0.4;
}

static double ramp(unsigned c, double x, double y)
{
    return (c == 0 ? 1 : c == 1 ? 0.5 : 2) + 0.25 * x - 0.125 * y;
}

static double red_thing(unsigned c, double x, double y)
{
    return c == 0 ? 1 : c == 1 ? 0.1 : 0.01;
}

static double neutral_bump(unsigned c, double x, double y)
{
    return exp(-((x - 15) * (x - 15) + (y - 15) * (y - 15)) / 8);
}

static double largest_error(const struct picture *p, scene *f, uint32_t border)
{
    double worst = 0;

    for (unsigned c = 0; c < 3; c++)
        for (uint32_t y = border; y + border < p->height; y++)
            for (uint32_t x = border; x + border < p->width; x++)
                worst = fmax(worst, fabs(at(p, c, x, y) - f(c, x, y)));
    return worst;
}

static double demosaic_error(scene *f, enum ls_cfa cfa, enum ls_demosaic_method method,
                             uint32_t border)
{
    struct picture p = picture_new(31, 30, cfa);

    sample(&p, f);
    demosaic(&p, method);
    double worst = largest_error(&p, f, border);
    picture_finish(&p);
    return worst;
}

static void test_flat_and_ramp(void)
{
    for (int cfa = LS_CFA_RGGB; cfa <= LS_CFA_BGGR; cfa++)
        for (int m = 0; m < 2; m++) {
            /* Float rounding of values up to 12: 2e-6 of the largest sample. */
            g_assert_cmpfloat(demosaic_error(flat, (enum ls_cfa)cfa, methods[m], 0), <, 2e-6);
            g_assert_cmpfloat(demosaic_error(ramp, (enum ls_cfa)cfa, methods[m], 2), <, 2.4e-5);
        }
}

static void test_gradient_is_sharper(void)
{
    double gradient = demosaic_error(neutral_bump, LS_CFA_RGGB, LS_DEMOSAIC_GRADIENT, 2);
    double bilinear = demosaic_error(neutral_bump, LS_CFA_RGGB, LS_DEMOSAIC_BILINEAR, 2);
    g_assert_cmpfloat(gradient, <, 0.5 * bilinear);
}

static void test_red_stays_red(void)
{
    static const struct {
        const char *name;
        enum ls_cfa cfa;
    } formats[] = {{"BayerRG8", LS_CFA_RGGB},
                   {"BayerGR8", LS_CFA_GRBG},
                   {"BayerGB8", LS_CFA_GBRG},
                   {"BayerBG8", LS_CFA_BGGR}};

    for (size_t k = 0; k < G_N_ELEMENTS(formats); k++) {
        enum ls_cfa cfa = ls_pixel_by_name(formats[k].name)->cfa;
        g_assert_cmpint(cfa, ==, formats[k].cfa);
        struct picture p = picture_new(12, 10, cfa);
        sample(&p, red_thing);
        p.cfa = formats[k].cfa;
        demosaic(&p, LS_DEMOSAIC_GRADIENT);
        g_assert_cmpfloat(at(&p, 0, 5, 5), >, 0.99);
        g_assert_cmpfloat(at(&p, 2, 5, 5), <, 0.02);
        /* The mosaic read with red and blue swapped must come out wrong, or this proves nothing. */
        p.cfa = (enum ls_cfa)(LS_CFA_BGGR + LS_CFA_RGGB - cfa);
        demosaic(&p, LS_DEMOSAIC_GRADIENT);
        g_assert_cmpfloat(at(&p, 2, 5, 5), >, 0.9);
        picture_finish(&p);
    }
}

/* The filter written down as 5 x 5 tables in sixteenths, applied in double with its own mirror. */
static const int green_at_colour[25] = {0, 0,  -2, 0, 0, 0, 0, 4, 0, 0,  -2, 4, 8,
                                        4, -2, 0,  0, 4, 0, 0, 0, 0, -2, 0,  0};
static const int same_row[25] = {0, 0,  1, 0,  0, 0,  -2, 0, -2, 0, -2, 8, 10,
                                 8, -2, 0, -2, 0, -2, 0,  0, 0,  1, 0,  0};
static const int opposite[25] = {0, 0,  -3, 0, 0, 0, 4, 0, 4, 0,  -3, 0, 12,
                                 0, -3, 0,  4, 0, 4, 0, 0, 0, -3, 0,  0};

static double table(const struct picture *p, const int k[25], int turned, uint32_t x, uint32_t y)
{
    double sum = 0;

    for (int j = -2; j <= 2; j++)
        for (int i = -2; i <= 2; i++) {
            int64_t xx = ABS((int64_t)x + i), yy = ABS((int64_t)y + j);
            if (xx >= p->width)
                xx = 2 * (p->width - 1) - xx;
            if (yy >= p->height)
                yy = 2 * (p->height - 1) - yy;
            int weight = turned ? k[(i + 2) * 5 + j + 2] : k[(j + 2) * 5 + i + 2];
            sum += weight / 16.0 * p->mosaic[yy * p->width + xx];
        }
    return sum;
}

static const int cross[25] = {0, 0, 0, 0, 0, 0, 0, 4, 0, 0, 0, 4, 0,
                              4, 0, 0, 0, 4, 0, 0, 0, 0, 0, 0, 0};
static const int pair[25] = {[11] = 8, [13] = 8};
static const int corners[25] = {[6] = 4, [8] = 4, [16] = 4, [18] = 4};

static double expected(const struct picture *p, enum ls_demosaic_method method, unsigned c,
                       uint32_t x, uint32_t y)
{
    bool gradient = method == LS_DEMOSAIC_GRADIENT;
    unsigned own = ls_cfa_channel(p->cfa, x, y);

    if (c == own)
        return p->mosaic[(size_t)y * p->width + x];
    if (c == 1)
        return table(p, gradient ? green_at_colour : cross, 0, x, y);
    if (own != 1)
        return table(p, gradient ? opposite : corners, 0, x, y);
    return table(p, gradient ? same_row : pair, ls_cfa_channel(p->cfa, x + 1, y) != c, x, y);
}

static void check_tables(const struct picture *p, enum ls_demosaic_method method)
{
    for (unsigned c = 0; c < 3; c++)
        for (uint32_t y = 0; y < p->height; y++)
            for (uint32_t x = 0; x < p->width; x++)
                /* 2e-6 of the largest sample, about 4 sigma. */
                g_assert_cmpfloat(fabs(at(p, c, x, y) - expected(p, method, c, x, y)), <, 8e-6);
}

static void test_tables(const void *data)
{
    enum { SEED = 31 };
    struct noise noise = {SEED};

    g_test_message("seed %d", SEED);
    for (int cfa = LS_CFA_RGGB; cfa <= LS_CFA_BGGR; cfa++)
        for (int m = 0; m < 2; m++)
            for (uint32_t width = 3; width < 60; width += 5) {
                struct picture p = picture_new(width, 13, (enum ls_cfa)cfa);
                p.isa = isas_of(data);
                randomise(&p, &noise);
                demosaic(&p, methods[m]);
                check_tables(&p, methods[m]);
                picture_finish(&p);
            }
}

/* Where RGB goes in each of the four forms, one element off alignment. */
static struct ls_demosaic_target target_in(const struct picture *p, bool half, bool woven,
                                           void *memory)
{
    struct ls_demosaic_target t = {.pixel_step = woven ? 3 : 1,
                                   .row_step = (woven ? 3 : 1) * (size_t)p->width};
    for (size_t c = 0; c < 3; c++) {
        size_t first = 1 + (woven ? c : c * p->n);
        t.plane[c] = half ? NULL : (float *)memory + first;
        t.half[c] = half ? (uint16_t *)memory + first : NULL;
    }
    return t;
}

static size_t place_of(const struct picture *p, bool woven, unsigned c, size_t k)
{
    return 1 + (woven ? 3 * k + c : c * p->n + k);
}

/* A half as it is stored of a demosaiced value. */
static uint16_t stored(float v)
{
    return ls_half_from_float(v > LS_HALF_MAX ? LS_HALF_MAX : v < -LS_HALF_MAX ? -LS_HALF_MAX : v);
}

static void check_halves(const struct picture *p, const uint16_t *mosaic,
                         enum ls_demosaic_method method, bool woven)
{
    struct ls_demosaic_region all = {0, 0, p->width, p->height};
    struct ls_demosaic_source s = {.half = mosaic,
                                   .stride = p->width,
                                   .window = all,
                                   .image_width = p->width,
                                   .image_height = p->height,
                                   .cfa = p->cfa};
    g_autofree uint16_t *out = g_new0(uint16_t, 3 * p->n + 2);
    struct ls_demosaic_target t = target_in(p, true, woven, out);

    g_assert_cmpint(ls_demosaic_with(p->isa, &s, all, method, &t), ==, LS_OK);
    for (unsigned c = 0; c < 3; c++)
        for (size_t k = 0; k < p->n; k++) {
            float v = p->rgb[c * p->n + k];
            uint16_t got = out[place_of(p, woven, c, k)];
            if (isnan(v))
                g_assert_true(isnan(ls_half_to_float(got)));
            else
                g_assert_cmphex(got, ==, stored(v));
        }
    g_assert_cmphex(out[0] | out[3 * p->n + 1], ==, 0);
}

/* Every stored half: zeros, denormals, the largest, infinities and NaNs beside ordinary values. */
static uint16_t any_half(struct noise *noise, int round)
{
    uint16_t bits = (uint16_t)noise_bits(noise);
    return round == 0 ? bits : round == 1 ? bits & 0x83ff : (bits & 0x8000) | 0x7bff;
}

static void test_halves(const void *data)
{
    enum { SEED = 34 };
    struct noise noise = {SEED};
    static const uint32_t sizes[][2] = {{1, 1}, {2, 3}, {7, 5}, {16, 2}, {33, 4}, {67, 3}};

    g_test_message("seed %d", SEED);
    for (int cfa = LS_CFA_NONE; cfa <= LS_CFA_BGGR; cfa++)
        for (size_t i = 0; i < G_N_ELEMENTS(sizes) * 3; i++) {
            const uint32_t *size = sizes[i / 3];
            struct picture p = picture_new(size[0], size[1], (enum ls_cfa)cfa);
            g_autofree uint16_t *mosaic = g_new(uint16_t, p.n);
            p.isa = isas_of(data);
            for (size_t k = 0; k < p.n; k++) {
                mosaic[k] = any_half(&noise, (int)i % 3);
                p.mosaic[k] = ls_half_to_float(mosaic[k]);
            }
            for (int m = 0; m < 2; m++) {
                demosaic(&p, methods[m]);
                for (size_t k = 0; i % 3 && k < 3 * p.n; k++)
                    g_assert_true(isfinite(p.rgb[k]));
                check_halves(&p, mosaic, methods[m], false);
                check_halves(&p, mosaic, methods[m], true);
            }
            picture_finish(&p);
        }
}

/* Planes and woven, against the C instance; samples across all of float's range. */
static void test_same_bits(const void *data)
{
    enum { SEED = 35 };
    struct noise noise = {SEED};

    g_test_message("seed %d", SEED);
    for (int cfa = LS_CFA_NONE; cfa <= LS_CFA_BGGR; cfa++)
        for (uint32_t width = 1; width < 70; width += 3) {
            struct picture p = picture_new(width, 4, (enum ls_cfa)cfa);
            struct ls_demosaic_region all = {0, 0, p.width, p.height};
            struct ls_demosaic_source s = {p.mosaic, p.width, all, p.width, p.height, p.cfa, NULL};
            g_autofree float *out = g_new0(float, 3 * p.n + 2);
            for (size_t k = 0; k < p.n; k++)
                p.mosaic[k] =
                    ldexpf((float)noise_normal(&noise), (int)(noise_bits(&noise) % 255) - 155);
            for (int m = 0; m < 4; m++) {
                struct ls_demosaic_target t = target_in(&p, false, m & 1, out);
                p.isa = LS_ISA_C;
                demosaic(&p, methods[m / 2]);
                g_assert_cmpint(ls_demosaic_with(isas_of(data), &s, all, methods[m / 2], &t), ==,
                                LS_OK);
                for (unsigned c = 0; c < 3; c++)
                    for (size_t k = 0; k < p.n; k++)
                        g_assert_cmpmem(&out[place_of(&p, m & 1, c, k)], 4, &p.rgb[c * p.n + k], 4);
                g_assert_true(out[0] == 0 && out[3 * p.n + 1] == 0);
            }
            picture_finish(&p);
        }
}

/* Demosaic a region from a buffer that holds nothing but what it needs; the rest of the buffer is
 * NaN. */
static void check_crop(const struct picture *p, struct ls_demosaic_region r,
                       enum ls_demosaic_method method, int interleaved)
{
    struct ls_demosaic_region need = ls_demosaic_needs(r, p->width, p->height);
    size_t stride = need.width + 3, n = (size_t)r.width * r.height;
    g_autofree float *window = g_new(float, stride *need.height), *out = g_new(float, 3 * n);
    struct ls_demosaic_source s = {window, stride, need, p->width, p->height, p->cfa};
    struct ls_demosaic_target planar = {{out, out + n, out + 2 * n}, 1, r.width};
    struct ls_demosaic_target mixed = {{out, out + 1, out + 2}, 3, 3 * (size_t)r.width};

    memset(window, 0xff, stride * need.height * sizeof *window);
    for (uint32_t y = 0; y < need.height; y++)
        memcpy(window + y * stride, p->mosaic + (size_t)(need.y + y) * p->width + need.x,
               need.width * sizeof *window);
    g_assert_cmpint(ls_demosaic_with(p->isa, &s, r, method, interleaved ? &mixed : &planar), ==,
                    LS_OK);
    for (unsigned c = 0; c < 3; c++)
        for (uint32_t y = 0; y < r.height; y++)
            for (uint32_t x = 0; x < r.width; x++) {
                size_t k = (size_t)y * r.width + x;
                float whole = at(p, c, r.x + x, r.y + y);
                float part = out[interleaved ? 3 * k + c : c * n + k];
                g_assert_cmpmem(&part, sizeof part, &whole, sizeof whole);
            }
}

static void check_crops(enum ls_isa isa, uint32_t width, uint32_t height, enum ls_cfa cfa,
                        struct noise *noise)
{
    struct picture p = picture_new(width, height, cfa);

    p.isa = isa;
    randomise(&p, noise);
    for (int m = 0; m < 2; m++) {
        demosaic(&p, methods[m]);
        for (uint32_t y = 0; y < height; y++)
            for (uint32_t x = 0; x < width; x++) {
                struct ls_demosaic_region r = {x, y, 1, 1};
                check_crop(&p, r, methods[m], (x + y) & 1);
                r.width += (uint32_t)(noise_bits(noise) % (width - x));
                r.height += (uint32_t)(noise_bits(noise) % (height - y));
                check_crop(&p, r, methods[m], x & 1);
            }
    }
    picture_finish(&p);
}

static void test_crops(const void *data)
{
    enum { SEED = 32 };
    struct noise noise = {SEED};
    static const uint32_t sizes[][2] = {{1, 1}, {1, 4}, {5, 1}, {2, 2}, {3, 2}, {4, 5}, {17, 12}};

    g_test_message("seed %d", SEED);
    for (int cfa = LS_CFA_NONE; cfa <= LS_CFA_BGGR; cfa++) {
        for (size_t k = 0; k < G_N_ELEMENTS(sizes); k++)
            check_crops(isas_of(data), sizes[k][0], sizes[k][1], (enum ls_cfa)cfa, &noise);
        struct picture p = picture_new(4300, 3, (enum ls_cfa)cfa); /* wider than two strips */
        p.isa = isas_of(data);
        randomise(&p, &noise);
        demosaic(&p, LS_DEMOSAIC_GRADIENT);
        for (uint32_t x = 250; x < 262; x++)
            check_crop(&p, (struct ls_demosaic_region){x, 0, 3000, 3}, LS_DEMOSAIC_GRADIENT, 0);
        picture_finish(&p);
    }
}

static void test_tiny(void)
{
    struct picture p = picture_new(1, 1, LS_CFA_BGGR);

    p.mosaic[0] = 0.75f;
    for (int m = 0; m < 2; m++) {
        demosaic(&p, methods[m]);
        for (unsigned c = 0; c < 3; c++)
            g_assert_cmpfloat_with_epsilon(at(&p, c, 0, 0), 0.75, 1e-6);
    }
    picture_finish(&p);
}

static void test_refusals(void)
{
    static float data[64], out[192];
    struct ls_demosaic_target t = {{out, out + 64, out + 128}, 1, 8};
    struct ls_demosaic_source s = {data, 8, {0, 0, 8, 8}, 8, 8, LS_CFA_RGGB};

    g_assert_cmpint(ls_demosaic(&s, (struct ls_demosaic_region){1, 0, 8, 1}, 0, &t), ==,
                    LS_ERR_INVALID);
    g_assert_cmpint(ls_demosaic(&s, (struct ls_demosaic_region){UINT32_MAX, 0, 2, 1}, 0, &t), ==,
                    LS_ERR_INVALID);
    s.half = (const uint16_t *)out; /* floats and halves at once */
    g_assert_cmpint(ls_demosaic(&s, s.window, 0, &t), ==, LS_ERR_INVALID);
    s.half = NULL;
    t.half[0] = (uint16_t *)out;
    g_assert_cmpint(ls_demosaic(&s, s.window, 0, &t), ==, LS_ERR_INVALID);
    t.half[0] = NULL;
    s.window = (struct ls_demosaic_region){2, 2, 4, 4}; /* no halo on the left */
    g_assert_cmpint(ls_demosaic(&s, (struct ls_demosaic_region){3, 4, 1, 1}, 0, &t), ==,
                    LS_ERR_INVALID);
    s.window = (struct ls_demosaic_region){0, 6, 8, 2}; /* nothing is asked for: nothing is read */
    g_assert_cmpint(ls_demosaic(&s, (struct ls_demosaic_region){0, 8, 8, 0}, 0, &t), ==, LS_OK);
    s.window = (struct ls_demosaic_region){4, 4, 8, 8}; /* window beyond the image */
    g_assert_cmpint(ls_demosaic(&s, (struct ls_demosaic_region){6, 6, 1, 1}, 0, &t), ==,
                    LS_ERR_INVALID);
}

static void test_nan_stays_near(void)
{
    struct picture p = picture_new(11, 11, LS_CFA_GRBG);

    p.mosaic[5 * 11 + 5] = NAN;
    demosaic(&p, LS_DEMOSAIC_GRADIENT);
    for (unsigned c = 0; c < 3; c++)
        for (int y = 0; y < 11; y++)
            for (int x = 0; x < 11; x++)
                if (abs(x - 5) > 2 || abs(y - 5) > 2)
                    g_assert_true(isfinite(at(&p, c, (uint32_t)x, (uint32_t)y)));
    picture_finish(&p);
}

/* Six lights on one mosaic, weighted; each either summed before or after demosaicing. Weights per
 * colour: on the mosaic each pixel can only take its own colour's. Returns the relative RMS
 * difference. */
static double order_difference(double colour_spread, enum ls_demosaic_method method)
{
    enum { LIGHTS = 6, SEED = 33 };
    struct noise noise = {SEED};
    struct picture sum = picture_new(40, 40, LS_CFA_RGGB), light = picture_new(40, 40, LS_CFA_RGGB);
    g_autofree double *after = g_new0(double, 3 * sum.n);
    double square = 0, reference = 0;

    for (int k = 0; k < LIGHTS; k++) {
        double base = 0.5 + noise_uniform(&noise), w[3];
        for (int c = 0; c < 3; c++)
            w[c] = base * (1 + colour_spread * (c - 1));
        for (size_t i = 0; i < light.n; i++)
            light.mosaic[i] = (float)(1 + 0.5 * noise_normal(&noise));
        demosaic(&light, method);
        for (uint32_t i = 0; i < light.n; i++) {
            sum.mosaic[i] +=
                (float)w[ls_cfa_channel(LS_CFA_RGGB, i % 40, i / 40)] * light.mosaic[i];
            for (unsigned c = 0; c < 3; c++)
                after[c * light.n + i] += w[c] * light.rgb[c * light.n + i];
        }
    }
    demosaic(&sum, method);
    for (size_t i = 0; i < 3 * sum.n; i++) {
        square += (sum.rgb[i] - after[i]) * (sum.rgb[i] - after[i]);
        reference += after[i] * after[i];
    }
    picture_finish(&sum);
    picture_finish(&light);
    return sqrt(square / reference);
}

static void test_sum_commutes(void)
{
    /* Six float sums of values near 1: a few 1e-7. */
    g_assert_cmpfloat(order_difference(0, LS_DEMOSAIC_GRADIENT), <, 1e-6);
    g_assert_cmpfloat(order_difference(0, LS_DEMOSAIC_BILINEAR), <, 1e-6);
}

static void test_unequal_weights_do_not_commute(void)
{
    g_assert_cmpfloat(order_difference(0.5, LS_DEMOSAIC_GRADIENT), >, 0.02);
    /* Bilinear never mixes colours: there a weight per colour may go onto the mosaic. */
    g_assert_cmpfloat(order_difference(0.5, LS_DEMOSAIC_BILINEAR), <, 1e-6);
}

/* Two pictures of a detailed target under different light. */
static double stripes(unsigned c, double x, double y)
{
    return 0.2 + 0.15 * sin(1.9 * x + 0.3 * c) + 0.02 * y;
}

static double other_light(unsigned c, double x, double y)
{
    return (0.25 + 0.2 * sin(1.9 * x + 1.3 * c + 1)) * (1 + 0.3 * c);
}

/* A field is defined by demosaiced pictures, so their ratio is the reference; the ratio of the
 * mosaics, demosaiced, is something else. Bilinear, so that nothing but the order differs. */
static void test_ratio_before_demosaic(void)
{
    struct picture a = picture_new(40, 40, LS_CFA_RGGB), b = picture_new(40, 40, LS_CFA_RGGB);
    struct picture ratio = picture_new(40, 40, LS_CFA_RGGB);
    double square = 0, reference = 0;

    sample(&a, other_light);
    sample(&b, stripes);
    demosaic(&a, LS_DEMOSAIC_BILINEAR);
    demosaic(&b, LS_DEMOSAIC_BILINEAR);
    for (size_t i = 0; i < ratio.n; i++)
        ratio.mosaic[i] = a.mosaic[i] / b.mosaic[i];
    demosaic(&ratio, LS_DEMOSAIC_BILINEAR);
    for (size_t i = 0; i < 3 * ratio.n; i++) {
        double after = a.rgb[i] / b.rgb[i];
        square += (ratio.rgb[i] - after) * (ratio.rgb[i] - after);
        reference += after * after;
    }
    g_assert_cmpfloat(sqrt(square / reference), >, 0.1);
    picture_finish(&a);
    picture_finish(&b);
    picture_finish(&ratio);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/demosaic/constants-and-ramps-are-kept-in-every-phase", test_flat_and_ramp);
    g_test_add_func("/demosaic/gradient-halves-the-error-of-bilinear", test_gradient_is_sharper);
    g_test_add_func("/demosaic/red-stays-red-and-a-swapped-cfa-shows", test_red_stays_red);
    isas_add("/demosaic/filters-equal-their-tables-and-mirror", test_tables);
    isas_add("/demosaic/halves-are-those-of-the-floats-and-finite-stays-finite", test_halves);
    isas_add("/demosaic/every-instruction-set-gives-the-bits-of-c", test_same_bits);
    isas_add("/demosaic/every-crop-has-the-bits-of-the-whole", test_crops);
    g_test_add_func("/demosaic/one-pixel-is-grey", test_tiny);
    g_test_add_func("/demosaic/regions-without-their-halo-are-refused", test_refusals);
    g_test_add_func("/demosaic/a-nan-reaches-two-pixels", test_nan_stays_near);
    g_test_add_func("/demosaic/summing-lights-first-is-exact-for-equal-weights", test_sum_commutes);
    g_test_add_func("/demosaic/summing-lights-first-is-wrong-for-unequal-weights",
                    test_unequal_weights_do_not_commute);
    g_test_add_func("/demosaic/a-ratio-before-demosaic-is-wrong", test_ratio_before_demosaic);
    return g_test_run();
}
