#include "tests/core/random_segments.h"

#include <math.h>
#include <string.h>

enum { SEED = 3 };

/* The fit without segment @out, by fitting what is left. */
static double refit_error(struct random_segments *x, uint32_t out)
{
    const float *v[RANDOM_SEGMENTS_MAX], *f[RANDOM_SEGMENTS_MAX];
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
    rest.n_lights -= rest.n_lights / x->pictures.n_segments;
    const struct ls_linear_part whole = random_segments_whole(x, 0, NULL);
    g_assert_cmpint(ls_linear_fit(&rest, &x->options, &whole, NULL), ==, LS_OK);
    double sum = 0;
    for (size_t i = 0; i < random_segments_pixels(x) * 3; i++) {
        double d = -(double)x->f[out][i];
        for (int a = 0; a < 3; a++)
            d += (double)x->m[i * 3 + a] * (double)x->v[out][i / 3 * 3 + a];
        sum += d * d;
    }
    return sum;
}

static void test_leaving_one_out_is_refitting_without_it(void)
{
    struct random_segments x;
    random_segments_init(&x, SEED, 31, 9, 7, 3, 3);
    random_segments_shade(&x, 0.01);
    for (uint32_t g = 0; g < 7; g++) /* alike: what is left knows no other noise */
        x.noise[g] = (struct ls_linear_noise){1e-4, 1e-3};
    for (uint32_t g = 0; g < 7; g++)
        for (size_t i = 0; i < random_segments_pixels(&x) * 3; i++)
            x.f[g][i] = x.v[g][i] * (float)g_rand_double_range(x.rand, 0.5, 1);
    double expected = 0;
    for (uint32_t g = 0; g < 7; g++)
        expected += refit_error(&x, g);
    struct ls_linear_error e = {0};
    const struct ls_linear_part top = {.width = 31, .height = 4, .step = 1, .error = &e},
                                bottom = {.y = 4, .width = 31, .height = 5, .step = 1, .error = &e};
    g_assert_cmpint(ls_linear_fit(&x.pictures, &x.options, &top, NULL), ==, LS_OK);
    g_assert_cmpint(ls_linear_fit(&x.pictures, &x.options, &bottom, NULL), ==, LS_OK);
    g_assert_cmpuint(e.pixels, ==, random_segments_pixels(&x));
    /* M and the sums as floats in the refit */
    g_assert_cmpfloat_with_epsilon(e.difference / expected, 1, 1e-4);
    struct ls_linear_error third = {0};
    const struct ls_linear_part some = random_segments_whole(&x, 3, &third);
    g_assert_cmpint(ls_linear_fit(&x.pictures, &x.options, &some, NULL), ==, LS_OK);
    g_assert_cmpuint(third.pixels, ==, 11 * 3);
    random_segments_finish(&x);
}

static void test_noise_alone_is_told_as_noise(void)
{
    struct random_segments x;
    random_segments_init(&x, SEED, 64, 64, 14, 3, 3);
    g_autofree double *truth = g_new(double, random_segments_pixels(&x) * 9);
    random_segments_shade(&x, 1);
    random_segments_reflect(&x, truth);
    x.options.dielectric_weight = 0;
    for (int g = 0; g < 14; g++) {
        x.noise[g] = (struct ls_linear_noise){1e-6, 0};
        for (size_t i = 0; i < random_segments_pixels(&x) * 3; i++) { /* uniform of variance 1e-6 */
            x.f[g][i] += (float)(1e-3 * sqrt(3) * g_rand_double_range(x.rand, -1, 1));
            x.v[g][i] += (float)(1e-3 * sqrt(3) * g_rand_double_range(x.rand, -1, 1));
        }
    }
    x.pictures.total_noise.floor = 14e-6;
    struct ls_linear_error e = {0};
    const struct ls_linear_part whole = random_segments_whole(&x, 1, &e);
    g_assert_cmpint(ls_linear_fit(&x.pictures, &x.options, &whole, NULL), ==, LS_OK);
    /* more than its own noise by that of M, fitted on 13 rows for 3 unknowns: 3 / 10 on average */
    g_assert_cmpfloat(e.difference / e.noise, >, 1);
    g_assert_cmpfloat(e.difference / e.noise, <, 1.6);
    /* 20 lights to a segment: M, near 1 on the diagonal with 0.15 beside it, passes on about the
     * noise of the V it is given, which is about half of all; of one light 20 times as much */
    g_assert_cmpfloat(e.single / e.noise, >, 20 * 0.4);
    g_assert_cmpfloat(e.single / e.noise, <, 20 * 0.7);
    g_assert_cmpfloat_with_epsilon(ls_linear_estimate(&e),
                                   sqrt((e.difference - e.noise + e.single) / e.total), 1e-12);
    random_segments_finish(&x);
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

static void test_fewer_than_three_tell_nothing(void)
{
    struct random_segments x;
    random_segments_init(&x, SEED, 2, 2, 2, 3, 3);
    struct ls_diag diag = {0};
    struct ls_linear_error e = {0};
    const struct ls_linear_part whole = random_segments_whole(&x, 1, &e);
    g_assert_cmpint(ls_linear_fit(&x.pictures, &x.options, &whole, &diag), ==, LS_ERR_STATE);
    g_assert_nonnull(strstr(diag.text, "2 segments"));
    g_assert_cmpuint(e.pixels, ==, 0);
    random_segments_finish(&x);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/linear/leaving-one-out-is-refitting-without-it",
                    test_leaving_one_out_is_refitting_without_it);
    g_test_add_func("/linear/noise-alone-is-told-as-noise", test_noise_alone_is_told_as_noise);
    g_test_add_func("/linear/fewer-than-three-segments-tell-nothing",
                    test_fewer_than_three_tell_nothing);
    g_test_add_func("/linear/a-light-alone-tells-its-highlights",
                    test_a_light_alone_tells_its_highlights);
    return g_test_run();
}
