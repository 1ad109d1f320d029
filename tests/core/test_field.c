/* field: what cannot be right is refused; regions of tiles. */
#include "tests/core/relight_take.h"

#include <math.h>
#include <string.h>

static void refused(struct take *take, const struct ls_field *field, const char *word)
{
    struct ls_diag diag = {{0}};
    g_assert_cmpint(ls_field_check(field, &diag), ==, LS_ERR_INVALID);
    g_assert_nonnull(strstr(diag.text, word));
}

static void test_a_field_that_cannot_be_right_is_refused(void)
{
    struct take *take = relight_take_new(LS_CFA_RGGB, 0.1, LAYOUT_DOME);
    double bad[SPECTRA * N_MAX];
    struct ls_field f = take->field;
    f.n_channels = 1;
    refused(take, &f, "channels");
    f = take->field;
    f.scale = NAN;
    refused(take, &f, "scale");
    f = take->field;
    memcpy(bad, take->duty, sizeof take->duty);
    bad[1] = 0;
    f.duty = bad;
    refused(take, &f, "duty");
    f = take->field;
    memcpy(bad, take->omega, sizeof take->omega);
    bad[3] += 0.1;
    f.omega_sr = bad;
    refused(take, &f, "4 pi");
    f = take->field;
    memcpy(bad, take->p, sizeof take->p);
    bad[1] = 2;
    f.p = bad;
    refused(take, &f, "green");
    f = take->field;
    f.k = NULL;
    refused(take, &f, "missing");
    g_assert_cmpint(ls_field_normalise_gains((const double[]){1, 0}, 2, bad, bad, NULL), ==,
                    LS_ERR_INVALID);
    relight_take_free(take);
}

static void test_regions_of_pixels_carry_their_halo(void)
{
    const struct ls_field field = {.width = 130, .height = 64};
    struct ls_tile_region r = ls_region_of_pixels(&field, 64, 0, 66, 10, 2);
    g_assert_cmpuint(r.x0, ==, 0);
    g_assert_cmpuint(r.x1, ==, 2);
    g_assert_cmpuint(r.y1, ==, 1);
    r = ls_region_of_pixels(&field, 66, 0, 127, 64, 2);
    g_assert_cmpuint(r.x0, ==, 1);
    g_assert_cmpuint(r.x1, ==, 3);
    g_assert_cmpuint(ls_region_width_px(&field, &r), ==, 66);
    g_assert_cmpuint(ls_region_height_px(&field, &r), ==, 64);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/field/a-field-that-cannot-be-right-is-refused",
                    test_a_field_that_cannot_be_right_is_refused);
    g_test_add_func("/field/regions-of-pixels-carry-their-halo",
                    test_regions_of_pixels_carry_their_halo);
    return g_test_run();
}
