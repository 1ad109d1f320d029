/* relight_rows: a picture made row by row, in any shares and bands, is the picture made at once. */
#include "core/relight_rows.h"

#include <glib.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { LIGHTS = 37, SUMS = 5, W = 300, H = 205, TILES = 5 * 4, HALO = LS_DEMOSAIC_HALO };

struct take {
    struct ls_field field;
    struct ls_accumulate_job job;
    struct ls_picture picture[LIGHTS];
    const void *tiles[LIGHTS][TILES];
    uint16_t *store; /* [LIGHTS][H * W], halves below 1 */
    float weights[SUMS * LIGHTS], tile_max[TILES * LIGHTS];
    float *sums; /* [SUMS][H][W], at once */
};

static void enter(struct take *take, const void *data)
{
    const struct ls_tile_region all = {0, 0, 5, 4};
    take->field = (struct ls_field){.width = W,
                                    .height = H,
                                    .n_lights = LIGHTS,
                                    .n_channels = 3,
                                    .cfa = LS_CFA_GRBG,
                                    .scale = 1};
    take->store = g_new(uint16_t, LIGHTS * W * H);
    for (size_t j = 0; j < (size_t)LIGHTS * W * H; j++)
        take->store[j] = (uint16_t)g_test_rand_int_range(0, 0x3c00);
    for (uint32_t i = 0; i < LIGHTS; i++) {
        const uint16_t *at = take->store + (size_t)i * W * H;
        for (uint32_t t = 0; t < TILES; t++) {
            const struct ls_tile_region one = {t % 5, t / 5, t % 5 + 1, t / 5 + 1};
            take->tiles[i][t] = i == 3 && t > 7 ? NULL : at;
            take->tile_max[t * LIGHTS + i] = 1;
            at += ls_region_width_px(&take->field, &one) * ls_region_height_px(&take->field, &one);
        }
        take->picture[i].tiles = take->tiles[i];
    }
    for (int k = 0; k < SUMS * LIGHTS; k++)
        take->weights[k] = (float)g_test_rand_double_range(-1, 2);
    take->job = (struct ls_accumulate_job){.pictures = take->picture,
                                           .n_pictures = LIGHTS,
                                           .n_sums = SUMS,
                                           .weights = take->weights,
                                           .tile_max = take->tile_max};
    take->sums = g_new(float, SUMS *W *H);
    g_assert_cmpint(ls_accumulate(&take->field, &take->job, &all, take->sums, NULL, NULL), ==,
                    LS_OK);
}

static void leave(struct take *take, const void *data)
{
    g_free(take->store);
    g_free(take->sums);
}

/* Tile rows down to row @below in @n shares, the last share first; how many. */
static uint32_t read_rows(struct ls_relight_rows *rows, uint32_t y0, uint32_t below, uint32_t n)
{
    struct ls_accumulate_report report[16];
    uint32_t first = rows->tiles.y0;
    g_assert_cmpint(ls_relight_rows_roll(rows, y0, below, NULL), ==, LS_OK);
    for (uint32_t share = n; share-- > 0;)
        g_assert_cmpint(ls_relight_rows_sum(rows, share, n, &report[share], NULL), ==, LS_OK);
    ls_relight_rows_add(rows, report, n);
    return rows->tiles.y0 - first;
}

static void check_rows(const struct take *take, const struct ls_relight_rows *rows, uint32_t y0,
                       uint32_t y1)
{
    const struct ls_demosaic_region *w = &rows->window;
    g_assert_cmpuint(w->y, <=, y0);
    g_assert_cmpuint(w->y + w->height, >=, y1);
    for (uint32_t q = 0; q < SUMS; q++)
        for (uint32_t y = y0; y < y1; y++)
            g_assert_cmpmem(ls_relight_rows_get(rows, q) + (size_t)(y - w->y) * w->width,
                            w->width * sizeof(float), take->sums + ((size_t)q * H + y) * W + w->x,
                            w->width * sizeof(float));
}

static uint32_t above(uint32_t y)
{
    return y > HALO ? y - HALO : 0;
}

static uint32_t below(uint32_t y)
{
    return H - y > HALO ? y + HALO : H;
}

/* Band after band of a region, each with its halo; tile rows are read once, and none too early. */
static void check_bands(const struct take *take, struct ls_demosaic_region r, uint32_t tile_rows,
                        uint32_t n_shares)
{
    struct ls_relight_rows rows;
    ls_relight_rows_init(&rows, &take->field, &take->job, &r, HALO);
    uint32_t read = 0, last = r.y + r.height;
    for (uint32_t y = r.y, end; y < last; y = end) {
        end = ls_relight_band_end(&take->field, &r, y, HALO, tile_rows);
        g_assert_cmpuint(end, >, y);
        if (rows.window.y + rows.window.height < below(end))
            read += read_rows(&rows, above(y), below(end), n_shares);
        check_rows(take, &rows, above(y), below(end));
        /* a region may begin so low in a tile row that its first band ends in the next */
        uint32_t begun = y == r.y && y > 0;
        g_assert_cmpuint(rows.window.height, <=, (tile_rows + begun) * LS_TILE_SIDE + 2 * HALO);
    }
    g_assert_cmpuint(read, ==, (below(last) - 1) / LS_TILE_SIDE - above(r.y) / LS_TILE_SIDE + 1);
    ls_relight_rows_finish(&rows);
}

static void test_shares_and_bands_do_not_show(struct take *take, const void *data)
{
    static const struct ls_demosaic_region regions[] = {{0, 0, W, H},         {0, 0, 1, 1},
                                                        {W - 1, H - 1, 1, 1}, {63, 61, 2, 4},
                                                        {100, 62, 130, 66},   {0, 127, W, 78}};
    for (size_t k = 0; k < G_N_ELEMENTS(regions); k++)
        for (uint32_t n = 1; n <= 16; n = n < 3 ? n + 1 : 2 * n)
            check_bands(take, regions[k], n % 4 + 1, n);
}

/* As maps are made: bands that reach further than the rows kept at first. */
static void test_any_number_of_rows_can_be_kept(struct take *take, const void *data)
{
    const struct ls_demosaic_region whole = {0, 0, W, H};
    struct ls_relight_rows rows;
    ls_relight_rows_init(&rows, &take->field, &take->job, &whole, 0);
    for (uint32_t n = 1; n <= 4; n++) {
        read_rows(&rows, n < 4 ? 5 : 100, MIN(n * LS_TILE_SIDE, H), n);
        check_rows(take, &rows, n < 4 ? 5 : 100, MIN(n * LS_TILE_SIDE, H));
    }
    ls_relight_rows_finish(&rows);
}

/* What is left out is counted, and the same, in any shares. */
static void test_reports_add_up(struct take *take, const void *data)
{
    const struct ls_demosaic_region whole = {0, 0, W, H};
    struct ls_accumulate_report first = {0};
    struct ls_relight_rows rows;
    take->job.max_error = 1;
    for (uint32_t n = 1; n <= 5; n++) {
        ls_relight_rows_init(&rows, &take->field, &take->job, &whole, HALO);
        for (uint32_t t = 0; t < 4; t++)
            read_rows(&rows, t * LS_TILE_SIDE, MIN((t + 1) * LS_TILE_SIDE, H), n);
        g_assert_cmpuint(rows.report.tiles_read + rows.report.tiles_skipped, ==, TILES * LIGHTS);
        g_assert_cmpuint(rows.report.tiles_skipped, >, TILES - 8);
        g_assert_cmpfloat(rows.report.bound, >, 0);
        first = n == 1 ? rows.report : first;
        g_assert_cmpmem(&rows.report, sizeof first, &first, sizeof first);
        ls_relight_rows_finish(&rows);
    }
}

static void test_a_weight_that_is_no_number_is_refused(struct take *take, const void *data)
{
    const struct ls_demosaic_region whole = {0, 0, W, H};
    struct ls_accumulate_report report;
    struct ls_relight_rows rows;
    struct ls_diag diag = {{0}};
    take->weights[LIGHTS + 2] = (float)INFINITY;
    ls_relight_rows_init(&rows, &take->field, &take->job, &whole, HALO);
    g_assert_cmpint(ls_relight_rows_roll(&rows, 0, 1, NULL), ==, LS_OK);
    g_assert_cmpint(ls_relight_rows_sum(&rows, 0, 2, &report, &diag), ==, LS_ERR_INVALID);
    g_assert_nonnull(strstr(diag.text, "light 2 in sum 1"));
    ls_relight_rows_finish(&rows);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
#define ADD(name, test) g_test_add("/relight-rows/" name, struct take, NULL, enter, test, leave)
    ADD("shares-and-bands-do-not-show", test_shares_and_bands_do_not_show);
    ADD("any-number-of-rows-can-be-kept", test_any_number_of_rows_can_be_kept);
    ADD("reports-add-up", test_reports_add_up);
    ADD("a-weight-that-is-no-number-is-refused", test_a_weight_that_is_no_number_is_refused);
    return g_test_run();
}
