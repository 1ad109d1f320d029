/* Kernels on buffers that touch an unreadable page, at their end and at their beginning: a read or
 * write one byte outside is a crash. */
#include "core/demosaic_kernels.h"
#include "core/half.h"
#include "core/half_kernels.h"
#include "core/merge_kernels.h"
#include "core/promote_tile_kernels.h"

#include "tests/core/isas.h"

#include <glib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

enum { PAGES = 4 };

struct guarded {
    uint8_t *map;
    size_t page;
};

static struct guarded guarded_new(void)
{
    struct guarded g = {NULL, (size_t)sysconf(_SC_PAGESIZE)};

    g.map = mmap(NULL, (PAGES + 2) * g.page, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS,
                 -1, 0);
    g_assert_true(g.map != MAP_FAILED);
    g_assert_cmpint(mprotect(g.map, g.page, PROT_NONE), ==, 0);
    g_assert_cmpint(mprotect(g.map + (PAGES + 1) * g.page, g.page, PROT_NONE), ==, 0);
    return g;
}

static void guarded_free(struct guarded *g)
{
    munmap(g->map, (PAGES + 2) * g->page);
}

/* @bytes that touch the guard before (side 0) or after (side 1) them. */
static void *place(const struct guarded *g, int side, size_t bytes)
{
    g_assert_cmpuint(bytes, <=, PAGES * g->page);
    return g->map + (side ? (PAGES + 1) * g->page - bytes : g->page);
}

static const uint32_t sizes[][2] = {{1, 1}, {3, 3}, {7, 5}, {8, 1}, {257, 3}, {512, 2}, {63, 31}};

static void merge_at(const struct guarded g[8], enum ls_isa isa, int side,
                     const struct ls_pixel_format *f, uint32_t width, uint32_t height)
{
    size_t n = (size_t)width * height, bytes = ls_pixel_payload_bytes(f, width, height);
    uint32_t defects[] = {0, (uint32_t)n - 1};
    struct ls_merge_params p = {.format = f,
                                .width = width,
                                .height = height,
                                .n_exposures = 2,
                                .exposure_s = {0.001, 0.004},
                                .range_low = 0.1,
                                .range_high = 0.85,
                                .full_scale_dn = ls_pixel_max_dn(f),
                                .clip_dn = ls_pixel_max_dn(f),
                                .electrons_per_dn = 10,
                                .read_noise_dn = 1,
                                .defects = defects,
                                .n_defects = n > 1 ? 2 : 1,
                                .reference_exposure_s = 0.001};
    struct ls_merge_spans s = {
        .raw = {place(&g[0], side, bytes), place(&g[1], side, bytes)},
        .dark = {place(&g[2], side, n * 4), place(&g[3], side, n * 4)},
        .e = place(&g[4], side, n * 4),
        .validity = place(&g[5], side, n),
        .variance = place(&g[6], side, n * 4),
        .half = place(&g[7], side, n * 2),
    };
    struct ls_diag diag = {""};
    g_assert_cmpint(ls_merge_check(&p, &diag), ==, LS_OK);
    ls_merge_rows_with(ls_merge_kernels(isa), &p, &s, 0, height);
    for (size_t k = 0; k < n; k++)
        g_assert_cmpuint(s.validity[k], <=, LS_VALIDITY_GAP);
}

static void test_merge(const void *data)
{
    struct guarded g[8];

    for (int k = 0; k < 8; k++)
        g[k] = guarded_new();
    for (size_t f = 0; ls_pixel_at(f); f++)
        for (size_t k = 0; k < G_N_ELEMENTS(sizes); k++)
            for (int side = 0; side < 2; side++)
                merge_at(g, isas_of(data), side, ls_pixel_at(f), sizes[k][0], sizes[k][1]);
    for (int k = 0; k < 8; k++)
        guarded_free(&g[k]);
}

static void test_pixels(void)
{
    struct guarded raw = guarded_new(), out = guarded_new();

    for (size_t f = 0; ls_pixel_at(f); f++)
        for (uint32_t n = 1; n < 140; n++)
            for (int side = 0; side < 2; side++) {
                const struct ls_pixel_format *format = ls_pixel_at(f);
                void *payload = place(&raw, side, ls_pixel_payload_bytes(format, n, 1));
                uint16_t *dn = place(&out, side, 2 * (size_t)n);
                ls_pixel_unpack(format, payload, 0, n, dn);
                ls_pixel_unpack(format, payload, n / 2, n - n / 2, dn);
                ls_pixel_pack(format, dn, 0, n, payload);
            }
    guarded_free(&raw);
    guarded_free(&out);
}

static void test_halves(const void *data)
{
    const struct ls_half_kernels *kernels = ls_half_kernels(isas_of(data));
    struct guarded floats = guarded_new(), halves = guarded_new(), flags = guarded_new();

    for (size_t n = 1; n < 300; n++)
        for (int side = 0; side < 2; side++) {
            float *f = place(&floats, side, 4 * n);
            uint16_t *h = place(&halves, side, 2 * n);
            kernels->from_floats(f, h, n);
            kernels->to_floats(h, f, n);
            ls_merge_store_half(f, n, 1, h, place(&flags, side, n));
        }
    guarded_free(&floats);
    guarded_free(&halves);
    guarded_free(&flags);
}

/* A form: halves or floats, woven or in planes. */
static void demosaic_at(const struct guarded g[4], enum ls_isa isa, int side, uint32_t width,
                        uint32_t height, bool half, bool woven)
{
    size_t n = (size_t)width * height, each = half ? 2 : 4;
    struct ls_demosaic_region all = {0, 0, width, height};
    struct ls_demosaic_source s = {.data = half ? NULL : place(&g[0], side, 4 * n),
                                   .half = half ? place(&g[0], side, 2 * n) : NULL,
                                   .stride = width,
                                   .window = all,
                                   .image_width = width,
                                   .image_height = height,
                                   .cfa = LS_CFA_GBRG};
    struct ls_demosaic_target t = {.pixel_step = woven ? 3 : 1,
                                   .row_step = (woven ? 3 : 1) * (size_t)width};
    for (int c = 0; c < 3; c++) {
        char *plane = woven ? (char *)place(&g[1], side, 3 * n * each) + (size_t)c * each
                            : place(&g[1 + c], side, n * each);
        t.plane[c] = half ? NULL : (float *)plane;
        t.half[c] = half ? (uint16_t *)plane : NULL;
    }
    for (int m = 0; m < 2; m++)
        g_assert_cmpint(ls_demosaic_with(isa, &s, all, (enum ls_demosaic_method)m, &t), ==, LS_OK);
}

static void test_demosaic(const void *data)
{
    static const uint32_t shapes[][2] = {{1, 1},   {3, 3},   {7, 5},  {8, 1},
                                         {130, 3}, {512, 2}, {43, 31}};
    struct guarded g[4];

    for (int k = 0; k < 4; k++)
        g[k] = guarded_new();
    for (size_t k = 0; k < G_N_ELEMENTS(shapes); k++)
        for (int form = 0; form < 8; form++)
            demosaic_at(g, isas_of(data), form & 1, shapes[k][0], shapes[k][1], form & 2, form & 4);
    for (int k = 0; k < 4; k++)
        guarded_free(&g[k]);
}

static void test_promote_tile(const void *data)
{
    struct guarded g[5];

    for (int k = 0; k < 5; k++)
        g[k] = guarded_new();
    for (size_t n = 1; n < 100; n++)
        for (int side = 0; side < 2; side++) {
            const uint16_t *const ratio[] = {place(&g[1], side, 2 * n), place(&g[2], side, 2 * n)};
            uint16_t *const out[] = {place(&g[3], side, 2 * n), place(&g[4], side, 2 * n)};
            struct ls_promote_tile tile = {place(&g[0], side, 2 * n), 2, ratio, out, n, 1};
            g_assert_cmpuint(ls_promote_tile_kernels(isas_of(data))->run(&tile), ==, 0);
        }
    for (int k = 0; k < 5; k++)
        guarded_free(&g[k]);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    isas_add("/guards/merge-touches-only-its-spans", test_merge);
    g_test_add_func("/guards/formats-touch-only-their-bytes", test_pixels);
    isas_add("/guards/halves-touch-only-their-spans", test_halves);
    isas_add("/guards/demosaic-touches-only-its-window", test_demosaic);
    isas_add("/guards/promote-tile-touches-only-its-spans", test_promote_tile);
    return g_test_run();
}
