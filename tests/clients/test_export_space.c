#include "clients/export_space.h"

#include <glib.h>
#include <string.h>

static void fails(const char *name, const struct ls_take_document *document, enum ls_err expected,
                  const char *sentence)
{
    struct ls_export_space space;
    struct ls_diag diag = {0};
    g_assert_cmpint(ls_export_space_begin(&space, name, document, &diag), ==, expected);
    g_assert_nonnull(strstr(diag.text, sentence));
}

static void without_a_matrix_there_is_only_the_cameras_space(void)
{
    struct ls_calibration calibration = {0};
    struct ls_take_document none = {0}, without = {.calibration = &calibration};
    struct ls_calibration with_m = {.has_m = true};
    struct ls_take_document mono = {.calibration = &with_m, .mono = true};
    struct ls_export_space space;
    fails("rec709", &none, LS_ERR_UNSUPPORTED, "no matrix M");
    fails("acescg", &without, LS_ERR_UNSUPPORTED, "no matrix M");
    fails("rec709", &mono, LS_ERR_UNSUPPORTED, "mono");
    fails("Rec709", &mono, LS_ERR_INVALID, "expected camera, rec709 or acescg");
    g_assert_cmpint(ls_export_space_begin(&space, "camera", &none, NULL), ==, LS_OK);
    g_assert_null(space.primaries);
    g_assert_false(space.shown);
}

/* rec709 is M to the last bit, and acescg goes back to it. */
static void the_way_is_the_calibrations_matrix(void)
{
    static const double m[3][3] = {{1.75, -0.6, -0.15}, {-0.3, 1.9, -0.6}, {0, -0.7, 1.7}};
    struct ls_calibration calibration = {.has_m = true};
    struct ls_take_document document = {.calibration = &calibration};
    struct ls_export_space space;
    double back[3][3];
    memcpy(calibration.m, m, sizeof m);
    g_assert_cmpint(ls_export_space_begin(&space, "rec709", &document, NULL), ==, LS_OK);
    g_assert_cmpmem(space.from_camera, sizeof m, m, sizeof m);
    g_assert_cmpint(ls_export_space_begin(&space, "acescg", &document, NULL), ==, LS_OK);
    ls_colours_multiply(space.to_rec709, space.from_camera, back);
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++)
            g_assert_cmpfloat_with_epsilon(back[r][c], m[r][c], 1e-14); /* core/primaries.h */
    g_assert_cmpint(ls_export_space_begin(&space, "camera", &document, NULL), ==, LS_OK);
    g_assert_true(space.shown);
    g_assert_cmpmem(space.to_rec709, sizeof m, m, sizeof m);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/export-space/without-a-matrix-there-is-only-the-cameras-space",
                    without_a_matrix_there_is_only_the_cameras_space);
    g_test_add_func("/export-space/the-way-is-the-calibrations-matrix",
                    the_way_is_the_calibrations_matrix);
    return g_test_run();
}
