#include "tests/core/random_segments.h"

#include <math.h>
#include <string.h>

enum { SEED = 3 };

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

static long double variance_of(const struct ls_linear_noise *noise, float x)
{
    return (long double)noise->floor + (long double)noise->shot * fmaxl(x, 0);
}

/* Row c of M at a pixel, from the conditions of Lagrange of the header's formula. */
static void reference(const struct random_segments *x, size_t pixel, uint32_t c, long double *m)
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
        unit += (long double)random_segments_white[a] / n;
    }
    long double ratio = f_sum / sum[in], trust = (long double)x->options.row_noise;
    const struct ls_linear_noise *noise = &x->noise[0]; /* all alike */
    for (uint32_t g = 0; g <= p->n_segments; g++) {
        long double row[8], y, b = 0, weight;
        for (uint32_t a = 0; a < n; a++) {
            row[a] = g < p->n_segments ? (long double)p->v[g][pixel * n + a] / mean
                                       : (long double)random_segments_white[a] / unit;
            b += row[a] / n;
        }
        y = g < p->n_segments ? (long double)p->f[g][pixel * p->n_out + c] / mean
                              : (long double)random_segments_amber[c] / unit;
        y -= row[in] * ratio;
        if (b < (long double)x->options.row_floor)
            b = (long double)x->options.row_floor;
        long double variance = 0, unit_f = 0;
        for (uint32_t k = 0; k < p->n_out; k++)
            unit_f += (long double)random_segments_amber[k] / p->n_out;
        for (uint32_t k = 0; k < p->n_out && g < p->n_segments; k++)
            variance += unit * unit / (unit_f * unit_f) / p->n_out *
                        variance_of(noise, p->f[g][pixel * p->n_out + k]);
        for (uint32_t a = 0; a < n && g < p->n_segments; a++)
            variance += variance_of(noise, p->v[g][pixel * n + a]) / n;
        b = b * b + variance / (mean * mean * trust * trust);
        weight = g < p->n_segments ? 1 / (b * p->n_segments)
                                   : (long double)x->options.dielectric_weight *
                                         (long double)x->options.dielectric_weight;
        for (uint32_t a = 0; a < n; a++) {
            for (uint32_t k = 0; k < n; k++)
                kkt[a][k] += weight * row[a] * row[k];
            kkt[a][n + 1] += weight * row[a] * y;
        }
    }
    for (uint32_t a = 0; a < n; a++) {
        long double light = (long double)p->n_lights / p->n_segments / (mean * mean) *
                            variance_of(noise, (float)(sum[a] / p->n_segments));
        kkt[a][a] += (long double)x->options.noise_ridge * light;
        kkt[a][n + 1] -= a == in ? (long double)x->options.noise_ridge * light * ratio : 0;
        trace += kkt[a][a];
    }
    for (uint32_t a = 0; a < n; a++) {
        kkt[a][a] += (long double)x->options.ridge * trace / n;
        kkt[a][n] = kkt[n][a] = sum[a] / mean;
    }
    eliminate(kkt, (int)n + 1, z);
    for (uint32_t a = 0; a < n; a++)
        m[a] = z[a] + (a == in ? ratio : 0);
}

static void test_one_segment_is_eq_1(void)
{
    struct random_segments x;
    random_segments_init(&x, SEED, 23, 19, 1, 3, 3);
    x.noise[0] = x.pictures.total_noise = (struct ls_linear_noise){4e-4, 1e-3};
    x.pictures.demosaiced = true;
    size_t n = random_segments_pixels(&x) * 3;
    g_autofree float *sigma = g_new(float, n), *ratio = g_new(float, n);
    double neutral[3];
    random_segments_shade(&x, 0.01);
    for (size_t i = 0; i < n; i++) {
        x.f[0][i] = (float)g_rand_double_range(x.rand, -0.1, 1);
        x.v[0][i] *= i % 7 ? 1.0f : -0.02f;
        sigma[i] = (float)sqrt(4e-4 + 1e-3 * fmax((double)x.v[0][i], 0));
    }
    x.v[0][100] = NAN;
    for (int c = 0; c < 3; c++)
        neutral[c] = random_segments_amber[c] / random_segments_white[c];
    ls_promote_add_contrast(x.v[0], 23, 19, 3, sigma);
    g_assert_cmpint(ls_promote_ratio(x.f[0], x.v[0], sigma, 23, 19, 3, neutral, ratio, NULL), ==,
                    LS_OK);
    random_segments_fit(&x);
    for (size_t i = 0; i < n * 3; i++) {
        size_t c = i / 3 % 3, a = i % 3;
        float expected = a == c ? ratio[i / 3] : 0;
        g_assert_cmpmem(&x.m[i], sizeof(float), &expected, sizeof(float));
    }
    random_segments_finish(&x);
}

static void test_a_linear_surface_is_found_exactly(void)
{
    for (uint32_t n_in = 1; n_in <= LS_LINEAR_MAX_INPUTS; n_in++)
        for (uint32_t n_out = 1; n_out <= 3; n_out += 2) {
            struct random_segments x;
            random_segments_init(&x, SEED, 17, 5, 14, n_in, n_out);
            x.options.ridge = 1e-9;
            x.options.dielectric_weight = 0;
            g_autofree double *truth = g_new(double, random_segments_pixels(&x) * n_in * n_out);
            random_segments_shade(&x, 0.01);
            random_segments_reflect(&x, truth);
            random_segments_fit(&x);
            /* floats of f, 6e-8, over the least singular value of the rows, about 1e-2 */
            for (size_t i = 0; i < random_segments_pixels(&x) * n_in * n_out; i++)
                g_assert_cmpfloat_with_epsilon((double)x.m[i], truth[i], 5e-5);
            random_segments_finish(&x);
        }
}

static void test_the_fit_is_that_of_long_double(void)
{
    for (uint32_t n_in = 1; n_in <= LS_LINEAR_MAX_INPUTS; n_in++) {
        struct random_segments x;
        random_segments_init(&x, SEED, 70, 3, 14, n_in, 3);
        random_segments_shade(&x, 0.01);
        for (uint32_t g = 0; g < 14; g++)
            for (size_t i = 0; i < random_segments_pixels(&x) * 3; i++)
                x.f[g][i] = (float)g_rand_double_range(x.rand, 0, 1) * x.v[g][i / 3 * n_in];
        for (uint32_t g = 0; g < 7; g++) /* pairs of like rows in some pixels */
            memcpy(x.v[g + 7], x.v[g], 70 * n_in * sizeof(float));
        for (uint32_t g = 0; g < 14; g++)
            x.noise[g] = (struct ls_linear_noise){1e-6, n_in % 2 ? 1e-4 : 0};
        random_segments_fit(&x);
        for (size_t i = 0; i < random_segments_pixels(&x); i++)
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
        random_segments_finish(&x);
    }
}

static void test_the_full_sphere_is_reproduced(void)
{
    struct random_segments x;
    random_segments_init(&x, SEED, 41, 7, 6, 3, 3);
    random_segments_shade(&x, 0.01);
    for (uint32_t g = 0; g < 6; g++)
        for (size_t i = 0; i < random_segments_pixels(&x) * 3; i++)
            x.f[g][i] = (float)g_rand_double_range(x.rand, -0.1, 1);
    random_segments_fit(&x);
    for (size_t i = 0; i < random_segments_pixels(&x) * 3; i++) {
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
    random_segments_finish(&x);
}

static void test_a_white_highlight_stays_white(void)
{
    struct random_segments x;
    random_segments_init(&x, SEED, 8, 8, 14, 3, 3);
    const double wax[3] = {0.5, 0.03, 0.02}; /* F / V differs from p(s) / p(0) by the material */
    const double ratio[3] = {0.9, 0.5, 0.01};
    for (uint32_t g = 0; g < 14; g++)
        for (size_t i = 0; i < random_segments_pixels(&x) * 3; i++) {
            double v = wax[i % 3] * (1 + g % 3), gloss = g == 5 ? 0.01 : 0;
            x.v[g][i] =
                (float)(v * random_segments_white[i % 3] + gloss * random_segments_white[i % 3]);
            x.f[g][i] = (float)(v * random_segments_white[i % 3] * ratio[i % 3] +
                                gloss * random_segments_amber[i % 3]);
        }
    random_segments_fit(&x);
    for (size_t i = 0; i < random_segments_pixels(&x) * 3; i++) {
        double f = 0;
        for (int a = 0; a < 3; a++)
            f += (double)x.m[i * 3 + a] * random_segments_white[a];
        /* 2 % of the brightest channel, as the ridge allows; Eq. 1 is wrong by 13 % of green's
         * 0.37 and more */
        g_assert_cmpfloat_with_epsilon(f, random_segments_amber[i % 3],
                                       0.02 * random_segments_amber[0]);
    }
    random_segments_finish(&x);
}

/* Where nothing is lit nothing is known but the colours of the light. */
static void test_the_dark_takes_the_lights_own_ratio(void)
{
    for (uint32_t segments = 1; segments <= 14; segments += 13) {
        struct random_segments x;
        random_segments_init(&x, SEED, 9, 7, segments, 3, 3);
        x.noise[0] = x.pictures.total_noise = (struct ls_linear_noise){4e-4, 1e-3};
        random_segments_fit(&x);
        for (size_t i = 0; i < random_segments_pixels(&x) * 9; i++) {
            size_t c = i / 3 % 3, a = i % 3;
            double own = random_segments_amber[c] / random_segments_white[c];
            /* kept as a float */
            g_assert_cmpfloat_with_epsilon((double)x.m[i], a == c ? own : 0, 1e-6);
        }
        random_segments_finish(&x);
    }
}

static void test_a_matrix_is_applied_to_every_pixel(void)
{
    const float m[12] = {1, 2, 3, 4, 5, 6, 0, 0, 1, 1, 1, 0}, v[4] = {10, 1, 2, 3};
    float out[6];
    ls_linear_apply(m, v, 2, 2, 3, out);
    const float expected[6] = {12, 34, 56, 0, 5, 2};
    g_assert_cmpmem(out, sizeof out, expected, sizeof expected);
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
    g_test_add_func("/linear/the-dark-takes-the-lights-own-ratio",
                    test_the_dark_takes_the_lights_own_ratio);
    g_test_add_func("/linear/a-matrix-is-applied-to-every-pixel",
                    test_a_matrix_is_applied_to_every_pixel);
    return g_test_run();
}
