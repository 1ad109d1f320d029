#include "core/dark.h"
#include "core/hot_pixels.h"

#include "tests/core/noise.h"

#include <glib.h>
#include <math.h>
#include <string.h>

enum { SEED = 41 };

static struct ls_dark *dark_new(const char *format, uint32_t width, uint32_t height)
{
    struct ls_dark *dark;
    struct ls_diag diag;
    g_assert_cmpint(ls_dark_create(ls_pixel_by_name(format), width, height, &dark, &diag), ==,
                    LS_OK);
    return dark;
}

static void add(struct ls_dark *dark, const char *format, const uint16_t *dn, size_t n)
{
    g_autofree uint8_t *raw = g_malloc0(2 * n + 2);
    ls_pixel_pack(ls_pixel_by_name(format), dn, 0, n, raw);
    g_assert_cmpint(ls_dark_add(dark, raw), ==, LS_OK);
}

static void test_exact(void)
{
    static const uint16_t frames[3][4] = {{1, 4095, 0, 64}, {2, 4095, 0, 65}, {6, 4095, 4095, 63}};
    struct ls_dark *dark = dark_new("BayerRG12Packed", 4, 1);
    float mean[4], variance[4];

    g_assert_cmpint(ls_dark_mean(dark, mean), ==, LS_ERR_STATE);
    add(dark, "BayerRG12Packed", frames[0], 4);
    g_assert_cmpint(ls_dark_variance(dark, variance), ==, LS_ERR_STATE);
    add(dark, "BayerRG12Packed", frames[1], 4);
    add(dark, "BayerRG12Packed", frames[2], 4);
    g_assert_cmpint(ls_dark_mean(dark, mean), ==, LS_OK);
    g_assert_cmpint(ls_dark_variance(dark, variance), ==, LS_OK);
    g_assert_cmpfloat(mean[0], ==, 3);
    g_assert_cmpfloat(mean[1], ==, 4095);
    g_assert_cmpfloat(mean[2], ==, 1365);
    g_assert_cmpfloat(mean[3], ==, 64);
    g_assert_cmpfloat(variance[0], ==, 7);
    g_assert_cmpfloat(variance[1], ==, 0);
    g_assert_cmpfloat(variance[2], ==, 4095.0f * 4095 / 3);
    g_assert_cmpfloat(variance[3], ==, 1);
    ls_dark_destroy(dark);
    ls_dark_destroy(NULL);
}

/* The sums' largest values: 65536 frames of 65535 and then no more. */
static void test_limit(void)
{
    static const uint16_t white[] = {65535}, black[] = {0};
    struct ls_dark *dark = dark_new("Mono16", 1, 1);
    float mean, variance;

    for (int k = 0; k < 65536; k++)
        g_assert_cmpint(ls_dark_add(dark, k % 2 ? black : white), ==, LS_OK);
    g_assert_cmpint(ls_dark_add(dark, white), ==, LS_ERR_LIMIT);
    g_assert_cmpint(ls_dark_mean(dark, &mean), ==, LS_OK);
    g_assert_cmpint(ls_dark_variance(dark, &variance), ==, LS_OK);
    g_assert_cmpfloat(mean, ==, 32767.5f);
    g_assert_cmpfloat_with_epsilon(variance, 32767.5 * 32767.5 * 65536 / 65535, 100);
    ls_dark_destroy(dark);
}

/* Frames of a sensor: black, noise, a few hot pixels, one noisy one, ambient light with an edge. */
struct sensor {
    uint32_t width, height, frames;
    double black, noise;
    const uint32_t *hot;
    uint32_t n_hot, noisy;
    double ambient; /* DN, on the right half */
};

static struct ls_dark *shoot(const struct sensor *s)
{
    struct noise noise = {SEED};
    size_t n = (size_t)s->width * s->height;
    g_autofree uint16_t *dn = g_new(uint16_t, n);
    struct ls_dark *dark = dark_new("BayerGR12", s->width, s->height);

    g_test_message("seed %d", SEED);
    for (uint32_t k = 0; k < s->frames; k++) {
        for (size_t p = 0; p < n; p++) {
            double level = s->black + (p % s->width >= s->width / 2 ? s->ambient : 0);
            for (uint32_t h = 0; h < s->n_hot; h++)
                level += p == s->hot[h] ? 40 : 0;
            double sigma = s->noisy && p == s->noisy ? 10 * s->noise : s->noise;
            dn[p] = (uint16_t)fmax(0, floor(level + sigma * noise_normal(&noise) + 0.5));
        }
        add(dark, "BayerGR12", dn, n);
    }
    return dark;
}

static void test_read_noise(void)
{
    static const uint32_t hot[] = {5, 1000};
    static const double sigmas[] = {0.5, 1.7, 6};

    for (size_t k = 0; k < G_N_ELEMENTS(sigmas); k++)
        for (uint32_t frames = 2; frames <= 32; frames *= 4) {
            struct sensor s = {64, 64, frames, 64.3, sigmas[k], hot, 2, 77, 0};
            struct ls_dark *dark = shoot(&s);
            struct ls_dark_stats stats;
            struct ls_diag diag;
            g_assert_cmpint(ls_dark_stats(dark, &stats), ==, LS_OK);
            g_assert_cmpuint(stats.n_frames, ==, frames);
            /* 4096 pixels of one degree of freedom know sigma to 1.1 %; 4 of those, and the noisy
             * pixel (100 / 4096 of the variance) at two frames, where it cannot be told apart. */
            g_assert_cmpfloat(fabs(stats.read_noise_dn / sigmas[k] - 1), <, 0.06);
            g_assert_cmpfloat(fabs(stats.mean_dn - 64.3 - 80.0 / 4096), <, 0.1 * sigmas[k]);
            g_assert_cmpint(ls_dark_check_black(&stats, &diag), ==, LS_OK);
            ls_dark_destroy(dark);
        }
}

static void test_black_clips(void)
{
    /* 3 sigma above 0 cuts off 0.1 %: at 2.6 sigma it is clipped, at 4 sigma it is not. */
    struct sensor s = {64, 64, 8, 0.5 + 2.6 * 2, 2, NULL, 0, 0, 0};
    struct ls_diag diag = {""};
    struct ls_dark_stats stats;

    struct ls_dark *dark = shoot(&s);
    g_assert_cmpint(ls_dark_stats(dark, &stats), ==, LS_OK);
    g_assert_cmpfloat(stats.zero_fraction, >, LS_DARK_ZERO_LIMIT);
    g_assert_cmpint(ls_dark_check_black(&stats, &diag), ==, LS_ERR_INVALID);
    g_assert_nonnull(strstr(diag.text, "black level"));
    ls_dark_destroy(dark);
    s.black = 0.5 + 4 * 2;
    dark = shoot(&s);
    g_assert_cmpint(ls_dark_stats(dark, &stats), ==, LS_OK);
    g_assert_cmpint(ls_dark_check_black(&stats, &diag), ==, LS_OK);
    ls_dark_destroy(dark);
    stats.zero_fraction = 0.001; /* the limit itself is refused */
    g_assert_cmpint(ls_dark_check_black(&stats, &diag), ==, LS_ERR_INVALID);
    stats.zero_fraction = 0.00099;
    g_assert_cmpint(ls_dark_check_black(&stats, &diag), ==, LS_OK);
}

static void find(const struct sensor *s, struct ls_pixel_list *list)
{
    struct ls_dark *dark = shoot(s);
    size_t n = (size_t)s->width * s->height;
    g_autofree float *mean = g_new(float, n), *variance = g_new(float, n);

    g_assert_cmpint(ls_dark_mean(dark, mean), ==, LS_OK);
    g_assert_cmpint(ls_dark_variance(dark, variance), ==, LS_OK);
    g_assert_cmpint(ls_hot_pixels(mean, s->frames >= 8 ? variance : NULL, LS_CFA_GRBG, s->width,
                                  s->height, list),
                    ==, LS_OK);
    ls_dark_destroy(dark);
}

/* Exactly the planted ones: two of them same-colour neighbours, one in a corner, one on the edge of
 * the ambient light; the noisy one only where its variance is known. */
static void test_hot(void)
{
    static const uint32_t hot[] = {0, 301, 303, 64 * 20 + 32, 64 * 63 + 63};
    static const uint32_t with_noisy[] = {0, 301, 303, 64 * 20 + 32, 64 * 30 + 5, 64 * 63 + 63};
    struct sensor s = {64, 64, 16, 64.3, 1.5, hot, 5, 64 * 30 + 5, 25};
    struct ls_pixel_list list;

    find(&s, &list);
    g_assert_cmpmem(list.index, list.n * 4, with_noisy, sizeof with_noisy);
    ls_pixel_list_finish(&list);
}

static void test_clean(void)
{
    struct sensor s = {200, 150, 4, 64.3, 1.5, NULL, 0, 0, 25};
    struct ls_pixel_list list;

    find(&s, &list);
    g_assert_cmpuint(list.n, ==, 0);
    ls_pixel_list_finish(&list);
    s.width = s.height = 1;
    find(&s, &list);
    g_assert_cmpuint(list.n, ==, 0);
}

static void test_join(void)
{
    struct ls_pixel_list a = {0}, b = {3, (uint32_t[]){2, 5, 9}}, c = {3, (uint32_t[]){0, 5, 10}};

    g_assert_cmpint(ls_pixel_list_join(&a, &b), ==, LS_OK);
    g_assert_cmpint(ls_pixel_list_join(&a, &c), ==, LS_OK);
    g_assert_cmpmem(a.index, a.n * 4, ((uint32_t[]){0, 2, 5, 9, 10}), 20);
    ls_pixel_list_finish(&a);
    g_assert_cmpint(ls_pixel_list_join(&a, &a), ==, LS_OK);
    g_assert_cmpuint(a.n, ==, 0);
    ls_pixel_list_finish(&a);
}

static void test_refusals(void)
{
    struct ls_dark *dark;
    struct ls_diag diag;
    const struct ls_pixel_format *f = ls_pixel_by_name("Mono8");
    g_assert_cmpint(ls_dark_create(f, 0, 4, &dark, &diag), ==, LS_ERR_INVALID);
    g_assert_cmpint(ls_dark_create(f, 1 << 20, 1 << 20, &dark, &diag), ==, LS_ERR_LIMIT);
    g_assert_null(dark);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/dark/mean-and-variance-are-exact", test_exact);
    g_test_add_func("/dark/sums-hold-65536-frames-of-the-largest-value", test_limit);
    g_test_add_func("/dark/read-noise-is-found-without-quantisation-or-hot-pixels",
                    test_read_noise);
    g_test_add_func("/dark/a-clipped-black-level-is-refused", test_black_clips);
    g_test_add_func("/dark/hot-and-noisy-pixels-are-found-and-ambient-is-not", test_hot);
    g_test_add_func("/dark/a-clean-sensor-has-no-hot-pixels", test_clean);
    g_test_add_func("/dark/lists-join-sorted-without-duplicates", test_join);
    g_test_add_func("/dark/impossible-sizes-are-refused", test_refusals);
    return g_test_run();
}
