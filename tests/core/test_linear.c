#include "core/linear_block.h"
#include "tests/core/isas.h"

#include <glib.h>
#include <math.h>
#include <string.h>

enum { MAX_G = 32 };

static const double white[6] = {0.76, 1, 0.59, 0.8, 0.5, 0.7};
static const double amber[3] = {0.8, 0.37, 0.02};

/** A band of random pictures, and its fit. */
struct fixture {
    GRand *rand;
    struct ls_linear_pictures pictures;
    struct ls_linear_options options;
    float *v[MAX_G], *f[MAX_G], *m;
    struct ls_linear_noise noise[MAX_G];
};

static size_t pixels(const struct fixture *x)
{
    return (size_t)x->pictures.width * x->pictures.height;
}

static void set_up(struct fixture *x, uint32_t w, uint32_t h, uint32_t g, uint32_t n_in,
                   uint32_t n_out)
{
    *x = (struct fixture){.rand = g_rand_new_with_seed(3)};
    ls_linear_options_default(&x->options);
    size_t n = (size_t)w * h;
    for (uint32_t k = 0; k < g; k++) {
        x->v[k] = g_new0(float, n *n_in);
        x->f[k] = g_new0(float, n *n_out);
    }
    x->m = g_new0(float, n *n_in *n_out);
    x->pictures = (struct ls_linear_pictures){.width = w,
                                              .height = h,
                                              .n_segments = g,
                                              .n_in = n_in,
                                              .n_out = n_out,
                                              .v = (const float *const *)x->v,
                                              .f = (const float *const *)x->f,
                                              .v_noise = x->noise,
                                              .f_noise = x->noise,
                                              .p_in = white,
                                              .p_out = amber};
    for (uint32_t c = 0; c < n_out; c++)
        x->pictures.inputs[c] = c < n_in ? c : 0;
}

static void tear_down(struct fixture *x)
{
    for (int k = 0; k < MAX_G; k++) {
        g_free(x->v[k]);
        g_free(x->f[k]);
    }
    g_free(x->m);
    g_rand_free(x->rand);
}

static void fit(struct fixture *x)
{
    struct ls_diag diag = {0};
    enum ls_err err = ls_linear_fit(&x->pictures, &x->options, 0, x->pictures.height, x->m, &diag);
    g_assert_cmpstr(diag.text, ==, "");
    g_assert_cmpint(err, ==, LS_OK);
}

/* Light that varies in brightness from @darkest to 1 and in colour by a half. */
static void shade_from(struct fixture *x, double darkest)
{
    uint32_t n_in = x->pictures.n_in;
    for (uint32_t g = 0; g < x->pictures.n_segments; g++)
        for (size_t i = 0; i < pixels(x); i++) {
            double b = pow(darkest, g_rand_double(x->rand));
            for (uint32_t a = 0; a < n_in; a++)
                x->v[g][i * n_in + a] = (float)(b * g_rand_double_range(x->rand, 0.5, 1.5));
        }
}

static void shade(struct fixture *x)
{
    shade_from(x, 0.01);
}

/* F as any linear map of each pixel makes it; its coefficients in truth[pixels][n_out][n_in]. */
static void reflect(struct fixture *x, double *truth)
{
    uint32_t n_in = x->pictures.n_in, n_out = x->pictures.n_out;
    for (size_t i = 0; i < pixels(x); i++)
        for (uint32_t c = 0; c < n_out; c++)
            for (uint32_t a = 0; a < n_in; a++)
                truth[(i * n_out + c) * n_in + a] =
                    g_rand_double_range(x->rand, 0, 0.3) + (x->pictures.inputs[c] == a);
    for (uint32_t g = 0; g < x->pictures.n_segments; g++)
        for (size_t i = 0; i < pixels(x) * n_out; i++) {
            double f = 0;
            for (uint32_t a = 0; a < n_in; a++)
                f += truth[i * n_in + a] * (double)x->v[g][i / n_out * n_in + a];
            x->f[g][i] = (float)f;
        }
}

static void test_one_segment_is_eq_1(void)
{
    struct fixture x;
    set_up(&x, 23, 19, 1, 3, 3);
    x.noise[0] = x.pictures.total_noise = (struct ls_linear_noise){4e-4, 1e-3};
    x.pictures.demosaiced = true;
    size_t n = pixels(&x) * 3;
    g_autofree float *sigma = g_new(float, n), *ratio = g_new(float, n);
    double neutral[3];
    shade(&x);
    for (size_t i = 0; i < n; i++) {
        x.f[0][i] = (float)g_rand_double_range(x.rand, -0.1, 1);
        x.v[0][i] *= i % 7 ? 1.0f : -0.02f;
        sigma[i] = (float)sqrt(4e-4 + 1e-3 * fmax((double)x.v[0][i], 0));
    }
    x.v[0][100] = NAN;
    for (int c = 0; c < 3; c++)
        neutral[c] = amber[c] / white[c];
    ls_promote_add_contrast(x.v[0], 23, 19, 3, sigma);
    g_assert_cmpint(ls_promote_ratio(x.f[0], x.v[0], sigma, 23, 19, 3, neutral, ratio, NULL), ==,
                    LS_OK);
    fit(&x);
    for (size_t i = 0; i < n * 3; i++) {
        size_t c = i / 3 % 3, a = i % 3;
        float expected = a == c ? ratio[i / 3] : 0;
        g_assert_cmpmem(&x.m[i], sizeof(float), &expected, sizeof(float));
    }
    tear_down(&x);
}

static void test_a_linear_surface_is_found_exactly(void)
{
    for (uint32_t n_in = 1; n_in <= LS_LINEAR_MAX_INPUTS; n_in++)
        for (uint32_t n_out = 1; n_out <= 3; n_out += 2) {
            struct fixture x;
            set_up(&x, 17, 5, 14, n_in, n_out);
            x.options.ridge = 1e-9;
            x.options.dielectric_weight = 0;
            g_autofree double *truth = g_new(double, pixels(&x) * n_in * n_out);
            shade(&x);
            reflect(&x, truth);
            fit(&x);
            /* floats of f, 6e-8, over the least singular value of the rows, about 1e-2 */
            for (size_t i = 0; i < pixels(&x) * n_in * n_out; i++)
                g_assert_cmpfloat_with_epsilon((double)x.m[i], truth[i], 5e-5);
            tear_down(&x);
        }
}

/* Gaussian elimination with pivoting; a[n][n + 1]. */
static void eliminate(long double (*a)[8], int n, long double *x)
{
    for (int k = 0; k < n; k++) {
        int best = k;
        for (int i = k + 1; i < n; i++)
            best = fabsl(a[i][k]) > fabsl(a[best][k]) ? i : best;
        for (int j = 0; j <= n; j++) {
            long double t = a[k][j];
            a[k][j] = a[best][j];
            a[best][j] = t;
        }
        for (int i = k + 1; i < n; i++)
            for (int j = n; j >= k; j--)
                a[i][j] -= a[i][k] / a[k][k] * a[k][j];
    }
    for (int k = n; k-- > 0;) {
        x[k] = a[k][n];
        for (int j = k + 1; j < n; j++)
            x[k] -= a[k][j] * x[j];
        x[k] /= a[k][k];
    }
}

/* Row c of M at a pixel, from the conditions of Lagrange of the header's formula. */
static void reference(const struct fixture *x, size_t pixel, uint32_t c, long double *m)
{
    const struct ls_linear_pictures *p = &x->pictures;
    uint32_t n = p->n_in, in = p->inputs[c];
    long double kkt[8][8] = {{0}}, sum[8] = {0}, f_sum = 0, mean = 0, unit = 0, trace = 0, z[8];
    for (uint32_t g = 0; g < p->n_segments; g++) {
        f_sum += (long double)p->f[g][pixel * p->n_out + c];
        for (uint32_t a = 0; a < n; a++)
            sum[a] += (long double)p->v[g][pixel * n + a];
    }
    for (uint32_t a = 0; a < n; a++) {
        mean += sum[a] / n / p->n_segments;
        unit += (long double)white[a] / n;
    }
    long double ratio = f_sum / sum[in];
    for (uint32_t g = 0; g <= p->n_segments; g++) {
        long double row[8], y, b = 0, weight;
        for (uint32_t a = 0; a < n; a++) {
            row[a] = g < p->n_segments ? (long double)p->v[g][pixel * n + a] / mean
                                       : (long double)white[a] / unit;
            b += row[a] / n;
        }
        y = g < p->n_segments ? (long double)p->f[g][pixel * p->n_out + c] / mean
                              : (long double)amber[c] / unit;
        y -= row[in] * ratio;
        if (b < (long double)x->options.row_floor)
            b = (long double)x->options.row_floor;
        weight = g < p->n_segments ? 1 / (b * b * p->n_segments)
                                   : (long double)x->options.dielectric_weight *
                                         (long double)x->options.dielectric_weight;
        for (uint32_t a = 0; a < n; a++) {
            for (uint32_t k = 0; k < n; k++)
                kkt[a][k] += weight * row[a] * row[k];
            kkt[a][n + 1] += weight * row[a] * y;
        }
    }
    for (uint32_t a = 0; a < n; a++)
        trace += kkt[a][a];
    for (uint32_t a = 0; a < n; a++) {
        kkt[a][a] += (long double)x->options.ridge * trace / n;
        kkt[a][n] = kkt[n][a] = sum[a] / mean;
    }
    eliminate(kkt, (int)n + 1, z);
    for (uint32_t a = 0; a < n; a++)
        m[a] = z[a] + (a == in ? ratio : 0);
}

static void test_the_fit_is_that_of_long_double(void)
{
    for (uint32_t n_in = 1; n_in <= LS_LINEAR_MAX_INPUTS; n_in++) {
        struct fixture x;
        set_up(&x, 70, 3, 14, n_in, 3);
        shade(&x);
        for (uint32_t g = 0; g < 14; g++)
            for (size_t i = 0; i < pixels(&x) * 3; i++)
                x.f[g][i] = (float)g_rand_double_range(x.rand, 0, 1) * x.v[g][i / 3 * n_in];
        for (uint32_t g = 0; g < 7; g++) /* pairs of like rows in some pixels */
            memcpy(x.v[g + 7], x.v[g], 70 * n_in * sizeof(float));
        fit(&x);
        for (size_t i = 0; i < pixels(&x); i++)
            for (uint32_t c = 0; c < 3; c++) {
                long double m[8], largest = 0;
                reference(&x, i, c, m);
                for (uint32_t a = 0; a < n_in; a++)
                    largest = fmaxl(largest, fabsl(m[a]));
                /* as the header says: sums of V are kept as floats */
                for (uint32_t a = 0; a < n_in; a++)
                    g_assert_cmpfloat(
                        fabs((double)(m[a] - (long double)x.m[(i * 3 + c) * n_in + a])), <,
                        1e-5 * (double)largest);
            }
        tear_down(&x);
    }
}

static void test_the_full_sphere_is_reproduced(void)
{
    struct fixture x;
    set_up(&x, 41, 7, 6, 3, 3);
    shade(&x);
    for (uint32_t g = 0; g < 6; g++)
        for (size_t i = 0; i < pixels(&x) * 3; i++)
            x.f[g][i] = (float)g_rand_double_range(x.rand, -0.1, 1);
    fit(&x);
    for (size_t i = 0; i < pixels(&x) * 3; i++) {
        double made = 0, photographed = 0, largest = 0;
        for (uint32_t g = 0; g < 6; g++) {
            photographed += (double)x.f[g][i];
            for (int a = 0; a < 3; a++) {
                double part = (double)x.m[i * 3 + a] * (double)x.v[g][i / 3 * 3 + a];
                made += part;
                largest = fmax(largest, fabs(part));
            }
        }
        g_assert_cmpfloat_with_epsilon(made, photographed, 1e-5 * fmax(largest, photographed));
    }
    tear_down(&x);
}

static void test_a_white_highlight_stays_white(void)
{
    struct fixture x;
    set_up(&x, 8, 8, 14, 3, 3);
    const double wax[3] = {0.5, 0.03, 0.02}; /* F / V differs from p(s) / p(0) by the material */
    const double ratio[3] = {0.9, 0.5, 0.01};
    for (uint32_t g = 0; g < 14; g++)
        for (size_t i = 0; i < pixels(&x) * 3; i++) {
            double v = wax[i % 3] * (1 + g % 3), gloss = g == 5 ? 0.01 : 0;
            x.v[g][i] = (float)(v * white[i % 3] + gloss * white[i % 3]);
            x.f[g][i] = (float)(v * white[i % 3] * ratio[i % 3] + gloss * amber[i % 3]);
        }
    fit(&x);
    for (size_t i = 0; i < pixels(&x) * 3; i++) {
        double f = 0;
        for (int a = 0; a < 3; a++)
            f += (double)x.m[i * 3 + a] * white[a];
        /* 2 % of the brightest channel, as the ridge allows; Eq. 1 is wrong by 13 % of green's
         * 0.37 and more */
        g_assert_cmpfloat_with_epsilon(f, amber[i % 3], 0.02 * amber[0]);
    }
    tear_down(&x);
}

static void test_any_band_has_the_bits_of_the_whole(void)
{
    enum { W = 21, H = 67, G = 5 };
    struct fixture x;
    set_up(&x, W, H, G, 3, 3);
    x.pictures.demosaiced = true;
    x.pictures.total_noise = (struct ls_linear_noise){1e-2, 1e-2}; /* much of it is not trusted */
    for (int g = 0; g < G; g++)
        x.noise[g] = (struct ls_linear_noise){2e-3, 2e-3};
    shade(&x);
    for (uint32_t g = 0; g < G; g++)
        for (size_t i = 0; i < pixels(&x) * 3; i++)
            x.f[g][i] = x.v[g][i] * (float)g_rand_double_range(x.rand, -0.1, 1);
    fit(&x);
    static const uint32_t splits[] = {0, 1, 2, 13, 33, 34, 60, 67};
    for (size_t k = 0; k + 1 < G_N_ELEMENTS(splits); k++) {
        uint32_t y0 = splits[k], y1 = splits[k + 1];
        uint32_t top = y0 > LS_LINEAR_HALO_PX ? y0 - LS_LINEAR_HALO_PX : 0;
        uint32_t end = H - y1 > LS_LINEAR_HALO_PX ? y1 + LS_LINEAR_HALO_PX : H;
        const float *v[G], *f[G];
        for (int g = 0; g < G; g++) {
            v[g] = x.v[g] + (size_t)top * W * 3;
            f[g] = x.f[g] + (size_t)top * W * 3;
        }
        struct ls_linear_pictures band = x.pictures;
        band.height = end - top;
        band.v = v;
        band.f = f;
        float m[W * H * 9];
        g_assert_cmpint(ls_linear_fit(&band, &x.options, y0 - top, y1 - y0, m, NULL), ==, LS_OK);
        g_assert_cmpmem(m, (y1 - y0) * W * 9 * sizeof(float), x.m + (size_t)y0 * W * 9,
                        (y1 - y0) * W * 9 * sizeof(float));
    }
    tear_down(&x);
}

static void test_the_result_is_finite_whatever_comes(void)
{
    static const float odd[] = {0,     -0.0f, 1,   -1,       1e-45f,    1e-38f, 3e38f,   -3e38f,
                                1e-3f, 65504, NAN, INFINITY, -INFINITY, 1e20f,  -1e-20f, 0.5f};
    guint32 seed = g_test_rand_int_range(1, G_MAXINT);
    g_test_message("seed %u", seed);
    for (uint32_t n_in = 1; n_in <= 4; n_in++)
        for (uint32_t g = 1; g <= 6; g++) {
            struct fixture x;
            set_up(&x, 33, 29, g, n_in, 3);
            g_rand_set_seed(x.rand, seed);
            for (uint32_t k = 0; k < g; k++)
                for (size_t i = 0; i < pixels(&x); i++) {
                    int kind = (int)(i % 4); /* all odd, few odd, rank 1, all the same */
                    float b = odd[g_rand_int_range(x.rand, 0, G_N_ELEMENTS(odd))];
                    for (uint32_t a = 0; a < n_in + 3; a++) {
                        float *at = a < n_in ? &x.v[k][i * n_in + a] : &x.f[k][i * 3 + a - n_in];
                        float any = odd[g_rand_int_range(x.rand, 0, G_N_ELEMENTS(odd))];
                        bool take =
                            kind == 0 || (kind == 1 && g_rand_int_range(x.rand, 0, 40) == 0);
                        *at = take ? any : kind == 2 ? b * 0.5f : kind == 3 ? 0.25f : 0.1f;
                    }
                }
            for (int noisy = 0; noisy < 2; noisy++) {
                x.pictures.total_noise.shot = noisy * 1e-3;
                x.noise[0].floor = noisy * 1e-4;
                fit(&x);
                for (size_t i = 0; i < pixels(&x) * n_in * 3; i++)
                    g_assert_true(isfinite(x.m[i]));
                struct ls_linear_error e = {0};
                if (g > 1)
                    g_assert_cmpint(
                        ls_linear_leave_one_out(&x.pictures, &x.options, 0, 29, 1, &e, NULL, NULL),
                        ==, LS_OK);
                g_assert_true(isfinite(e.difference) && isfinite(e.total) && isfinite(e.noise));
            }
            tear_down(&x);
        }
}

/* Pictures with dark, negative and unreadable values among the others. */
static void roughen(struct fixture *x)
{
    static const float odd[] = {0, -0.01f, 1e-30f, 3e38f, INFINITY, NAN};
    for (uint32_t g = 0; g < x->pictures.n_segments; g++)
        for (size_t i = 0; i < pixels(x) * 3; i++) {
            x->f[g][i] = x->v[g][i] * (float)g_rand_double_range(x->rand, 0.5, 1);
            if (g_rand_int_range(x->rand, 0, 100) == 0)
                x->v[g][i] = odd[g_rand_int_range(x->rand, 0, G_N_ELEMENTS(odd))];
        }
    for (uint32_t g = 0; g < x->pictures.n_segments; g++)
        x->noise[g] = (struct ls_linear_noise){1e-5, 1e-4};
    x->pictures.total_noise = (struct ls_linear_noise){1e-4, 1e-4};
    x->pictures.demosaiced = true;
}

static void test_every_instruction_set_has_the_same_bits(const void *data)
{
    struct fixture x;
    set_up(&x, 131, 24, 5, 3, 3);
    shade(&x);
    roughen(&x);
    size_t n = pixels(&x) * 9;
    g_autofree float *reference = g_new(float, n);
    struct ls_linear_error errors[2] = {{0}};
    const struct ls_linear_kernels *kernels[2] = {&ls_linear_kernels_c,
                                                  ls_linear_kernels(isas_of(data))};
    for (int k = 0; k < 2; k++) {
        const struct ls_linear_part part = {
            .width = 131, .height = 24, .out = k ? x.m : reference, .step = 1, .error = &errors[k]};
        g_assert_cmpint(ls_linear_fit_part_with(kernels[k], &x.pictures, &x.options, &part, NULL),
                        ==, LS_OK);
    }
    g_assert_cmpmem(x.m, n * sizeof(float), reference, n * sizeof(float));
    g_assert_cmpmem(&errors[0], sizeof errors[0], &errors[1], sizeof errors[1]);
    g_assert_cmpuint(errors[0].pixels, >, 1000);
    tear_down(&x);
}

static void test_any_rectangle_has_the_bits_of_the_whole(void)
{
    enum { W = 70, H = 60, X = 23, Y = 19, NX = 30, NY = 25, HALO = LS_LINEAR_HALO_PX };
    enum { CW = NX + 2 * HALO, CH = NY + 2 * HALO };
    struct fixture x, cut;
    set_up(&x, W, H, 4, 3, 3);
    set_up(&cut, CW, CH, 4, 3, 3);
    shade(&x);
    roughen(&x);
    roughen(&cut); /* its noise */
    for (int g = 0; g < 4; g++)
        for (int y = 0; y < CH; y++) {
            size_t from = ((size_t)(Y - HALO + y) * W + X - HALO) * 3, to = (size_t)y * CW * 3;
            memcpy(cut.v[g] + to, x.v[g] + from, CW * 3 * sizeof(float));
            memcpy(cut.f[g] + to, x.f[g] + from, CW * 3 * sizeof(float));
        }
    fit(&x);
    enum { STRIDE = NX * 9 + 5 };
    g_autofree float *out = g_new0(float, STRIDE *NY);
    const struct ls_linear_part part = {
        .x = HALO, .y = HALO, .width = NX, .height = NY, .out = out, .out_stride = STRIDE};
    g_assert_cmpint(ls_linear_fit_part(&cut.pictures, &cut.options, &part, NULL), ==, LS_OK);
    for (int y = 0; y < NY; y++)
        g_assert_cmpmem(out + (size_t)y * STRIDE, NX * 9 * sizeof(float),
                        x.m + ((size_t)(Y + y) * W + X) * 9, NX * 9 * sizeof(float));
    tear_down(&x);
    tear_down(&cut);
}

/* The fit without segment @out, by fitting what is left. */
static double refit_error(struct fixture *x, uint32_t out)
{
    const float *v[MAX_G], *f[MAX_G];
    uint32_t n = 0;
    for (uint32_t g = 0; g < x->pictures.n_segments; g++)
        if (g != out) {
            v[n] = x->v[g];
            f[n++] = x->f[g];
        }
    struct ls_linear_pictures rest = x->pictures;
    rest.n_segments = n;
    rest.v = v;
    rest.f = f;
    g_assert_cmpint(ls_linear_fit(&rest, &x->options, 0, rest.height, x->m, NULL), ==, LS_OK);
    double sum = 0;
    for (size_t i = 0; i < pixels(x) * 3; i++) {
        double d = -(double)x->f[out][i];
        for (int a = 0; a < 3; a++)
            d += (double)x->m[i * 3 + a] * (double)x->v[out][i / 3 * 3 + a];
        sum += d * d;
    }
    return sum;
}

static void test_leaving_one_out_is_refitting_without_it(void)
{
    struct fixture x;
    set_up(&x, 31, 9, 7, 3, 3);
    shade(&x);
    for (uint32_t g = 0; g < 7; g++)
        for (size_t i = 0; i < pixels(&x) * 3; i++)
            x.f[g][i] = x.v[g][i] * (float)g_rand_double_range(x.rand, 0.5, 1);
    double expected = 0;
    for (uint32_t g = 0; g < 7; g++)
        expected += refit_error(&x, g);
    struct ls_linear_error e = {0};
    g_assert_cmpint(ls_linear_leave_one_out(&x.pictures, &x.options, 0, 4, 1, &e, NULL, NULL), ==,
                    LS_OK);
    g_assert_cmpint(ls_linear_leave_one_out(&x.pictures, &x.options, 4, 5, 1, &e, NULL, NULL), ==,
                    LS_OK);
    g_assert_cmpuint(e.pixels, ==, pixels(&x));
    /* M and the sums as floats in the refit */
    g_assert_cmpfloat_with_epsilon(e.difference / expected, 1, 1e-4);
    struct ls_linear_error third = {0};
    float per_pixel[31 * 9];
    g_assert_cmpint(
        ls_linear_leave_one_out(&x.pictures, &x.options, 0, 9, 3, &third, per_pixel, NULL), ==,
        LS_OK);
    g_assert_cmpuint(third.pixels, ==, 11 * 3);
    tear_down(&x);
}

static void test_noise_alone_is_told_as_noise(void)
{
    struct fixture x;
    set_up(&x, 64, 64, 14, 3, 3);
    g_autofree double *truth = g_new(double, pixels(&x) * 9);
    shade_from(&x, 1);
    reflect(&x, truth);
    x.options.dielectric_weight = 0;
    for (int g = 0; g < 14; g++) {
        x.noise[g] = (struct ls_linear_noise){1e-6, 0};
        for (size_t i = 0; i < pixels(&x) * 3; i++) { /* uniform of variance 1e-6 */
            x.f[g][i] += (float)(1e-3 * sqrt(3) * g_rand_double_range(x.rand, -1, 1));
            x.v[g][i] += (float)(1e-3 * sqrt(3) * g_rand_double_range(x.rand, -1, 1));
        }
    }
    x.pictures.total_noise.floor = 14e-6;
    struct ls_linear_error e = {0};
    g_assert_cmpint(ls_linear_leave_one_out(&x.pictures, &x.options, 0, 64, 1, &e, NULL, NULL), ==,
                    LS_OK);
    /* more than its own noise by that of M, fitted on 13 rows for 3 unknowns: 3 / 10 on average */
    g_assert_cmpfloat(e.difference / e.noise, >, 1);
    g_assert_cmpfloat(e.difference / e.noise, <, 1.6);
    tear_down(&x);
}

static void test_a_light_alone_tells_its_highlights(void)
{
    enum { N = 4 };
    const float m[N * 1] = {0.5f, 0.5f, 0.5f, 0.5f}, v[N] = {1, 1, 20, NAN};
    const float total[N] = {100, 100, 100, 100}, f[N] = {0.5f, 0.6f, 8, 1};
    const struct ls_linear_light light = {N, 1, 1, 346, 1, v, total, m, f};
    struct ls_linear_error all = {0}, highlights = {0};
    ls_linear_check_light(&light, &all, &highlights);
    g_assert_cmpuint(all.pixels, ==, 3);
    g_assert_cmpuint(highlights.pixels, ==, 1);
    g_assert_cmpfloat_with_epsilon(highlights.difference, 4, 1e-9);
    g_assert_cmpfloat_with_epsilon(all.difference, 4.01, 1e-6);
    g_assert_cmpfloat_with_epsilon(all.total, 0.25 + 0.36 + 64, 1e-5);
}

static void test_a_matrix_is_applied_to_every_pixel(void)
{
    const float m[12] = {1, 2, 3, 4, 5, 6, 0, 0, 1, 1, 1, 0}, v[4] = {10, 1, 2, 3};
    float out[6];
    ls_linear_apply(m, v, 2, 2, 3, out);
    const float expected[6] = {12, 34, 56, 0, 5, 2};
    g_assert_cmpmem(out, sizeof out, expected, sizeof expected);
}

static void test_what_is_no_fit_is_refused(void)
{
    struct fixture x;
    set_up(&x, 2, 2, 2, 3, 3);
    struct ls_diag diag = {0};
    static const double bad[3] = {1, NAN, 1};
    for (int k = 0; k < 12; k++) {
        struct ls_linear_pictures p = x.pictures;
        struct ls_linear_options o = x.options;
        uint32_t first = 0, rows = 2;
        switch (k) {
        case 0:
            p.n_in = 0;
            break;
        case 1:
            p.n_in = LS_LINEAR_MAX_INPUTS + 1;
            break;
        case 2:
            p.n_out = 2;
            break;
        case 3:
            p.n_segments = 0;
            break;
        case 4:
            p.inputs[2] = 3;
            break;
        case 5:
            p.p_in = bad;
            break;
        case 6:
            p.p_out = bad;
            break;
        case 7:
            o.ridge = 0;
            break;
        case 8:
            o.row_floor = NAN;
            break;
        case 9:
            o.dielectric_weight = -1;
            break;
        case 10:
            first = 1;
            break;
        default:
            p.total_noise.floor = NAN;
            break;
        }
        g_assert_cmpint(ls_linear_fit(&p, &o, first, rows, x.m, &diag), ==, LS_ERR_INVALID);
        g_assert_cmpstr(diag.text, !=, "");
    }
    struct ls_linear_error e = {0};
    x.pictures.n_segments = 1;
    g_assert_cmpint(ls_linear_leave_one_out(&x.pictures, &x.options, 0, 2, 1, &e, NULL, &diag), ==,
                    LS_ERR_STATE);
    tear_down(&x);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/linear/one-segment-is-eq-1-to-the-bit", test_one_segment_is_eq_1);
    g_test_add_func("/linear/a-linear-surface-is-found-exactly",
                    test_a_linear_surface_is_found_exactly);
    g_test_add_func("/linear/the-fit-is-that-of-long-double", test_the_fit_is_that_of_long_double);
    g_test_add_func("/linear/the-full-sphere-is-reproduced", test_the_full_sphere_is_reproduced);
    g_test_add_func("/linear/a-white-highlight-stays-white", test_a_white_highlight_stays_white);
    g_test_add_func("/linear/any-band-has-the-bits-of-the-whole",
                    test_any_band_has_the_bits_of_the_whole);
    g_test_add_func("/linear/any-rectangle-has-the-bits-of-the-whole",
                    test_any_rectangle_has_the_bits_of_the_whole);
    isas_add("/linear/every-instruction-set-has-the-same-bits",
             test_every_instruction_set_has_the_same_bits);
    g_test_add_func("/linear/the-result-is-finite-whatever-comes",
                    test_the_result_is_finite_whatever_comes);
    g_test_add_func("/linear/leaving-one-out-is-refitting-without-it",
                    test_leaving_one_out_is_refitting_without_it);
    g_test_add_func("/linear/noise-alone-is-told-as-noise", test_noise_alone_is_told_as_noise);
    g_test_add_func("/linear/a-light-alone-tells-its-highlights",
                    test_a_light_alone_tells_its_highlights);
    g_test_add_func("/linear/a-matrix-is-applied-to-every-pixel",
                    test_a_matrix_is_applied_to_every_pixel);
    g_test_add_func("/linear/what-is-no-fit-is-refused", test_what_is_no_fit_is_refused);
    return g_test_run();
}
