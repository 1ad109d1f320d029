/* Demosaiced into halves and promoted in one go: the bits of doing it one after the other. */
#include "core/demosaic_kernels.h"
#include "core/factored.h"
#include "core/half.h"

#include "tests/core/isas.h"

#include <glib.h>
#include <math.h>
#include <string.h>

enum { SIDE = 70, N = SIDE * SIDE * 3, GAP = 5, FILL = 0x1234 };

struct picture {
    uint16_t mosaic[SIDE * SIDE], ratio[SIDE * (3 * SIDE + GAP)];
};

/* Of all that a half can be, but mostly numbers: one of @numbers is none, or at half's end. */
static uint16_t any_half(GRand *rand, gint32 numbers)
{
    static const float odd[] = {NAN,          INFINITY, -INFINITY, LS_HALF_MAX,
                                -LS_HALF_MAX, 0,        -0.0f,     6e-8f};
    if (g_rand_int_range(rand, 0, numbers) == 0)
        return ls_half_from_float(odd[g_rand_int_range(rand, 0, G_N_ELEMENTS(odd))]);
    return ls_half_from_float((float)g_rand_double_range(rand, -1, 150));
}

static void check(enum ls_isa isa, const struct picture *p, struct ls_demosaic_region region,
                  enum ls_demosaic_method method, float gain)
{
    const struct ls_demosaic_region all = {0, 0, SIDE, SIDE};
    const struct ls_demosaic_source source = {.half = p->mosaic,
                                              .stride = SIDE,
                                              .window = all,
                                              .image_width = SIDE,
                                              .image_height = SIDE,
                                              .cfa = LS_CFA_GBRG};
    const size_t row = 3 * (size_t)region.width, step = row + GAP;
    uint16_t white[N], expected[N], got[N];
    for (size_t k = 0; k < N; k++)
        expected[k] = got[k] = FILL;
    struct ls_demosaic_target target = {
        .half = {white, white + 1, white + 2}, .pixel_step = 3, .row_step = row};
    g_assert_cmpint(ls_demosaic_with(isa, &source, region, method, &target), ==, LS_OK);
    for (uint32_t y = 0; y < region.height; y++)
        ls_factored_expand(white + y * row, gain, p->ratio + y * step, row, expected + y * row);
    target = (struct ls_demosaic_target){.half = {got, got + 1, got + 2},
                                         .pixel_step = 3,
                                         .row_step = row,
                                         .scale = gain,
                                         .half_ratio = p->ratio,
                                         .ratio_step = step};
    g_assert_cmpint(ls_demosaic_with(isa, &source, region, method, &target), ==, LS_OK);
    g_assert_cmpmem(got, sizeof got, expected, sizeof expected);
}

static void compare(enum ls_isa isa, gint32 numbers)
{
    guint32 seed = (guint32)g_test_rand_int();
    g_autoptr(GRand) rand = g_rand_new_with_seed(seed);
    struct picture p;
    g_test_message("seed %u", seed);
    for (size_t k = 0; k < G_N_ELEMENTS(p.mosaic); k++)
        p.mosaic[k] = any_half(rand, numbers);
    for (size_t k = 0; k < G_N_ELEMENTS(p.ratio); k++)
        p.ratio[k] = any_half(rand, numbers);
    for (uint32_t width = 1; width <= SIDE; width++) {
        uint32_t x = (uint32_t)g_rand_int_range(rand, 0, (gint32)(SIDE - width + 1));
        struct ls_demosaic_region region = {x, width % 7, width, 9};
        check(isa, &p, region, LS_DEMOSAIC_GRADIENT, 1);
        check(isa, &p, region, LS_DEMOSAIC_BILINEAR, 0.7f);
        check(isa, &p, region, LS_DEMOSAIC_GRADIENT, 0);
    }
}

static void test_bits(const void *data)
{
    compare(isas_of(data), 40);
}

/* A row is made anew where a single sample needs more than half's range: beside rows that do not.
 */
static void test_rare(const void *data)
{
    for (int k = 0; k < 8; k++)
        compare(isas_of(data), 4000);
}

static void test_refusals(void)
{
    uint16_t mosaic[16] = {0}, halves[48], ratio[48] = {0};
    float floats[48];
    const struct ls_demosaic_region all = {0, 0, 4, 4};
    const struct ls_demosaic_source source = {.half = mosaic,
                                              .stride = 4,
                                              .window = all,
                                              .image_width = 4,
                                              .image_height = 4,
                                              .cfa = LS_CFA_RGGB};
    struct ls_demosaic_target planar = {.half = {halves, halves + 16, halves + 32},
                                        .pixel_step = 1,
                                        .row_step = 4,
                                        .half_ratio = ratio};
    struct ls_demosaic_target wide = {.plane = {floats, floats + 1, floats + 2},
                                      .pixel_step = 3,
                                      .row_step = 12,
                                      .half_ratio = ratio};
    g_assert_cmpint(ls_demosaic(&source, all, LS_DEMOSAIC_BILINEAR, &planar), ==, LS_ERR_INVALID);
    g_assert_cmpint(ls_demosaic(&source, all, LS_DEMOSAIC_BILINEAR, &wide), ==, LS_ERR_INVALID);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    isas_add("/demosaic-promoted/as-one-after-the-other", test_bits);
    isas_add("/demosaic-promoted/one-number-out-of-range-is-like-many", test_rare);
    g_test_add_func("/demosaic-promoted/planes-and-floats-are-not-promoted", test_refusals);
    return g_test_run();
}
