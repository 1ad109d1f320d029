#include "core/mono_blend.h"
#include "core/segments.h"

#include <glib.h>
#include <math.h>
#include <string.h>

enum { LIGHTS = 150, G = 6, W = 19, H = 31, PIXELS = W * H, SEED = 5 };

/** A surface whose ratio changes with the light's direction, under LIGHTS lights. */
struct fixture {
    GRand *rand;
    float directions[LIGHTS][3];
    uint32_t segment[LIGHTS];
    double phi[LIGHTS * G], others[G * G];
    float white[LIGHTS][PIXELS], colour[LIGHTS][PIXELS];
    float v[G][PIXELS], u[G][PIXELS], f[G][PIXELS];
    const float *vs[G], *us[G], *fs[G];
    struct ls_linear_noise noise[G];
    struct ls_mono_blend_pictures pictures;
    float r[PIXELS * G];
};

static void set_up(struct fixture *x, double slope)
{
    x->rand = g_rand_new_with_seed(SEED);
    g_test_message("seed %d", SEED);
    for (int i = 0; i < LIGHTS; i++) {
        double z = 1 - (2 * i + 1.0) / LIGHTS, r = sqrt(1 - z * z), a = i * 2.399963229728653;
        memcpy(x->directions[i], (float[3]){(float)(r * cos(a)), (float)(r * sin(a)), (float)z},
               sizeof x->directions[i]);
        for (int j = 0; j < PIXELS; j++) {
            x->white[i][j] = (float)g_rand_double_range(x->rand, 0.1, 1);
            x->colour[i][j] = (float)((0.5 + slope * z) * (double)x->white[i][j]);
        }
    }
    const float(*d)[3] = (const float(*)[3])x->directions;
    g_assert_cmpint(ls_segments_partition(d, LIGHTS, G, x->segment, NULL), ==, LS_OK);
    g_assert_cmpint(ls_mono_blend_weights(d, LIGHTS, x->segment, G, x->phi, NULL), ==, LS_OK);
    ls_mono_blend_others(x->phi, LIGHTS, x->segment, G, x->others);
    memset(x->v, 0, sizeof x->v);
    memset(x->u, 0, sizeof x->u);
    memset(x->f, 0, sizeof x->f);
    for (int i = 0; i < LIGHTS; i++)
        for (int j = 0; j < PIXELS; j++) {
            x->v[x->segment[i]][j] += x->white[i][j];
            x->f[x->segment[i]][j] += x->colour[i][j];
            for (int g = 0; g < G; g++)
                x->u[g][j] += (float)x->phi[i * G + g] * x->white[i][j];
        }
    memset(x->noise, 0, sizeof x->noise);
    for (int g = 0; g < G; g++) {
        x->vs[g] = x->v[g];
        x->us[g] = x->u[g];
        x->fs[g] = x->f[g];
    }
    x->pictures = (struct ls_mono_blend_pictures){.width = W,
                                                  .height = H,
                                                  .n_segments = G,
                                                  .n_lights = LIGHTS,
                                                  .v = x->vs,
                                                  .u = x->us,
                                                  .f = x->fs,
                                                  .v_noise = x->noise,
                                                  .f_noise = x->noise,
                                                  .neutral = 0.5,
                                                  .others = x->others};
}

static void tear_down(struct fixture *x)
{
    g_rand_free(x->rand);
    g_free(x);
}

static void blend(struct fixture *x)
{
    const struct ls_linear_part all = {.width = W, .height = H, .out = x->r};
    g_assert_cmpint(ls_mono_blend_fit(&x->pictures, &all, NULL), ==, LS_OK);
}

static void test_weights_are_a_smooth_partition_of_unity(void)
{
    struct fixture *x = g_new0(struct fixture, 1);
    set_up(x, 0);
    for (int i = 0; i < LIGHTS; i++) {
        double sum = 0;
        for (int g = 0; g < G; g++) {
            g_assert_cmpfloat(x->phi[i * G + g], >=, 0);
            sum += x->phi[i * G + g];
        }
        g_assert_cmpfloat_with_epsilon(sum, 1, 1e-14);
        for (int k = 0; k < i; k++) {
            double angle = 0, most = 0;
            for (int c = 0; c < 3; c++)
                angle += pow((double)(x->directions[i][c] - x->directions[k][c]), 2);
            for (int g = 0; g < G; g++)
                most = fmax(most, fabs(x->phi[i * G + g] - x->phi[k * G + g]));
            /* the slope of a logistic of G x, x the difference of two cosines (at most 2 per
             * radian), is at most G / 2 */
            g_assert_cmpfloat(most, <=, G / 2.0 * sqrt(angle) + 1e-12);
        }
    }
    tear_down(x);
}

static void test_the_full_sphere_is_reproduced(void)
{
    struct fixture *x = g_new0(struct fixture, 1);
    set_up(x, 0.3);
    blend(x);
    for (int j = 0; j < PIXELS; j++) {
        double made = 0, photographed = 0;
        for (int i = 0; i < LIGHTS; i++) {
            photographed += (double)x->colour[i][j];
            for (int g = 0; g < G; g++)
                made += x->phi[i * G + g] * (double)x->r[j * G + g] * (double)x->white[i][j];
        }
        /* rounding of 150 floats */
        g_assert_cmpfloat_with_epsilon(made / photographed, 1, 3e-6);
    }
    tear_down(x);
}

/* Relative RMS error of every light's promoted picture, blended or by Eq. 1. */
static double field_error(const struct fixture *x, bool blended)
{
    double difference = 0, total = 0;
    for (int j = 0; j < PIXELS; j++) {
        double f = 0, v = 0;
        for (int g = 0; g < G; g++) {
            f += (double)x->f[g][j];
            v += (double)x->v[g][j];
        }
        for (int i = 0; i < LIGHTS; i++) {
            double r = blended ? 0 : f / v;
            for (int g = 0; g < G && blended; g++)
                r += x->phi[i * G + g] * (double)x->r[j * G + g];
            difference += pow(r * (double)x->white[i][j] - (double)x->colour[i][j], 2);
            total += pow((double)x->colour[i][j], 2);
        }
    }
    return sqrt(difference / total);
}

static void test_a_ratio_that_follows_the_light_is_followed(void)
{
    struct fixture *x = g_new0(struct fixture, 1);
    set_up(x, 0.3);
    blend(x);
    /* a slope over the whole dome seen through six smooth windows: better than half as wrong */
    g_assert_cmpfloat(field_error(x, true), <, 0.5 * field_error(x, false));
    tear_down(x);
}

static void test_one_ratio_everywhere_stays_one(void)
{
    struct fixture *x = g_new0(struct fixture, 1);
    set_up(x, 0);
    blend(x);
    for (int k = 0; k < PIXELS * G; k++)
        g_assert_cmpfloat_with_epsilon(x->r[k], 0.5, 3e-6); /* floats of sums */
    tear_down(x);
}

static void test_one_segment_is_eq_1(void)
{
    struct fixture *x = g_new0(struct fixture, 1);
    set_up(x, 0.3);
    x->pictures.n_segments = 1;
    x->pictures.total_noise = (struct ls_linear_noise){0.01, 0.5};
    const double neutral[1] = {0.5};
    float sigma[PIXELS], ratio[PIXELS];
    for (int j = 0; j < PIXELS; j++) {
        x->v[0][j] *= j % 5 ? 1.0f : 0.01f;
        sigma[j] = (float)sqrt(0.01 + 0.5 * (double)x->v[0][j]);
    }
    g_assert_cmpint(ls_promote_ratio(x->f[0], x->v[0], sigma, W, H, 1, neutral, ratio, NULL), ==,
                    LS_OK);
    blend(x);
    g_assert_cmpmem(x->r, sizeof ratio, ratio, sizeof ratio);
    tear_down(x);
}

static void test_any_band_has_the_bits_of_the_whole(void)
{
    struct fixture *x = g_new0(struct fixture, 1);
    set_up(x, 0.3);
    x->pictures.total_noise = (struct ls_linear_noise){1, 5};
    for (int g = 0; g < G; g++)
        x->noise[g] = (struct ls_linear_noise){0.1, 1};
    blend(x);
    struct ls_mono_blend_pictures band = x->pictures;
    const float *v[G], *u[G], *f[G];
    uint32_t first = 14, top = first - LS_LINEAR_HALO_PX;
    for (int g = 0; g < G; g++) {
        v[g] = x->v[g] + top * W;
        u[g] = x->u[g] + top * W;
        f[g] = x->f[g] + top * W;
    }
    band.v = v;
    band.u = u;
    band.f = f;
    band.height = 3 + 2 * LS_LINEAR_HALO_PX;
    float r[3 * W * G];
    const struct ls_linear_part part = {.y = LS_LINEAR_HALO_PX, .width = W, .height = 3, .out = r};
    g_assert_cmpint(ls_mono_blend_fit(&band, &part, NULL), ==, LS_OK);
    g_assert_cmpmem(r, sizeof r, x->r + first * W * G, sizeof r);
    tear_down(x);
}

static void test_a_surface_black_in_the_spectrum_has_no_sparks(void)
{
    struct fixture *x = g_new0(struct fixture, 1);
    set_up(x, 0);
    const double sigma = 0.01; /* largest ratio of a segment but the last */
    for (int j = 0; j < PIXELS; j++) {
        double made = 0;
        for (int g = 0; g + 1 < G; g++) {
            double r = g_rand_double_range(x->rand, -sigma, sigma);
            x->f[g][j] = (float)(r * (double)x->v[g][j]);
            made += r * (double)x->u[g][j];
        }
        /* the blend of all adds up to nothing, which what was photographed does not */
        x->f[G - 1][j] = (float)(-made / (double)x->u[G - 1][j] * (double)x->v[G - 1][j]);
    }
    blend(x);
    for (int j = 0; j < PIXELS; j++) {
        double made = 0, photographed = 0;
        for (int g = 0; g < G; g++) {
            double r = (double)x->r[j * G + g];
            /* the last one's is up to 5 x 2 sigma, segments being as bright within a factor 2;
             * twice that, and their mean */
            g_assert_cmpfloat(fabs(r), <=, 30 * sigma);
            made += r * (double)x->u[g][j];
            photographed += (double)x->f[g][j];
        }
        /* floats of ratios below 0.3, times a sum of brightness near 80 */
        g_assert_cmpfloat_with_epsilon(made, photographed, 80 * 0.3 * 0x1p-24);
    }
    tear_down(x);
}

static void test_the_result_is_finite_whatever_comes(void)
{
    static const float odd[] = {0,     1,     -1,  1e-45f, 1e-38f,   3e38f,    -3e38f,
                                1e-3f, 65504, NAN, 0.5f,   INFINITY, -INFINITY};
    struct fixture *x = g_new0(struct fixture, 1);
    set_up(x, 0.3);
    for (int round = 0; round < 20; round++) {
        for (int k = 0; k < PIXELS * G; k++) {
            int g = k / PIXELS, j = k % PIXELS;
            float *at[3] = {&x->v[g][j], &x->u[g][j], &x->f[g][j]};
            for (int n = 0; n < 3; n++)
                if (g_rand_int_range(x->rand, 0, round + 1) == 0)
                    *at[n] = odd[g_rand_int_range(x->rand, 0, G_N_ELEMENTS(odd))];
        }
        x->pictures.total_noise.floor = round % 2 ? 1 : 0;
        x->noise[1].floor = round % 3 ? 1 : 0;
        blend(x);
        for (int k = 0; k < PIXELS * G; k++)
            g_assert_true(isfinite(x->r[k]));
    }
    tear_down(x);
}

static void test_a_segment_without_light_takes_the_spheres_ratio(void)
{
    struct fixture *x = g_new0(struct fixture, 1);
    set_up(x, 0);
    for (int j = 0; j < PIXELS; j++)
        x->v[2][j] = x->f[2][j] = 0;
    blend(x);
    for (int j = 0; j < PIXELS; j++)
        g_assert_cmpfloat_with_epsilon(x->r[j * G + 2] / x->r[j * G + 1], 1, 1e-5);
    tear_down(x);
}

/* The same everywhere, so that no neighbour has another signal: only the noise changes. */
static void test_ratios_fade_as_the_light_does(void)
{
    struct fixture *x = g_new0(struct fixture, 1);
    set_up(x, 0.3);
    double v = 0;
    for (int g = 0; g < G; g++) {
        for (int j = 1; j < PIXELS; j++) {
            x->v[g][j] = x->v[g][0];
            x->u[g][j] = x->u[g][0];
            x->f[g][j] = x->f[g][0];
        }
        v += (double)x->v[g][0];
    }
    float last[G];
    double widest = 0, moved = 0;
    for (double snr = 12; snr > 3; snr *= 0.998) {
        x->pictures.total_noise.floor = pow(v / snr, 2);
        blend(x);
        const float *r = x->r + (size_t)(H / 2 * W + W / 2) * G;
        for (int g = 0; g < G && snr < 12; g++) {
            widest = fmax(widest, fabs((double)(r[g] - last[g])));
            moved = fmax(moved, fabs((double)(r[g] - x->f[g][0] / x->v[g][0])));
        }
        memcpy(last, r, sizeof last);
    }
    /* smoothstep's slope is 1.5 over 6 sigma, of which a step is at most 0.02, and n and the ratio
     * fade at once: 1 % of what fades in all; a jump would be all of it */
    g_assert_cmpfloat(moved, >, 0.05);
    g_assert_cmpfloat(widest, <, 0.02 * moved);
    tear_down(x);
}

static void test_others_are_the_rest_of_the_blend(void)
{
    struct fixture *x = g_new0(struct fixture, 1);
    set_up(x, 0);
    for (int g = 0; g < G; g++) {
        double sum = 0;
        g_assert_cmpfloat(x->others[g * G + g], ==, 0);
        for (int h = 0; h < G; h++) {
            g_assert_cmpfloat(x->others[g * G + h], >=, 0);
            sum += x->others[g * G + h];
        }
        g_assert_cmpfloat_with_epsilon(sum, 1, 1e-14);
    }
    tear_down(x);
}

static void test_what_is_left_out_tells_the_error(void)
{
    struct fixture *x = g_new0(struct fixture, 1);
    for (int k = 0; k < 2; k++) {
        struct ls_linear_error e = {0};
        set_up(x, k ? 0.3 : 0);
        const struct ls_linear_part some = {.width = W,
                                            .height = H,
                                            .out = x->r,
                                            .step = 3,
                                            .first_x = 1,
                                            .first_y = 2,
                                            .error = &e};
        g_assert_cmpint(ls_mono_blend_fit(&x->pictures, &some, NULL), ==, LS_OK);
        g_assert_cmpuint(e.pixels, ==, 6 * 10);
        double truth = field_error(x, true), estimate = ls_linear_estimate(&e);
        g_test_message("off by %.4f, estimated %.4f", truth, estimate);
        /* floats of sums; six segments are so wide that the nearest other one is far off */
        g_assert_cmpfloat(estimate, >=, k ? truth : 0);
        g_assert_cmpfloat(estimate, <=, k ? 3 * truth : 3e-6);
        g_rand_free(x->rand);
    }
    g_free(x);
}

static void test_what_is_no_blend_is_refused(void)
{
    struct fixture *x = g_new0(struct fixture, 1);
    set_up(x, 0);
    const float(*d)[3] = (const float(*)[3])x->directions;
    g_assert_cmpint(ls_mono_blend_weights(d, LIGHTS, x->segment, 0, x->phi, NULL), ==,
                    LS_ERR_INVALID);
    g_assert_cmpint(ls_mono_blend_weights(d, LIGHTS, x->segment, 2, x->phi, NULL), ==,
                    LS_ERR_INVALID);
    struct ls_linear_part part = {.width = W, .height = H, .out = x->r};
    x->pictures.neutral = 0;
    g_assert_cmpint(ls_mono_blend_fit(&x->pictures, &part, NULL), ==, LS_ERR_INVALID);
    x->pictures.neutral = 1;
    part.y = 1;
    g_assert_cmpint(ls_mono_blend_fit(&x->pictures, &part, NULL), ==, LS_ERR_INVALID);
    part = (struct ls_linear_part){.width = W, .height = H, .out = x->r, .step = 1};
    x->pictures.n_segments = 2;
    g_assert_cmpint(ls_mono_blend_fit(&x->pictures, &part, NULL), ==, LS_ERR_STATE);
    tear_down(x);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/mono-blend/weights-are-a-smooth-partition-of-unity",
                    test_weights_are_a_smooth_partition_of_unity);
    g_test_add_func("/mono-blend/the-full-sphere-is-reproduced",
                    test_the_full_sphere_is_reproduced);
    g_test_add_func("/mono-blend/a-ratio-that-follows-the-light-is-followed",
                    test_a_ratio_that_follows_the_light_is_followed);
    g_test_add_func("/mono-blend/one-ratio-everywhere-stays-one",
                    test_one_ratio_everywhere_stays_one);
    g_test_add_func("/mono-blend/one-segment-is-eq-1-to-the-bit", test_one_segment_is_eq_1);
    g_test_add_func("/mono-blend/any-band-has-the-bits-of-the-whole",
                    test_any_band_has_the_bits_of_the_whole);
    g_test_add_func("/mono-blend/a-surface-black-in-the-spectrum-has-no-sparks",
                    test_a_surface_black_in_the_spectrum_has_no_sparks);
    g_test_add_func("/mono-blend/the-result-is-finite-whatever-comes",
                    test_the_result_is_finite_whatever_comes);
    g_test_add_func("/mono-blend/a-segment-without-light-takes-the-spheres-ratio",
                    test_a_segment_without_light_takes_the_spheres_ratio);
    g_test_add_func("/mono-blend/ratios-fade-as-the-light-does",
                    test_ratios_fade_as_the_light_does);
    g_test_add_func("/mono-blend/others-are-the-rest-of-the-blend",
                    test_others_are_the_rest_of_the_blend);
    g_test_add_func("/mono-blend/what-is-left-out-tells-the-error",
                    test_what_is_left_out_tells_the_error);
    g_test_add_func("/mono-blend/what-is-no-blend-is-refused", test_what_is_no_blend_is_refused);
    return g_test_run();
}
