/* level: the mean of whole pixels, whatever the size of the picture and of its bands. */
#include "core/level.h"

#include <glib.h>
#include <math.h>
#include <string.h>

/* A picture's level by its definition. g_free. */
static float *by_hand(const float *in, uint32_t w, uint32_t h, uint32_t channels, uint32_t level)
{
    uint32_t s = 1u << level, lw = (w + s - 1) / s, lh = (h + s - 1) / s;
    float *out = g_new(float, (size_t)lw *lh *channels);
    for (uint32_t y = 0; y < lh; y++)
        for (uint32_t x = 0; x < lw; x++)
            for (uint32_t c = 0; c < channels; c++) {
                double sum = 0;
                unsigned n = 0;
                for (uint32_t j = s * y; j < MIN(s * y + s, h); j++)
                    for (uint32_t i = s * x; i < MIN(s * x + s, w); i++, n++)
                        sum += (double)in[((size_t)j * w + i) * channels + c];
                out[((size_t)y * lw + x) * channels + c] = (float)(sum / n);
            }
    return out;
}

/* Through the rows, @band of them at a time. g_free. */
static float *in_bands(const float *in, uint32_t w, uint32_t h, uint32_t channels, uint32_t level,
                       uint32_t band)
{
    struct ls_level_rows rows;
    const struct ls_demosaic_region all = {0, 0, w, h};
    uint32_t made = 0;
    size_t row = (size_t)ls_level_size(w, level) * channels;
    float *out = g_new(float, row *ls_level_size(h, level));
    g_assert_cmpint(ls_level_rows_init(&rows, level, &all, channels, NULL), ==, LS_OK);
    for (uint32_t y = 0, n; y < h; y += n) {
        n = MIN(band, h - y);
        uint32_t got = ls_level_rows_add(&rows, in + (size_t)y * w * channels, n, out + row * made);
        g_assert_cmpuint(got, <=, n / (1u << level) + 2);
        made += got;
    }
    g_assert_cmpuint(made, ==, ls_level_size(h, level));
    ls_level_rows_finish(&rows);
    return out;
}

static void test_mean(void)
{
    static const uint32_t sizes[][2] = {{1, 1}, {2, 2}, {3, 5}, {4, 4}, {7, 9}, {16, 1}, {1, 18}};
    GRand *rand = g_rand_new_with_seed(7);
    for (size_t k = 0; k < G_N_ELEMENTS(sizes); k++)
        for (uint32_t level = 0; level <= LS_LEVEL_MAX; level++)
            for (uint32_t channels = 1; channels <= 3; channels += 2) {
                uint32_t w = sizes[k][0], h = sizes[k][1];
                size_t n = (size_t)w * h * channels;
                g_autofree float *in = g_new(float, n);
                for (size_t j = 0; j < n; j++)
                    in[j] = (float)g_rand_double_range(rand, -3, 900);
                g_autofree float *expected = by_hand(in, w, h, channels, level);
                size_t bytes = (size_t)ls_level_size(w, level) * ls_level_size(h, level) *
                               channels * sizeof(float);
                for (uint32_t band = 1; band <= h; band++) {
                    g_autofree float *got = in_bands(in, w, h, channels, level, band);
                    g_assert_cmpmem(got, bytes, expected, bytes);
                }
            }
    g_rand_free(rand);
}

static void test_example(void)
{
    static const float in[] = {1, 2, 3, 5};
    g_autofree float *out = in_bands(in, 2, 2, 1, 1, 1);
    g_assert_cmpfloat(*out, ==, 2.75f);
}

/* 2^24 + 1 + 1 + 1 is no float on the way; its quarter is. */
static void test_exact_sum(void)
{
    static const float in[] = {0x1p24f, 1, 1, 2};
    g_autofree float *out = in_bands(in, 2, 2, 1, 1, 2);
    g_assert_cmpfloat(*out, ==, 0x1p22f + 1);
}

static void test_no_number_stays(void)
{
    float in[4 * 8];
    for (int j = 0; j < 32; j++)
        in[j] = 1;
    in[9] = NAN;
    in[6] = INFINITY;
    g_autofree float *out = in_bands(in, 8, 4, 1, 1, 4);
    for (int j = 0; j < 8; j++)
        g_assert_true(j == 0 ? isnan(out[j]) : j == 3 ? isinf(out[j]) : out[j] == 1.0f);
}

static void test_regions(void)
{
    const struct ls_demosaic_region asked = {5, 6, 3, 7};
    struct ls_demosaic_region r = ls_level_region(asked, 1); /* touched: 2..3, 3..6 */
    g_assert_cmpuint(r.x, ==, 2);
    g_assert_cmpuint(r.y, ==, 3);
    g_assert_cmpuint(r.width, ==, 2);
    g_assert_cmpuint(r.height, ==, 4);
    r = ls_level_needs(r, 1, 9, 13); /* 4..7, 6..12: the picture ends there */
    g_assert_cmpuint(r.x, ==, 4);
    g_assert_cmpuint(r.y, ==, 6);
    g_assert_cmpuint(r.width, ==, 4);
    g_assert_cmpuint(r.height, ==, 7);
    r = ls_level_region(asked, 0);
    g_assert_cmpmem(&r, sizeof r, &asked, sizeof asked);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/level/a-pixel-is-the-mean-of-those-the-picture-has", test_mean);
    g_test_add_func("/level/the-header's-example-is-true", test_example);
    g_test_add_func("/level/sums-are-exact-where-floats-are-not", test_exact_sum);
    g_test_add_func("/level/no-number-stays-in-its-pixel", test_no_number_stays);
    g_test_add_func("/level/a-region-is-what-it-touches", test_regions);
    return g_test_run();
}
