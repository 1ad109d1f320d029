/* Demosaiced, scaled, weighed and added in one go: the bits of doing it one after the other. */
#include "core/demosaic_kernels.h"

#include "tests/core/isas.h"

#include <glib.h>
#include <string.h>

enum { SIDE = 70, N = SIDE * SIDE * 3, GAP = 5 };

struct picture {
    float mosaic[SIDE * SIDE], ratio[SIDE * (3 * SIDE + GAP)], before[N];
};

static void fill(float *values, size_t n, GRand *rand)
{
    for (size_t k = 0; k < n; k++)
        values[k] = (float)g_rand_double_range(rand, -1, 2);
}

static void check(enum ls_isa isa, const struct picture *p, struct ls_demosaic_region region,
                  enum ls_demosaic_method method, bool weighed)
{
    const struct ls_demosaic_region all = {0, 0, SIDE, SIDE};
    const struct ls_demosaic_source source = {p->mosaic, SIDE, all, SIDE, SIDE, LS_CFA_GRBG};
    float plain[N], got[N];
    const size_t row = 3 * (size_t)region.width, n = row * region.height, step = row + GAP;
    struct ls_demosaic_target target = {
        .plane = {plain, plain + 1, plain + 2}, .pixel_step = 3, .row_step = row};
    g_assert_cmpint(ls_demosaic_with(isa, &source, region, method, &target), ==, LS_OK);
    for (size_t k = 0; k < n; k++) {
        float v = 0.7f * plain[k];
        if (weighed)
            v *= p->ratio[k / row * step + k % row];
        plain[k] = p->before[k] + v;
    }
    memcpy(got, p->before, sizeof got);
    target = (struct ls_demosaic_target){.plane = {got, got + 1, got + 2},
                                         .pixel_step = 3,
                                         .row_step = row,
                                         .add = true,
                                         .scale = 0.7f,
                                         .ratio = weighed ? p->ratio : NULL,
                                         .ratio_step = step};
    g_assert_cmpint(ls_demosaic_with(isa, &source, region, method, &target), ==, LS_OK);
    g_assert_cmpmem(got, n * sizeof *got, plain, n * sizeof *plain);
    g_assert_cmpmem(got + n, (N - n) * sizeof *got, p->before + n, (N - n) * sizeof *got);
}

static void test_bits(const void *data)
{
    guint32 seed = (guint32)g_test_rand_int();
    g_autoptr(GRand) rand = g_rand_new_with_seed(seed);
    struct picture p;
    g_test_message("seed %u", seed);
    fill(p.mosaic, G_N_ELEMENTS(p.mosaic), rand);
    fill(p.ratio, G_N_ELEMENTS(p.ratio), rand);
    fill(p.before, G_N_ELEMENTS(p.before), rand);
    for (uint32_t width = 1; width <= SIDE; width++) {
        uint32_t x = (uint32_t)g_rand_int_range(rand, 0, (gint32)(SIDE - width + 1));
        struct ls_demosaic_region region = {x, width % 7, width, 9};
        check(isas_of(data), &p, region, LS_DEMOSAIC_GRADIENT, width % 2);
        check(isas_of(data), &p, region, LS_DEMOSAIC_BILINEAR, width % 2 == 0);
    }
}

static void test_refusals(void)
{
    float mosaic[16] = {0}, planes[48];
    uint16_t halves[48];
    const struct ls_demosaic_region all = {0, 0, 4, 4};
    const struct ls_demosaic_source source = {mosaic, 4, all, 4, 4, LS_CFA_RGGB};
    struct ls_demosaic_target planar = {
        .plane = {planes, planes + 16, planes + 32}, .pixel_step = 1, .row_step = 4, .add = true};
    struct ls_demosaic_target half = {
        .half = {halves, halves + 1, halves + 2}, .pixel_step = 3, .row_step = 12, .add = true};
    g_assert_cmpint(ls_demosaic(&source, all, LS_DEMOSAIC_BILINEAR, &planar), ==, LS_ERR_INVALID);
    g_assert_cmpint(ls_demosaic(&source, all, LS_DEMOSAIC_BILINEAR, &half), ==, LS_ERR_INVALID);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    isas_add("/demosaic-add/has-the-bits-of-one-after-the-other", test_bits);
    g_test_add_func("/demosaic-add/planes-and-halves-are-not-added-to", test_refusals);
    return g_test_run();
}
