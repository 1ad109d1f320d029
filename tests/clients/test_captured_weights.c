/* light_weights of a light that was captured: a ball and a chart photographed where it shines. */
#include "clients/picture_file.h"
#include "tests/clients/weights_fixture.h"
#include "tests/daemon/take_fixture.h"

#include <glib/gstdio.h>
#include <math.h>
#include <string.h>
#include <unistd.h>

enum { BALL = 64 };

static const struct ls_environment_ball nobody;

/* A folder with a mirror ball of one colour, half reflecting, and a chart that reads @scale times
 * what the calibration's chart reads of LED R. Its patch 0, taken for a neutral of 50 %, ties the
 * two together: the ball's colour is twice what it reads. */
static char *captured_folder(const struct ls_calibration *cal, double scale, uint32_t n_patches,
                             bool says_reflectivity)
{
    char *folder = g_dir_make_tmp("captured-XXXXXX", NULL);
    g_autofree char *ball = g_build_filename(folder, "ball.exr", NULL);
    g_autofree char *file = g_build_filename(folder, "probe.json", NULL);
    struct ls_exr_attrs attrs = {0};
    struct ls_picture_place place = {0};
    struct ls_image image = {0};
    g_autoptr(GString) json =
        g_string_new("{\"format\":1,\"ball\":{\"picture\":\"ball.exr\",\"centre_px\":[32,32],"
                     "\"radius_px\":30,\"camera_direction\":[0,0,1],\"polariser\":\"none\"");
    if (says_reflectivity)
        g_string_append(json, ",\"reflectivity\":[0.5,0.5,0.5]");
    g_string_append(json, "},\"neutrals\":[{\"patch\":0,\"reflectance\":0.5}],\"charts\":[{"
                          "\"normal\":[0,0,1],\"rgb\":[");
    for (uint32_t p = 0; p < n_patches; p++)
        for (uint32_t c = 0; c < 3; c++)
            g_string_append_printf(json, "%s%.9g%s",
                                   c   ? ","
                                   : p ? ",["
                                       : "[",
                                   scale * (double)cal->L[(p * 3 + c) * cal->n_channels + 1],
                                   c == 2 ? "]" : "");
    g_string_append(json, "]}]}");
    g_assert_true(g_file_set_contents(file, json->str, -1, NULL));
    g_assert_cmpint(ls_image_init(&image, BALL, BALL, 3, SIZE_MAX, NULL), ==, LS_OK);
    for (uint32_t i = 0; i < BALL * BALL * 3; i++)
        image.pixels[i] = 0.5f * 2 * cal->L[i % 3 * cal->n_channels + 1];
    g_assert_cmpint(ls_picture_file_exr(ball, &image, LS_EXR_FLOAT, &place, NULL, &attrs, NULL), ==,
                    LS_OK);
    ls_image_finish(&image);
    ls_exr_attrs_finish(&attrs);
    return folder;
}

static void remove_captured(char *folder)
{
    g_autofree char *ball = g_build_filename(folder, "ball.exr", NULL);
    g_autofree char *file = g_build_filename(folder, "probe.json", NULL);
    g_unlink(ball);
    g_unlink(file);
    g_rmdir(folder);
    g_free(folder);
}

/* The chart was photographed at another exposure than the ball: only the ball says how bright. */
static void a_captured_light_of_an_led_is_made_with_that_led(void)
{
    struct ls_take_document *document = weights_document(true);
    char *folder = captured_folder(document->calibration, 7.3, TAKE_PATCHES, true);
    g_autofree char *file = g_build_filename(folder, "probe.json", NULL);
    struct ls_environment_file environment;
    struct ls_diag diag = {0};
    enum ls_err err =
        ls_environment_file_read(file, LS_MAP_REC709_LINEAR, &nobody, &environment, &diag);
    g_assert_cmpstr(diag.text, ==, "");
    g_assert_cmpint(err, ==, LS_OK);
    g_assert_cmpint(environment.map.space, ==, LS_MAP_CAMERA_RAW);
    g_assert_null(environment.warning);
    /* two pixels of thirty: acos(28/30) either side of the axis */
    g_assert_cmpfloat_with_epsilon(environment.filled_sr, 2 * M_PI * (1 - cos(2 * acos(28.0 / 30))),
                                   0.1);
    struct ls_light_weights weights = weights_solved(document, &environment, false);
    weights_assert_row(&weights, 1, document->omega_sr, 1, 1e-4);
    weights_assert_row(&weights, 0, document->omega_sr, 0, 1e-4);
    g_assert_true(weights.solved);
    ls_light_weights_finish(&weights);
    remove_captured(folder);
    ls_take_document_destroy(document);
}

/* The file's own value, else what was measured with the rig, else the profile's, else 1 and a
 * warning. What the ball shows is divided by it, to a rounding. */
static void a_balls_reflectivity_comes_from_who_knows_it_best(void)
{
    const struct ls_profile *paper = ls_profile_find("paper");
    const double one[3] = {1, 1, 1}, half[3] = {0.5, 0.5, 0.5};
    struct ls_take_document *document = weights_document(true);
    struct ls_calibration *cal = document->calibration;
    const struct {
        bool says, measured, profile;
        const double *expected;
    } cases[] = {{true, true, true, half},
                 {false, true, true, cal->mirror_reflectivity},
                 {false, true, false, cal->mirror_reflectivity},
                 {false, false, true, paper->ball_reflectivity},
                 {false, false, false, one}};
    memcpy(cal->mirror_reflectivity, (double[3]){0.7, 0.8, 0.9}, sizeof cal->mirror_reflectivity);
    for (size_t k = 0; k < G_N_ELEMENTS(cases); k++) {
        char *folder = captured_folder(cal, 1, TAKE_PATCHES, cases[k].says);
        g_autofree char *file = g_build_filename(folder, "probe.json", NULL);
        const struct ls_environment_ball known = {cal, cases[k].profile ? paper : NULL};
        struct ls_environment_file environment;
        struct ls_diag diag = {0};
        cal->has_mirror = cases[k].measured;
        enum ls_err err =
            ls_environment_file_read(file, LS_MAP_REC709_LINEAR, &known, &environment, &diag);
        g_assert_cmpstr(diag.text, ==, "");
        g_assert_cmpint(err, ==, LS_OK);
        for (uint32_t i = 0; i < environment.map.width * environment.map.height * 3; i++)
            g_assert_cmpfloat_with_epsilon((double)environment.image.pixels[i] *
                                               cases[k].expected[i % 3] /
                                               (double)cal->L[i % 3 * cal->n_channels + 1],
                                           1, 1e-5);
        g_assert_cmpint(environment.warning != NULL, ==, cases[k].expected == one);
        ls_environment_file_finish(&environment);
        remove_captured(folder);
    }
    ls_take_document_destroy(document);
}

static void another_chart_than_the_calibrations_is_refused(void)
{
    struct ls_take_document *document = weights_document(true);
    char *folder = captured_folder(document->calibration, 1, TAKE_PATCHES - 1, true);
    g_autofree char *file = g_build_filename(folder, "probe.json", NULL);
    const struct ls_light_options options = {.model = LIGHTSTAGE_SPHERE};
    struct ls_environment_file environment;
    struct ls_light_weights weights;
    struct ls_diag diag = {0};
    g_assert_cmpint(
        ls_environment_file_read(file, LS_MAP_REC709_LINEAR, &nobody, &environment, &diag), ==,
        LS_OK);
    g_assert_cmpint(ls_light_weights_make(document, &environment, &options, &weights, &diag), ==,
                    LS_ERR_UNSUPPORTED);
    g_assert_nonnull(strstr(diag.text, "patches"));
    ls_environment_file_finish(&environment);
    remove_captured(folder);
    ls_take_document_destroy(document);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/light-weights/a-captured-light-of-an-led-is-made-with-that-led",
                    a_captured_light_of_an_led_is_made_with_that_led);
    g_test_add_func("/light-weights/a-balls-reflectivity-comes-from-who-knows-it-best",
                    a_balls_reflectivity_comes_from_who_knows_it_best);
    g_test_add_func("/light-weights/another-chart-than-the-calibrations-is-refused",
                    another_chart_than_the_calibrations_is_refused);
    return g_test_run();
}
