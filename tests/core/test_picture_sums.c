/* picture_sums: a drift of the light is found in the brief of two pictures. */
#include "core/half.h"
#include "core/merge.h"
#include "core/picture_sums.h"

#include <glib.h>
#include <math.h>

enum { SIZE = 128, N_PX = SIZE * SIZE };

struct picture {
    uint16_t half[N_PX];
    uint8_t validity[N_PX];
};

static double normal(GRand *rand)
{
    double u = 1 - g_rand_double(rand), v = g_rand_double(rand);
    return sqrt(-2 * log(u)) * cos(2 * G_PI * v);
}

/* A smooth scene whose colours change by @change, and noise. */
static struct picture *make(GRand *rand, const double change[3], double noise)
{
    struct picture *p = g_new0(struct picture, 1);
    for (uint32_t y = 0; y < SIZE; y++)
        for (uint32_t x = 0; x < SIZE; x++) {
            double scene = 0.3 + 0.2 * sin(x / 17.0) * cos(y / 23.0);
            unsigned colour = ls_cfa_channel(LS_CFA_RGGB, x, y);
            p->half[y * SIZE + x] =
                ls_half_from_float((float)(scene * (1 + change[colour]) + noise * normal(rand)));
        }
    return p;
}

static struct ls_picture_sums sums_of(const struct picture *p, enum ls_cfa cfa, uint32_t every)
{
    const struct ls_picture_view view = {p->half, p->validity, SIZE, SIZE, cfa};
    struct ls_picture_sums out;
    g_assert_cmpint(ls_picture_sums_make(&view, every, &out, NULL), ==, LS_OK);
    return out;
}

static void test_drift(void)
{
    static const double none[3] = {0}, change[3] = {0.015, -0.003, 0};
    GRand *rand = g_rand_new_with_seed(4);
    struct picture *a = make(rand, none, 0.02), *b = make(rand, change, 0.02);
    struct ls_picture_sums first = sums_of(a, LS_CFA_RGGB, 1), now = sums_of(b, LS_CFA_RGGB, 1);
    for (uint32_t c = 0; c < 3; c++) {
        struct ls_light_drift drift;
        g_assert_true(ls_picture_drift(&first, &now, c, &drift));
        /* two pictures of N_PX / 4 pixels (green / 2) of noise 0.02 on 0.3 on average */
        double error = 0.02 * sqrt(2) / 0.3 / sqrt(N_PX / (c == 1 ? 2.0 : 4.0));
        g_test_message("%u: %.5f +- %.5f (%.5f)", c, drift.change, drift.error, error);
        g_assert_cmpfloat(fabs(drift.change - change[c]), <, 4 * error);
        /* 1024 blocks tell their own spread to 2 %: four of those, and scene and half's steps */
        g_assert_cmpfloat(fabs(drift.error / error - 1), <, 0.15);
    }
    ls_picture_sums_finish(&first);
    ls_picture_sums_finish(&now);
    g_free(a);
    g_free(b);
    g_rand_free(rand);
}

/* Where a pixel is saturated in one of the two, its block is left out of both. */
static void test_saturated(void)
{
    static const double none[3] = {0};
    GRand *rand = g_rand_new_with_seed(5);
    struct picture *a = make(rand, none, 0), *b = make(rand, none, 0);
    for (uint32_t i = 0; i < N_PX / 8; i++) {
        b->half[i] = ls_half_from_float(0.01f);
        b->validity[i] = LS_VALIDITY_SATURATED;
        a->half[N_PX - 1 - i] = 0x7c00; /* infinite */
    }
    struct ls_picture_sums first = sums_of(a, LS_CFA_RGGB, 1), now = sums_of(b, LS_CFA_RGGB, 1);
    struct ls_light_drift drift;
    for (uint32_t c = 0; c < 3; c++) {
        g_assert_true(ls_picture_drift(&first, &now, c, &drift));
        g_assert_cmpfloat(fabs(drift.change), <, 1e-12);
    }
    g_assert_cmpuint(now.n_px, ==, N_PX);
    g_assert_cmpuint(now.n_saturated, ==, N_PX / 8);
    g_assert_cmpuint(first.n_saturated, ==, N_PX / 8);
    ls_picture_sums_finish(&first);
    ls_picture_sums_finish(&now);
    g_free(a);
    g_free(b);
    g_rand_free(rand);
}

/* A subject that moves is not a drift of the light. */
static void test_moved(void)
{
    static const double none[3] = {0};
    GRand *rand = g_rand_new_with_seed(6);
    struct picture *a = make(rand, none, 0.01), *b = make(rand, none, 0.01);
    for (uint32_t y = 30; y < 60; y++)
        for (uint32_t x = 30; x < 60; x++)
            b->half[y * SIZE + x] = ls_half_from_float(0.9f);
    struct ls_picture_sums first = sums_of(a, LS_CFA_RGGB, 1), now = sums_of(b, LS_CFA_RGGB, 1);
    struct ls_light_drift drift;
    g_assert_true(ls_picture_drift(&first, &now, 1, &drift));
    g_test_message("%.4f +- %.4f", drift.change, drift.error);
    /* noise: 0.01 sqrt 2 of 0.3 over half of the pixels less a sixteenth is 5.4e-4; all else that
     * is left of the move lies within eight medians in blocks it only touches */
    g_assert_cmpfloat(fabs(drift.change), <, 0.002);
    g_assert_cmpfloat(drift.error, <, 0.001);
    ls_picture_sums_finish(&first);
    ls_picture_sums_finish(&now);
    g_free(a);
    g_free(b);
    g_rand_free(rand);
}

/* Mono, odd sizes, some rows only; nothing to compare. */
static void test_edges(void)
{
    uint16_t half[15];
    struct ls_picture_sums sums, other;
    struct ls_light_drift drift;
    for (int i = 0; i < 15; i++)
        half[i] = ls_half_from_float((float)i);
    struct ls_picture_view view = {half, NULL, 3, 5, LS_CFA_NONE};
    g_assert_cmpint(ls_picture_sums_make(&view, 1, &sums, NULL), ==, LS_OK);
    g_assert_cmpuint(sums.n_colours, ==, 1);
    g_assert_cmpuint(sums.n_blocks, ==, 15);
    g_assert_cmpfloat(sums.total[0], ==, 105);
    g_assert_false(ls_picture_drift(&sums, &sums, 1, &drift));
    g_assert_cmpint(ls_picture_sums_make(&view, 2, &other, NULL), ==, LS_OK);
    g_assert_cmpuint(other.n_px, ==, 9); /* rows 0, 1 and 4 */
    g_assert_cmpfloat(other.total[0], ==, 0 + 1 + 2 + 3 + 4 + 5 + 12 + 13 + 14);
    ls_picture_sums_finish(&other);
    view.width = 1;
    view.height = 1;
    g_assert_cmpint(ls_picture_sums_make(&view, 1, &other, NULL), ==, LS_OK);
    g_assert_false(ls_picture_drift(&other, &other, 0, &drift));
    g_assert_false(ls_picture_drift(&sums, &other, 0, &drift));
    ls_picture_sums_finish(&other);
    ls_picture_sums_finish(&sums);
    view.width = 0;
    g_assert_cmpint(ls_picture_sums_make(&view, 1, &other, NULL), ==, LS_ERR_INVALID);
}

/* Pixel by pixel, as the header says, to the bit. One row a block, and not two rows of a kind. */
static void test_exact(void)
{
    enum { W = 1000, H = LS_SUMS_GRID };
    static uint16_t half[W * H];
    static uint8_t validity[W * H];
    guint32 seed = g_test_rand_int(), n_saturated = 0;
    GRand *rand = g_rand_new_with_seed(seed);
    g_test_message("seed %u", seed);
    for (uint32_t i = 0; i < W * H; i++) {
        half[i] = (uint16_t)(g_rand_int(rand) & (g_rand_int_range(rand, 0, 400) ? 0xbbff : 0xffff));
        validity[i] = g_rand_int_range(rand, 0, 100) ? 0 : (uint8_t)g_rand_int_range(rand, 0, 4);
    }
    const struct ls_picture_view view = {half, validity, W, H, LS_CFA_RGGB};
    struct ls_picture_sums sums;
    g_assert_cmpint(ls_picture_sums_make(&view, 1, &sums, NULL), ==, LS_OK);
    for (uint32_t y = 0; y < H; y++)
        for (uint32_t block = 0; block < LS_SUMS_GRID; block++)
            for (uint32_t k = 0; k < 2; k++) {
                double sum = 0;
                bool bad = false;
                for (uint32_t x = W * block / LS_SUMS_GRID; x < W * (block + 1) / LS_SUMS_GRID;
                     x++) {
                    float value = ls_half_to_float(half[y * W + x]);
                    uint8_t v = validity[y * W + x];
                    bool saturated = v == LS_VALIDITY_SATURATED || !isfinite(value);
                    if ((x & 1) != k)
                        continue;
                    bad |= saturated || v == LS_VALIDITY_GAP;
                    sum += saturated ? 0 : (double)value;
                    n_saturated += saturated;
                }
                uint32_t colour = ls_cfa_channel(LS_CFA_RGGB, k, y);
                float got = sums.sum[colour * sums.n_blocks + y * LS_SUMS_GRID + block];
                g_assert_true(bad ? isnan(got) : got == (float)sum);
            }
    g_assert_cmpuint(sums.n_saturated, ==, n_saturated);
    ls_picture_sums_finish(&sums);
    g_rand_free(rand);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/picture-sums/a-drift-is-found-with-its-error", test_drift);
    g_test_add_func("/picture-sums/saturated-blocks-are-left-out", test_saturated);
    g_test_add_func("/picture-sums/what-moves-is-no-drift", test_moved);
    g_test_add_func("/picture-sums/small-and-mono-pictures-are-added-up", test_edges);
    g_test_add_func("/picture-sums/are-exact-whatever-the-pixels", test_exact);
    return g_test_run();
}
