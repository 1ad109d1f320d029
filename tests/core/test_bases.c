#include "core/bases.h"

#include <glib.h>
#include <math.h>
#include <stdlib.h>

static void test_order(void)
{
    static const uint32_t cases[][2] = {{1, 3},   {2, 3},     {3, 7},     {6, 7},     {7, 11},
                                        {18, 19}, {345, 347}, {346, 347}, {347, 359}, {4096, 4099}};
    for (size_t k = 0; k < G_N_ELEMENTS(cases); k++)
        g_assert_cmpuint(ls_multiplex_order(cases[k][0]), ==, cases[k][1]);
}

/* S times 2 (2 S^T - J) / (p + 1), in whole numbers: (p + 1) / 2 times the identity, doubled. */
static void test_inverse(void)
{
    static const uint32_t orders[] = {3, 7, 11, 19, 347};
    for (size_t k = 0; k < G_N_ELEMENTS(orders); k++) {
        uint32_t p = orders[k];
        uint8_t *s = g_new(uint8_t, (size_t)p * p);
        for (uint32_t row = 0; row < p; row++)
            ls_multiplex_row(p, row, s + (size_t)row * p);
        for (uint32_t a = 0; a < p; a++)
            for (uint32_t b = 0; b < p; b++) {
                int sum = 0;
                for (uint32_t c = 0; c < p; c++)
                    sum += s[a * p + c] * (2 * s[b * p + c] - 1);
                g_assert_cmpint(2 * sum, ==, a == b ? (int)p + 1 : 0);
            }
        g_free(s);
    }
}

/* A product of 32 Gauss points in height and 64 azimuths integrates polynomials of degree 31
 * exactly, so only rounding is left: 1e-12. */
enum {
    HEIGHTS = 32,
    AZIMUTHS = 64,
    COUNT = (LS_HARMONICS_MAX_DEGREE + 1) * (LS_HARMONICS_MAX_DEGREE + 1)
};

static void gauss(int n, double *x, double *w)
{
    for (int i = 0; i < n; i++) {
        double derivative = 0;
        x[i] = cos(M_PI * (i + 0.75) / (n + 0.5));
        for (int step = 0; step < 10; step++) {
            double before = 1, now = x[i];
            for (int l = 2; l <= n; l++) {
                double next = ((2 * l - 1) * x[i] * now - (l - 1) * before) / l;
                before = now;
                now = next;
            }
            derivative = n * (x[i] * now - before) / (x[i] * x[i] - 1);
            x[i] -= now / derivative;
        }
        w[i] = 2 / ((1 - x[i] * x[i]) * derivative * derivative);
    }
}

static void test_orthonormal(void)
{
    double x[HEIGHTS], w[HEIGHTS];
    gauss(HEIGHTS, x, w);
    double *gram = g_new0(double, COUNT *COUNT);
    for (int h = 0; h < HEIGHTS; h++)
        for (int a = 0; a < AZIMUTHS; a++) {
            double phi = 2 * M_PI * a / AZIMUTHS, r = sqrt(1 - x[h] * x[h]), y[COUNT];
            const float v[3] = {(float)(r * sin(phi)), (float)x[h], (float)(r * cos(phi))};
            for (uint32_t i = 0; i < COUNT; i++)
                y[i] = ls_harmonic(i, v);
            for (int i = 0; i < COUNT; i++)
                for (int j = 0; j < COUNT; j++)
                    gram[i * COUNT + j] += w[h] * 2 * M_PI / AZIMUTHS * y[i] * y[j];
        }
    /* directions come as floats: 6e-8 each, times a slope of about degree^2, times values of 4 */
    for (int i = 0; i < COUNT; i++)
        for (int j = 0; j < COUNT; j++)
            g_assert_cmpfloat(fabs(gram[i * COUNT + j] - (i == j)), <, 2e-6);
    g_free(gram);
}

static void test_axes(void)
{
    const float v[3] = {0.6f, 1.6f, -1.2f}; /* length 2.0881 */
    double length = sqrt(0.36 + 2.56 + 1.44), k = sqrt(3 / (4 * M_PI)) / length;
    /* float directions: 1e-7 */
    g_assert_cmpfloat(fabs(ls_harmonic(0, v) - sqrt(1 / (4 * M_PI))), <, 1e-7);
    g_assert_cmpfloat(fabs(ls_harmonic(1, v) - k * 0.6), <, 1e-7);
    g_assert_cmpfloat(fabs(ls_harmonic(2, v) - k * 1.6), <, 1e-7);
    g_assert_cmpfloat(fabs(ls_harmonic(3, v) - k * -1.2), <, 1e-7);
}

static void test_weights(void)
{
    enum { N = 346 };
    float d[N][3];
    double biased[N], positive[N], negative[N];
    guint32 seed = g_test_rand_int();
    GRand *rand = g_rand_new_with_seed(seed);
    g_test_message("seed %u", seed);
    for (int i = 0; i < N; i++)
        for (int k = 0; k < 3; k++)
            d[i][k] = (float)g_rand_double_range(rand, -1, 1) + (k == 2 ? 1e-3f : 0);
    for (uint32_t index = 0; index < COUNT; index++) {
        double peak = ls_harmonic_weights(index, LS_BASIS_BIASED, (const float(*)[3])d, N, biased);
        ls_harmonic_weights(index, LS_BASIS_POSITIVE, (const float(*)[3])d, N, positive);
        ls_harmonic_weights(index, LS_BASIS_NEGATIVE, (const float(*)[3])d, N, negative);
        double most = 0;
        for (int i = 0; i < N; i++) {
            double y = ls_harmonic(index, d[i]);
            g_assert_true(biased[i] >= 0 && biased[i] <= 1);
            g_assert_true(positive[i] >= 0 && negative[i] >= 0 && positive[i] * negative[i] == 0);
            /* rounding of a few operations */
            g_assert_cmpfloat(fabs(peak * (2 * biased[i] - 1) - y), <, 1e-14 * (1 + peak));
            g_assert_cmpfloat(fabs(peak * (positive[i] - negative[i]) - y), <, 1e-14 * (1 + peak));
            most = fmax(most, fmax(positive[i], negative[i]));
        }
        g_assert_cmpfloat(most, ==, 1);
    }
    g_rand_free(rand);
}

static void test_gradients(void)
{
    const float d[3][3] = {{2, 0, 0}, {0, -3, 0}, {0, 3, 4}};
    static const double expected[3][3] = {{1, 0.5, 0.5}, {0.5, 0, 0.8}, {0.5, 0.5, 0.9}};
    double w[3];
    for (unsigned axis = 0; axis < 3; axis++) {
        ls_gradient_weights(axis, d, 3, w);
        for (int i = 0; i < 3; i++)
            g_assert_cmpfloat(fabs(w[i] - expected[axis][i]), <, 1e-15);
    }
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/bases/multiplexing-takes-the-least-prime-with-a-column-to-spare", test_order);
    g_test_add_func("/bases/the-multiplexing-matrix-has-its-inverse", test_inverse);
    g_test_add_func("/bases/harmonics-are-orthonormal", test_orthonormal);
    g_test_add_func("/bases/degree-one-points-along-x-y-z", test_axes);
    g_test_add_func("/bases/weights-can-be-shown-and-give-back-the-harmonic", test_weights);
    g_test_add_func("/bases/gradients-rise-along-their-axis", test_gradients);
    return g_test_run();
}
