/* relight: what is made of a take is what its definition says. */
#include "core/promote.h"
#include "tests/core/relight_take.h"

#include <math.h>
#include <string.h>

static void test_a_promoted_relit_picture_is_the_definition(void)
{
    static const enum ls_cfa cfas[] = {LS_CFA_NONE, LS_CFA_RGGB, LS_CFA_GRBG, LS_CFA_GBRG,
                                       LS_CFA_BGGR};
    for (size_t k = 0; k < G_N_ELEMENTS(cfas); k++) {
        struct take *take = relight_take_new(cfas[k], 0.1, LAYOUT_DOME);
        struct ls_diag diag = {{0}};
        g_assert_cmpint(ls_field_check(&take->field, &diag), ==, LS_OK);
        double error = relight_take_error(take, &take->field, FALSE);
        g_test_message("%s: relative rms error %.2g", ls_cfa_name(cfas[k]), error);
        g_assert_cmpfloat(error, <, relight_take_bound(take));
        relight_take_free(take);
    }
}

/* The paper's plain F/F(0) ignores that each spectrum's lights differ in strength. */
static void test_the_weighted_denominator_beats_the_paper_s(void)
{
    struct take *take = relight_take_new(LS_CFA_NONE, 0.3, LAYOUT_DOME);
    double even[SPECTRA * N_MAX];
    struct ls_field paper = take->field;
    for (uint32_t s = 0; s < SPECTRA; s++)
        for (uint32_t i = 0; i < take->n; i++)
            even[s * take->n + i] = take->g[i]; /* V as the white sphere shows it */
    paper.g = even;
    double ours = relight_take_error(take, &take->field, FALSE),
           theirs = relight_take_error(take, &paper, FALSE);
    g_test_message("30 %% spread: weighted %.2g, paper %.2g", ours, theirs);
    g_assert_cmpfloat(ours, <, relight_take_bound(take));
    g_assert_cmpfloat(theirs, >, 3 * ours);
    relight_take_free(take);
}

/* Largest relative error of a grey object in light that is 1 from everywhere. */
static double furnace(enum ls_cfa cfa, enum layout layout)
{
    struct take *take = relight_take_new(cfa, 0.1, layout);
    g_autofree double *w = g_new0(double, take->n *SPECTRA);
    g_autofree float *out = g_new(float, W *H * 3);
    const double p[3] = {0.7, 1, 0.6}, albedo = 0.33;
    double worst = 0;
    for (uint32_t c = 0; c < 3; c++)
        take->albedo[0][c] = albedo;
    if (cfa == LS_CFA_NONE) /* what a mono camera sees is photographed with the green channel's p */
        memcpy(take->p, (const double[]){0.7, 1, 0.6, 1.1, 0.2, 0.03, 0.02, 0.4, 0.9},
               sizeof take->p);
    g_byte_array_unref(take->store);
    relight_take_photograph(take);
    for (uint32_t s = 0; cfa == LS_CFA_NONE && s < SPECTRA; s++)
        take->p[s] = s ? 0.3 : 1;
    for (uint32_t i = 0; i < take->n; i++)
        w[i * SPECTRA] = take->omega[i];
    relight_take_relight(&take->field, w, out);
    for (uint32_t y = 20; y < 46; y++)
        for (uint32_t x = 20; x < 50; x++)
            for (uint32_t c = 0; c < 3; c++) {
                double expected = albedo * (cfa == LS_CFA_NONE ? 1 : p[c]);
                worst = fmax(worst, fabs((double)out[(y * W + x) * 3 + c] / expected - 1));
            }
    g_test_message("%s, %u lights: furnace off by %.3f %%", ls_cfa_name(cfa), take->n, 100 * worst);
    relight_take_free(take);
    return worst;
}

static void test_white_furnace(const void *data)
{
    enum layout layout = (enum layout)GPOINTER_TO_INT(data);
    g_assert_cmpfloat(furnace(LS_CFA_NONE, layout), <, 0.01); /* the requirement */
    g_assert_cmpfloat(furnace(LS_CFA_RGGB, layout), <, 0.01);
}

/* Unequal weights in R, G, B: one sum per channel, its own channel taken after demosaic. */
static void test_the_tristimulus_baseline_tints_a_white_object(void)
{
    struct take *take = relight_take_new(LS_CFA_RGGB, 0.1, LAYOUT_DOME);
    g_autofree double *w = g_new(double, take->n);
    g_autofree float *rows = g_new(float, 3 * take->n), *sums = g_new(float, 3 * W * H);
    g_autofree float *out = g_new(float, W *H * 3);
    const double light[3] = {2, 1, 0.25};
    struct ls_relight_term terms[3];
    for (uint32_t c = 0; c < 3; c++) {
        for (uint32_t i = 0; i < take->n; i++)
            w[i] = take->omega[i] * light[c];
        ls_relight_tristimulus(&take->field, c, w);
        ls_relight_row(take->k, w, take->n, rows + c * take->n);
        terms[c] = (struct ls_relight_term){.sum = sums + c * W * H, .channel = (int32_t)c};
    }
    relight_take_sum(&take->field, take->field.white, take->n, rows, 3, sums);
    g_assert_cmpint(ls_relight_finish(&take->field, all_px, all_px, terms, 3, NULL, out, NULL), ==,
                    LS_OK);
    for (uint32_t c = 0; c < 3; c++)
        /* albedo x light: p divides out; 1 % as for the furnace */
        g_assert_cmpfloat_with_epsilon(
            (double)out[(30 * W + 30) * 3 + c] / (take->albedo[0][c] * light[c]), 1, 0.01);
    relight_take_free(take);
}

/* Summing lights on the mosaic is exact for shared weights; and M comes last, once. */
static void test_a_crop_is_bit_identical_and_the_matrix_comes_last(void)
{
    struct take *take = relight_take_new(LS_CFA_GBRG, 0.1, LAYOUT_DOME);
    g_autofree float *rows = g_new(float, take->n), *sum = g_new(float, W *H);
    g_autofree float *ratio = g_new(float, W *H * 3), *crop_ratio = g_new(float, W *H * 3);
    g_autofree float *out = g_new(float, W *H * 3), *crop = g_new(float, W *H * 3);
    const double m[9] = {0, 1, 0, 0, 0, 2, -1, 0, 0};
    const struct ls_demosaic_region part = {17, 5, 23, 31};
    struct ls_relight_term term = {.sum = sum, .ratio = ratio, .channel = -1};
    ls_relight_row(take->k, take->omega, take->n, rows);
    relight_take_sum(&take->field, take->field.white, take->n, rows, 1, sum);
    relight_take_ratio(&take->field, 1, ratio);
    g_assert_cmpint(ls_relight_finish(&take->field, all_px, all_px, &term, 1, NULL, out, NULL), ==,
                    LS_OK);
    for (uint32_t y = 0; y < part.height; y++)
        memcpy(crop_ratio + y * part.width * 3, ratio + ((part.y + y) * W + part.x) * 3,
               part.width * 3 * sizeof *ratio);
    term.ratio = crop_ratio;
    g_assert_cmpint(ls_relight_finish(&take->field, all_px, part, &term, 1, NULL, crop, NULL), ==,
                    LS_OK);
    for (uint32_t y = 0; y < part.height; y++)
        g_assert_cmpmem(crop + y * part.width * 3, part.width * 3 * sizeof *crop,
                        out + ((part.y + y) * W + part.x) * 3, part.width * 3 * sizeof *crop);
    g_assert_cmpint(ls_relight_finish(&take->field, all_px, part, &term, 1, m, crop, NULL), ==,
                    LS_OK);
    const float *raw = out + (part.y * W + part.x) * 3;
    g_assert_cmpfloat(crop[0], ==, raw[1]);
    g_assert_cmpfloat(crop[1], ==, 2 * raw[2]);
    g_assert_cmpfloat(crop[2], ==, -raw[0]);
    const struct ls_demosaic_region outside = {60, 0, 20, 5};
    g_assert_cmpint(ls_relight_finish(&take->field, all_px, outside, &term, 1, m, crop, NULL), ==,
                    LS_ERR_INVALID);
    relight_take_free(take);
}

/* A matrix per pixel: of diagonals, it is the ratio; whole, its products are those of the sum. Maps
 * of the whole picture serve a part of it through their stride. */
static void test_a_matrix_takes_the_place_of_a_ratio(void)
{
    struct take *take = relight_take_new(LS_CFA_RGGB, 0.1, LAYOUT_DOME);
    g_autofree float *rows = g_new(float, take->n), *sum = g_new(float, W *H);
    g_autofree float *ratio = g_new(float, W *H * 3), *matrix = g_new0(float, W *H * 9);
    g_autofree float *by_ratio = g_new(float, W *H * 3), *by_matrix = g_new(float, W *H * 3);
    g_autofree float *white = g_new(float, W *H * 3), *part = g_new(float, W *H * 3);
    const struct ls_demosaic_region crop = {9, 21, 31, 20};
    struct ls_relight_term term = {.sum = sum, .channel = -1};
    ls_relight_row(take->k, take->omega, take->n, rows);
    relight_take_sum(&take->field, take->field.white, take->n, rows, 1, sum);
    relight_take_ratio(&take->field, 1, ratio);
    for (size_t j = 0; j < (size_t)W * H; j++)
        for (size_t c = 0; c < 3; c++)
            matrix[9 * j + 4 * c] = ratio[3 * j + c];
    g_assert_cmpint(ls_relight_finish(&take->field, all_px, all_px, &term, 1, NULL, white, NULL),
                    ==, LS_OK);
    term.ratio = ratio;
    g_assert_cmpint(ls_relight_finish(&take->field, all_px, all_px, &term, 1, NULL, by_ratio, NULL),
                    ==, LS_OK);
    term.ratio = NULL;
    term.matrix = matrix;
    g_assert_cmpint(
        ls_relight_finish(&take->field, all_px, all_px, &term, 1, NULL, by_matrix, NULL), ==,
        LS_OK);
    for (size_t k = 0; k < (size_t)W * H * 3; k++)
        g_assert_cmpfloat(by_matrix[k], ==, by_ratio[k]); /* adding zeros changes nothing */

    for (size_t k = 0; k < (size_t)W * H * 9; k++)
        matrix[k] = (float)(k % 7) - 2;
    term.matrix = matrix + (crop.y * W + crop.x) * 9;
    term.map_stride = W * 9;
    g_assert_cmpint(ls_relight_finish(&take->field, all_px, crop, &term, 1, NULL, part, NULL), ==,
                    LS_OK);
    for (uint32_t y = 0; y < crop.height; y++)
        for (uint32_t x = 0; x < crop.width; x++)
            for (uint32_t c = 0; c < 3; c++) {
                size_t at = (crop.y + y) * W + crop.x + x;
                const float *v = white + 3 * at, *m = matrix + 9 * at + 3 * c;
                g_assert_cmpfloat(part[(y * crop.width + x) * 3 + c], ==,
                                  (m[0] * v[0] + m[1] * v[1]) + m[2] * v[2]);
            }
    term.channel = 1;
    g_assert_cmpint(ls_relight_finish(&take->field, all_px, crop, &term, 1, NULL, part, NULL), ==,
                    LS_ERR_INVALID);
    term.channel = -1;
    term.ratio = ratio;
    g_assert_cmpint(ls_relight_finish(&take->field, all_px, crop, &term, 1, NULL, part, NULL), ==,
                    LS_ERR_INVALID);
    relight_take_free(take);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/relight/a-promoted-relit-picture-is-the-definition",
                    test_a_promoted_relit_picture_is_the_definition);
    g_test_add_data_func("/relight/white-furnace-reads-the-albedo", GINT_TO_POINTER(LAYOUT_DOME),
                         test_white_furnace);
    g_test_add_data_func("/relight/white-furnace-of-346-lights-reads-the-albedo",
                         GINT_TO_POINTER(LAYOUT_346), test_white_furnace);
    g_test_add_data_func("/relight/white-furnace-of-doubled-lights-reads-the-albedo",
                         GINT_TO_POINTER(LAYOUT_DOUBLED), test_white_furnace);
    g_test_add_data_func("/relight/white-furnace-of-partly-doubled-lights-reads-the-albedo",
                         GINT_TO_POINTER(LAYOUT_PARTLY), test_white_furnace);
    g_test_add_func("/relight/the-weighted-denominator-beats-the-paper-s",
                    test_the_weighted_denominator_beats_the_paper_s);
    g_test_add_func("/relight/the-tristimulus-baseline-tints-a-white-object",
                    test_the_tristimulus_baseline_tints_a_white_object);
    g_test_add_func("/relight/a-crop-is-bit-identical-and-the-matrix-comes-last",
                    test_a_crop_is_bit_identical_and_the_matrix_comes_last);
    g_test_add_func("/relight/a-matrix-takes-the-place-of-a-ratio",
                    test_a_matrix_takes_the_place_of_a_ratio);
    return g_test_run();
}
