/*
 * dark_stage: a pixel that only flickers is found, and known to a take that is resumed; how much a
 * watch may differ from its dark.
 */
#include "daemon/dark_stage.h"

#include "core/merge.h"

#include <glib.h>
#include <math.h>

enum { WIDTH = 16, HEIGHT = 16, PIXELS = WIDTH * HEIGHT, FRAMES = 8, BLACK = 64, FLICKERS = 100 };

static void must(enum ls_err err, const struct ls_diag *diag)
{
    g_assert_cmpstr(diag->text, ==, "");
    g_assert_cmpint(err, ==, LS_OK);
}

/* Noise of 1 DN; one pixel swings by 20 about the same mean. */
static void fill(uint16_t *raw, GRand *rand, int frame)
{
    for (int i = 0; i < PIXELS; i++)
        raw[i] = (uint16_t)(BLACK + g_rand_int_range(rand, -1, 2));
    raw[FLICKERS] = (uint16_t)(BLACK + (frame % 2 ? 20 : -20));
}

static void test_flicker(void)
{
    const struct ls_pixel_format *format = ls_pixel_by_name("Mono12");
    struct ls_dark_stage first, resumed;
    struct ls_diag diag = {0};
    uint16_t raw[PIXELS];
    GRand *rand = g_rand_new_with_seed(7);
    ls_dark_stage_init(&first, format, WIDTH, HEIGHT, true);
    must(ls_dark_stage_expect(&first, 0, &diag), &diag);
    for (int i = 0; i < FRAMES; i++) {
        fill(raw, rand, i);
        must(ls_dark_stage_add(&first, 0, raw, &diag), &diag);
    }
    must(ls_dark_stage_close(&first, 0, &diag), &diag);
    g_assert_cmpuint(first.defects.n, ==, 1);
    g_assert_cmpuint(first.defects.index[0], ==, FLICKERS);
    for (int i = 0; i < PIXELS; i++)
        g_assert_cmpuint(first.exposures[0].validity[i], ==, i == FLICKERS ? LS_VALIDITY_GAP : 0);
    ls_dark_stage_init(&resumed, format, WIDTH, HEIGHT, true);
    must(ls_dark_stage_adopt(&resumed, 0, FRAMES, first.exposures[0].mean_dn, &diag), &diag);
    g_assert_cmpuint(resumed.defects.n, ==, 0); /* its mean looks like any other */
    must(ls_dark_stage_know(&resumed, &first.defects, &diag), &diag);
    g_assert_cmpuint(resumed.defects.n, ==, 1);
    ls_dark_stage_finish(&first);
    ls_dark_stage_finish(&resumed);
    g_rand_free(rand);
}

/* Frames that do not vary, of 256 pixels: their means are known to the rounding of a pixel. */
static double allowed(uint32_t frames, uint32_t watched)
{
    struct ls_dark_stage stage;
    struct ls_dark_drift drift;
    struct ls_diag diag = {0};
    uint16_t raw[PIXELS];
    float mean_dn[PIXELS];
    for (int i = 0; i < PIXELS; i++)
        raw[i] = BLACK;
    ls_dark_stage_init(&stage, ls_pixel_by_name("Mono12"), WIDTH, HEIGHT, true);
    must(ls_dark_stage_expect(&stage, 0, &diag), &diag);
    for (uint32_t i = 0; i < frames; i++)
        must(ls_dark_stage_add(&stage, 0, raw, &diag), &diag);
    must(ls_dark_stage_close(&stage, 0, &diag), &diag);
    for (uint32_t i = 0; i < watched; i++)
        must(ls_dark_stage_watch(&stage, raw, &diag), &diag);
    must(ls_dark_stage_close_watch(&stage, 0, mean_dn, &drift, &diag), &diag);
    g_assert_cmpfloat(drift.difference_dn, ==, 0);
    ls_dark_stage_finish(&stage);
    return drift.allowed_dn;
}

static void test_allowed(void)
{
    g_assert_cmpfloat(allowed(8, 8), ==, 0.05);
    double error = sqrt((1.0 / 8 + 1.0 / 2) / 12 / PIXELS);
    g_assert_cmpfloat_with_epsilon(allowed(8, 2), 5 * error, 1e-12);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/darks/a-flickering-pixel-is-known-to-a-resumed-take", test_flicker);
    g_test_add_func("/darks/a-watch-is-allowed-a-twentieth-of-a-dn-or-five-errors", test_allowed);
    return g_test_run();
}
