/* light_weights: environments whose weights are known, on a rig whose spectra are known. */
#include "clients/light_weights.h"
#include "clients/picture_file.h"
#include "tests/daemon/take_fixture.h"

#include <glib/gstdio.h>
#include <jansson.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static struct ls_take_document *a_document(bool calibrated)
{
    struct ls_calibration *cal = made_calibration();
    struct ls_take_document *document = NULL;
    struct ls_diag diag = {0};
    char *text = take_json_text(calibrated ? cal : NULL, 1);
    enum ls_err err = ls_take_document_parse(text, strlen(text), 0, &document, &diag);
    g_assert_cmpstr(diag.text, ==, "");
    g_assert_cmpint(err, ==, LS_OK);
    ls_calibration_destroy(cal);
    g_free(text);
    return document;
}

/* One lobe, the same from everywhere, radiance 2, the spectrum of LED channel @channel. */
static struct ls_environment_file lit_by_channel(int channel)
{
    struct ls_environment_file environment = {0};
    GString *json = g_string_new("{\"format\": 1, \"lobes\": [{\"direction\": [0, 1, 0], "
                                 "\"sharpness\": 0, \"radiance\": 2, \"spectrum\": "
                                 "{\"wavelength_nm\": [380");
    for (int i = 1; i < 81; i++)
        g_string_append_printf(json, ", %d", 380 + 5 * i);
    for (int i = 0; i < 81; i++)
        g_string_append_printf(json, "%s%.9g", i ? ", " : "], \"value\": [",
                               made_spectrum(channel, 380 + 5 * i));
    g_string_append(json, "]}}]}");
    g_assert_cmpint(ls_lobes_parse_json(json->str, json->len, &environment.lobes, NULL), ==, LS_OK);
    g_string_free(json, TRUE);
    return environment;
}

static struct ls_environment_file constant_map(float r, float g, float b)
{
    struct ls_environment_file environment = {0};
    g_assert_cmpint(ls_image_init(&environment.image, 32, 16, 3, SIZE_MAX, NULL), ==, LS_OK);
    for (int i = 0; i < 32 * 16; i++) {
        environment.image.pixels[3 * i] = r;
        environment.image.pixels[3 * i + 1] = g;
        environment.image.pixels[3 * i + 2] = b;
    }
    environment.map = (struct ls_map){environment.image.pixels, 32, 16, LS_MAP_REC709_LINEAR};
    return environment;
}

static struct ls_light_weights solve(const struct ls_take_document *document,
                                     struct ls_environment_file *environment, bool tristimulus)
{
    struct ls_light_weights weights;
    struct ls_diag diag = {0};
    const struct ls_light_options options = {.model = LIGHTSTAGE__MODEL__SPHERE,
                                             .solve = tristimulus ? LS_LIGHT_TRISTIMULUS
                                                                  : LS_LIGHT_SPECTRAL};
    enum ls_err err = ls_light_weights_make(document, environment, &options, &weights, &diag);
    g_assert_cmpstr(diag.text, ==, "");
    g_assert_cmpint(err, ==, LS_OK);
    ls_environment_file_finish(environment);
    return weights;
}

static void assert_row(const struct ls_light_weights *weights, uint32_t row, const double *omega,
                       double radiance, double tolerance)
{
    for (uint32_t i = 0; i < weights->n_lights; i++)
        g_assert_cmpfloat_with_epsilon((double)weights->rows[(size_t)row * weights->n_lights + i],
                                       radiance * omega[i], tolerance);
}

/* The chart's L and P come from the same integrals, so the solve must find its own LED: exactly,
 * but for the float storage of L and of the spectra (2^-24, amplified by the chart's condition). */
static void light_of_an_led_is_made_with_that_led(void)
{
    struct ls_take_document *document = a_document(true);
    for (int channel = 0; channel < 2; channel++) {
        struct ls_environment_file environment = lit_by_channel(channel);
        struct ls_light_weights weights = solve(document, &environment, false);
        g_assert_cmpint(weights.mode, ==, LIGHTSTAGE__WEIGHT_MODE__SHARED);
        g_assert_cmpuint(weights.n_names, ==, 2);
        g_assert_cmpstr(weights.names[0], ==, "W");
        g_assert_cmpstr(weights.names[1], ==, "R");
        assert_row(&weights, (uint32_t)channel, document->omega_sr, 2, 1e-4);
        assert_row(&weights, (uint32_t)!channel, document->omega_sr, 0, 1e-4);
        ls_light_weights_finish(&weights);
    }
    ls_take_document_destroy(document);
}

/* Under light of the white LED the camera reads p(W, c): that, times Omega, is the baseline. */
static void tristimulus_weights_are_the_cameras_reading(void)
{
    struct ls_take_document *document = a_document(true);
    struct ls_environment_file environment = lit_by_channel(0);
    struct ls_light_weights weights = solve(document, &environment, true);
    g_assert_cmpint(weights.mode, ==, LIGHTSTAGE__WEIGHT_MODE__TRISTIMULUS);
    for (uint32_t c = 0; c < 3; c++)
        assert_row(&weights, c, document->omega_sr, 2 * (double)document->calibration->p[0][c],
                   1e-4);
    ls_light_weights_finish(&weights);
    ls_take_document_destroy(document);
}

/* A map's RGB through M's inverse: M brings it back. */
static void a_maps_tristimulus_weights_come_back_through_m(void)
{
    static const float rgb[3] = {0.8f, 0.5f, 0.3f};
    struct ls_take_document *document = a_document(true);
    struct ls_environment_file environment = constant_map(rgb[0], rgb[1], rgb[2]);
    struct ls_light_weights weights = solve(document, &environment, true);
    const double(*m)[3] = (const double(*)[3])document->calibration->m;
    for (uint32_t i = 0; i < TAKE_LIGHTS; i++)
        for (int r = 0; r < 3; r++) {
            double back = 0;
            for (int c = 0; c < 3; c++)
                back += m[r][c] * (double)weights.rows[c * TAKE_LIGHTS + i];
            g_assert_cmpfloat_with_epsilon(back, (double)rgb[r] * document->omega_sr[i], 1e-4);
        }
    ls_light_weights_finish(&weights);
    ls_take_document_destroy(document);
}

/* Two LEDs cannot match a colour map exactly; but weights are linear in its brightness and not
 * negative, and a constant map weights every light by its cell. */
static void a_constant_map_weights_lights_by_their_cells(void)
{
    struct ls_take_document *document = a_document(true);
    struct ls_environment_file dim = constant_map(1, 1, 1), bright = constant_map(3, 3, 3);
    struct ls_light_weights a = solve(document, &dim, false), b = solve(document, &bright, false);
    for (uint32_t r = 0; r < a.n_rows; r++)
        for (uint32_t i = 0; i < TAKE_LIGHTS; i++) {
            double w = (double)a.rows[r * TAKE_LIGHTS + i];
            double first = (double)a.rows[r * TAKE_LIGHTS] / document->omega_sr[0];
            g_assert_cmpfloat(w, >=, 0);
            g_assert_cmpfloat_with_epsilon(w / document->omega_sr[i], first, 1e-3 * (first + 0.1));
            g_assert_cmpfloat_with_epsilon((double)b.rows[r * TAKE_LIGHTS + i], 3 * w,
                                           1e-4 * (3 * w + 0.1));
        }
    g_assert_cmpfloat(a.solution.worst.relative, <, 0.5);
    g_assert_cmpint(a.solution.space, ==, LS_SOLVE_AFTER_M);
    ls_light_weights_finish(&a);
    ls_light_weights_finish(&b);
    ls_take_document_destroy(document);
}

/* A warm map asks for more red LED than a cold one. */
static void a_warm_map_asks_for_more_red(void)
{
    struct ls_take_document *document = a_document(true);
    struct ls_environment_file warm = constant_map(1, 0.5f, 0.2f),
                               cold = constant_map(0.4f, 0.6f, 1);
    struct ls_light_weights a = solve(document, &warm, false), b = solve(document, &cold, false);
    g_assert_cmpfloat((double)a.rows[TAKE_LIGHTS], >, 2 * (double)b.rows[TAKE_LIGHTS]);
    ls_light_weights_finish(&a);
    ls_light_weights_finish(&b);
    ls_take_document_destroy(document);
}

static void without_a_calibration_the_maps_numbers_are_used(void)
{
    struct ls_take_document *document = a_document(false);
    struct ls_environment_file environment = constant_map(1, 2, 3);
    struct ls_light_weights weights = solve(document, &environment, false);
    struct ls_diag diag = {0};
    g_assert_cmpint(weights.mode, ==, LIGHTSTAGE__WEIGHT_MODE__TRISTIMULUS);
    g_assert_nonnull(weights.warning);
    for (uint32_t c = 0; c < 3; c++)
        assert_row(&weights, c, document->omega_sr, 1 + c, 1e-5);
    ls_light_weights_finish(&weights);
    environment = lit_by_channel(0);
    const struct ls_light_options spectral = {.model = LIGHTSTAGE__MODEL__SPHERE};
    g_assert_cmpint(ls_light_weights_make(document, &environment, &spectral, &weights, &diag), ==,
                    LS_ERR_UNSUPPORTED);
    g_assert_nonnull(strstr(diag.text, "RGB map"));
    ls_environment_file_finish(&environment);
    ls_take_document_destroy(document);
}

/* A bright cap about the zenith lights from above only. */
static void the_light_comes_from_where_the_map_has_it(void)
{
    struct ls_take_document *document = a_document(true);
    struct ls_environment_file map = constant_map(0, 0, 0);
    double above = 0, below = 0;
    for (int i = 0; i < 32 * 4 * 3; i++)
        map.image.pixels[i] = 1; /* v < 1/4: within 45 degrees of up */
    struct ls_light_weights weights = solve(document, &map, true);
    for (uint32_t i = 0; i < TAKE_LIGHTS; i++)
        *(document->direction[i][1] > 0 ? &above : &below) += (double)weights.rows[TAKE_LIGHTS + i];
    g_assert_cmpfloat(above, >, 0);
    g_assert_cmpfloat(below, ==, 0);
    ls_light_weights_finish(&weights);
    ls_take_document_destroy(document);
}

/* Where the lights' own weights point, summed: the direction the light comes from. */
static void direction_of_light(const struct ls_take_document *document, double turn_deg,
                               double out[3])
{
    struct ls_environment_file map = constant_map(0, 0, 0);
    struct ls_light_weights weights;
    memset(out, 0, 3 * sizeof *out);
    for (int y = 4; y < 12; y++)
        for (int x = 14; x < 18; x++) /* u = 1/2: the middle, behind the subject, at -z */
            for (int c = 0; c < 3; c++)
                map.image.pixels[3 * (y * 32 + x) + c] = 1;
    const struct ls_light_options options = {.solve = LS_LIGHT_TRISTIMULUS, .turn_deg = turn_deg};
    g_assert_cmpint(ls_light_weights_make(document, &map, &options, &weights, NULL), ==, LS_OK);
    for (uint32_t i = 0; i < weights.n_lights; i++)
        for (int a = 0; a < 3; a++)
            out[a] +=
                (double)weights.rows[weights.n_lights + i] * (double)document->direction[i][a];
    ls_light_weights_finish(&weights);
    ls_environment_file_finish(&map);
}

/* Right-handed about y: (x, z) = r (sin a, -cos a) turned by +t is r (sin(a - t), -cos(a - t)), so
 * 90 degrees bring the middle, -z, to -x. Seven cells are coarse: the nearest light is up to about
 * 40 degrees away, the sign and the larger part must be right (cos 40 = 0.77). */
static void a_positive_rotation_turns_the_middle_to_camera_left(void)
{
    static const struct {
        double turn_deg, x, z;
    } cases[] = {{0, 0, -1}, {90, -1, 0}, {180, 0, 1}, {270, 1, 0}, {-90, 1, 0}};
    struct ls_take_document *document = a_document(true);
    for (size_t i = 0; i < G_N_ELEMENTS(cases); i++) {
        double d[3];
        direction_of_light(document, cases[i].turn_deg, d);
        double length = hypot(d[0], d[2]);
        g_test_message("%g degrees: x %.3f z %.3f", cases[i].turn_deg, d[0] / length,
                       d[2] / length);
        g_assert_cmpfloat((d[0] * cases[i].x + d[2] * cases[i].z) / length, >, 0.77);
    }
    ls_take_document_destroy(document);
}

static void damaged_documents_are_refused_by_key(void)
{
    static const char *const texts[] = {"",
                                        "[]",
                                        "{}",
                                        "{\"rig\": 5}",
                                        "{\"rig\": {\"lights\": {\"position_m\": [[0,0,0]]}}}",
                                        "{\"rig\": {\"lights\": {\"position_m\": [[1,\"x\"]]}}}"};
    for (size_t i = 0; i < G_N_ELEMENTS(texts); i++) {
        struct ls_take_document *document = NULL;
        struct ls_diag diag = {0};
        g_assert_cmpint(ls_take_document_parse(texts[i], strlen(texts[i]), 0, &document, &diag), ==,
                        LS_ERR_INVALID);
        g_assert_nonnull(strstr(diag.text, "take.json"));
    }
}

/* ---- a captured environment ---- */

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
    struct ls_take_document *document = a_document(true);
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
    struct ls_light_weights weights = solve(document, &environment, false);
    assert_row(&weights, 1, document->omega_sr, 1, 1e-4);
    assert_row(&weights, 0, document->omega_sr, 0, 1e-4);
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
    struct ls_take_document *document = a_document(true);
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
    struct ls_take_document *document = a_document(true);
    char *folder = captured_folder(document->calibration, 1, TAKE_PATCHES - 1, true);
    g_autofree char *file = g_build_filename(folder, "probe.json", NULL);
    const struct ls_light_options options = {.model = LIGHTSTAGE__MODEL__SPHERE};
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

/* ---- options ---- */

static void words_of_the_command_line_are_understood(void)
{
    enum ls_light_solve solve_how;
    enum ls_light_method method;
    bool smooth;
    g_assert_true(ls_light_solve_option("per-target", &solve_how));
    g_assert_cmpint(solve_how, ==, LS_LIGHT_PER_TARGET);
    g_assert_false(ls_light_solve_option("best", &solve_how));
    g_assert_true(ls_light_method_option("least-squares", &method));
    g_assert_cmpint(method, ==, LS_LIGHT_METHOD_LEAST_SQUARES);
    g_assert_false(ls_light_method_option("", &method));
    g_assert_true(ls_light_cells_option("smooth", &smooth) && smooth);
    g_assert_false(ls_light_cells_option("cubic", &smooth));
}

/* Every way of solving finds the LED that the light is of; per-target fits one channel at a time.
 */
static void every_solve_and_method_finds_the_led(void)
{
    struct ls_take_document *document = a_document(true);
    for (int k = 0; k < 8; k++) {
        struct ls_environment_file environment = lit_by_channel(1);
        const struct ls_light_options options = {
            .model = LIGHTSTAGE__MODEL__SPHERE,
            .solve = k & 1 ? LS_LIGHT_PER_TARGET : LS_LIGHT_SHARED,
            .method = k & 2 ? LS_LIGHT_METHOD_LEAST_SQUARES : LS_LIGHT_METHOD_NNLS,
            .smooth = k & 4};
        struct ls_light_weights weights;
        struct ls_diag diag = {0};
        enum ls_err err = ls_light_weights_make(document, &environment, &options, &weights, &diag);
        g_assert_cmpstr(diag.text, ==, "");
        g_assert_cmpint(err, ==, LS_OK);
        g_assert_cmpuint(weights.n_rows, ==, k & 1 ? 6 : 2);
        g_assert_cmpint(weights.solution.space, ==, LS_SOLVE_AFTER_M);
        g_assert_cmpint(weights.by_target, ==, k & 1);
        double red = 0, all = 0;
        for (uint32_t r = 0; r < weights.n_rows; r++)
            for (uint32_t i = 0; i < weights.n_lights; i++) {
                double w = fabs((double)weights.rows[r * weights.n_lights + i]);
                all += w;
                red += r % 2 == 1 ? w : 0;
            }
        /* least squares are damped by 1e-3 of the mean diagonal, and one channel alone tells two
         * spectra apart badly: within a tenth; the others are exact */
        g_assert_cmpfloat(red / all, >, k & 2 ? 0.9 : 0.999);
        ls_light_weights_finish(&weights);
        ls_environment_file_finish(&environment);
    }
    ls_take_document_destroy(document);
}

/* ---- damping and row weights ---- */

static struct ls_light_weights solve_damped(const struct ls_take_document *document,
                                            double tikhonov, const struct ls_row_weights *rows)
{
    struct ls_environment_file environment = constant_map(0.8f, 0.5f, 0.3f);
    const struct ls_light_options options = {.model = LIGHTSTAGE__MODEL__SPHERE,
                                             .method = LS_LIGHT_METHOD_LEAST_SQUARES,
                                             .damped = true,
                                             .tikhonov = tikhonov,
                                             .rows = rows};
    struct ls_light_weights weights;
    struct ls_diag diag = {0};
    enum ls_err err = ls_light_weights_make(document, &environment, &options, &weights, &diag);
    g_assert_cmpstr(diag.text, ==, "");
    g_assert_cmpint(err, ==, LS_OK);
    g_assert_cmpfloat(weights.tikhonov, ==, tikhonov);
    ls_environment_file_finish(&environment);
    return weights;
}

static double norm(const struct ls_light_weights *weights)
{
    double sum = 0;
    for (uint32_t i = 0; i < weights->n_rows * weights->n_lights; i++)
        sum += (double)weights->rows[i] * (double)weights->rows[i];
    return sqrt(sum);
}

/* x = (A'A + t m I)^-1 A'b with m the mean diagonal: the norm falls with t, is that of the plain
 * solution at 0, and at large t is |A'b| / (t m), so ten times t is a tenth of it. */
static void damping_is_of_the_mean_diagonal(void)
{
    struct ls_take_document *document = a_document(true);
    double last = INFINITY, norms[4];
    static const double t[4] = {0, 1e-2, 1e5, 1e6};
    for (int k = 0; k < 4; k++) {
        struct ls_light_weights weights = solve_damped(document, t[k], NULL);
        norms[k] = norm(&weights);
        g_assert_cmpfloat(norms[k], <, last);
        last = norms[k];
        ls_light_weights_finish(&weights);
    }
    g_assert_cmpfloat_with_epsilon(norms[2] / norms[3], 10,
                                   1e-3); /* 1 / t of it is not yet there */
    ls_take_document_destroy(document);
}

/* A patch of the chart that reads twice what it should spoils the light of an LED; what counts for
 * nothing does not, in one channel or all. */
static void a_row_counts_as_much_as_it_is_told(void)
{
    struct ls_take_document *document = a_document(true);
    double patches[TAKE_PATCHES], rows[3 * TAKE_PATCHES];
    for (int i = 0; i < 3 * TAKE_PATCHES; i++) {
        patches[i / 3] = i / 3 == 2 ? 0 : 3;
        rows[i] = i / 3 == 2 ? 0 : 3;
    }
    const struct ls_row_weights by_patch = {TAKE_PATCHES, 1, patches},
                                by_row = {TAKE_PATCHES, 3, rows};
    const struct ls_row_weights *const given[] = {NULL, &by_patch, &by_row};
    size_t n = 3 * (size_t)document->calibration->n_channels; /* readings of a patch */
    for (size_t i = 2 * n; i < 3 * n; i++)
        document->calibration->L[i] *= 2;
    for (int k = 0; k < 3; k++) {
        struct ls_environment_file environment = lit_by_channel(1);
        const struct ls_light_options options = {.model = LIGHTSTAGE__MODEL__SPHERE,
                                                 .rows = given[k]};
        struct ls_light_weights weights;
        g_assert_cmpint(ls_light_weights_make(document, &environment, &options, &weights, NULL), ==,
                        LS_OK);
        double off = 0; /* by more than 1e-4 is not what floats do */
        for (uint32_t i = 0; i < TAKE_LIGHTS; i++)
            off =
                fmax(off, fabs((double)weights.rows[TAKE_LIGHTS + i] / document->omega_sr[i] - 2));
        g_assert_true((off > 1e-3) == (k == 0));
        ls_light_weights_finish(&weights);
        ls_environment_file_finish(&environment);
    }
    ls_take_document_destroy(document);
}

static void row_weights_of_another_chart_are_refused(void)
{
    static const char *const bad[] = {
        "{}",         "[]",      "[1, -1]",        "[0, 0]", "[[1, 2, 3], 4]",
        "[1, \"x\"]", "[1e999]", "[[1, 2, 3, 4]]", "[1"};
    g_autofree char *path = g_build_filename(g_get_tmp_dir(), "ls-rows-XXXXXX", NULL);
    struct ls_row_weights rows = {0};
    struct ls_diag diag = {0};
    double *out = NULL;
    close(g_mkstemp(path));
    for (size_t i = 0; i < G_N_ELEMENTS(bad); i++) {
        g_assert_true(g_file_set_contents(path, bad[i], -1, NULL));
        g_assert_cmpint(ls_row_weights_read(path, &rows, &diag), ==, LS_ERR_INVALID);
        g_assert_nonnull(strstr(diag.text, path));
    }
    g_assert_true(g_file_set_contents(path, "[[1, 2, 0.5], [0, 1, 1]]", -1, NULL));
    g_assert_cmpint(ls_row_weights_read(path, &rows, &diag), ==, LS_OK);
    g_assert_cmpint(ls_row_weights_for(&rows, 2, 3, &out, &diag), ==, LS_OK);
    g_assert_cmpfloat(out[2], ==, 0.5);
    free(out);
    g_assert_cmpint(ls_row_weights_for(&rows, 3, 3, &out, &diag), ==, LS_ERR_INVALID);
    g_assert_cmpint(ls_row_weights_for(&rows, 2, 1, &out, &diag), ==, LS_ERR_INVALID);
    ls_row_weights_finish(&rows);
    g_unlink(path);
}

/* The document of a take whose plan has, in place of the sphere of R, a condition of @kind. */
static struct ls_take_document *a_document_with(const char *kind, const char *pattern)
{
    struct ls_calibration *cal = made_calibration();
    struct ls_take_document *document = NULL;
    g_autofree char *text = take_json_text(cal, 1);
    json_t *doc = json_loads(text, 0, NULL), *item;
    size_t i;
    json_array_foreach(
        json_object_get(json_object_get(doc, "plan"), "conditions"), i,
        item) if (!strcmp(json_string_value(json_object_get(item, "id")), "sphere-R"))
    {
        json_object_set_new(item, "kind", json_string(kind));
        if (pattern)
            json_object_set_new(item, "pattern", json_string(pattern));
    }
    char *changed = json_dumps(doc, JSON_REAL_PRECISION(17));
    g_assert_cmpint(ls_take_document_parse(changed, strlen(changed), 0, &document, NULL), ==,
                    LS_OK);
    free(changed);
    json_decref(doc);
    ls_calibration_destroy(cal);
    return document;
}

/* A spectrum is used as soon as the plan has what the model makes it of; a take that has the model
 * nothing but white says so. */
static void a_model_uses_the_spectra_it_is_served(void)
{
    static const struct {
        const char *kind, *pattern;
        bool served[5]; /* measured, sphere, headlight, separated, linear */
    } cases[] = {
        {"sphere", NULL, {false, true, false, true, false}},
        {"segment", "segments-14", {false, false, false, false, true}},
        {"segment", "lights-3", {false, false, false, false, true}},
        {"segment", "headlight", {false, false, true, false, false}},
        {"one", NULL, {true, false, true, false, true}},
    };
    for (size_t i = 0; i < G_N_ELEMENTS(cases); i++)
        for (int model = 0; model < 5; model++) {
            struct ls_take_document *document = a_document_with(cases[i].kind, cases[i].pattern);
            struct ls_environment_file environment = lit_by_channel(1);
            const struct ls_light_options options = {.model = (Lightstage__Model)model};
            struct ls_light_weights weights;
            struct ls_diag diag = {0};
            enum ls_err err =
                ls_light_weights_make(document, &environment, &options, &weights, &diag);
            if (cases[i].served[model]) {
                g_assert_cmpint(err, ==, LS_OK);
                g_assert_cmpuint(weights.n_names, ==, 2);
                g_assert_cmpstr(weights.names[1], ==, "R");
                g_assert_cmpstr(weights.left_out, ==, "");
                ls_light_weights_finish(&weights);
            } else {
                g_assert_cmpint(err, ==, LS_ERR_UNSUPPORTED);
                g_assert_nonnull(strstr(diag.text, "--model"));
            }
            ls_environment_file_finish(&environment);
            ls_take_document_destroy(document);
        }
}

/* The daemon's rule (daemon/field_pictures.c): a calibration by the other way round would exchange
 * a_V and a_H. */
static void polarisers_go_by_name_and_else_by_order(void)
{
    static const struct {
        const char *names[4]; /* the first is a spectrum, whatever it is called */
        bool pair;
        uint32_t vertical, horizontal;
    } cases[] = {
        {{"W", "V", "H", NULL}, true, 1, 2}, {{"W", "H", "V", NULL}, true, 2, 1},
        {{"W", "P", "H", "V"}, true, 3, 2},  {{"W", "up", "level", NULL}, true, 1, 2},
        {{"V", "H", "P", NULL}, true, 1, 2}, {{"W", "H", NULL, NULL}, false, 0, 0},
    };
    for (size_t i = 0; i < G_N_ELEMENTS(cases); i++) {
        struct ls_take_document document = {0};
        uint32_t vertical, horizontal;
        for (int c = 0; c < 4 && cases[i].names[c]; c++) {
            g_strlcpy(document.channels[c].name, cases[i].names[c], 32);
            document.channels[c].spectrum = c == 0;
            document.n_channels++;
        }
        bool pair = ls_take_document_polarisers(&document, &vertical, &horizontal);
        g_assert_true(pair == cases[i].pair);
        g_assert_cmpuint(pair ? vertical : 0, ==, cases[i].vertical);
        g_assert_cmpuint(pair ? horizontal : 0, ==, cases[i].horizontal);
    }
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/take-document/polarisers-go-by-name-and-else-by-order",
                    polarisers_go_by_name_and_else_by_order);
    g_test_add_func("/light-weights/damping-is-of-the-mean-diagonal",
                    damping_is_of_the_mean_diagonal);
    g_test_add_func("/light-weights/a-row-counts-as-much-as-it-is-told",
                    a_row_counts_as_much_as_it_is_told);
    g_test_add_func("/light-weights/row-weights-of-another-chart-are-refused",
                    row_weights_of_another_chart_are_refused);
    g_test_add_func("/light-weights/light-of-an-led-is-made-with-that-led",
                    light_of_an_led_is_made_with_that_led);
    g_test_add_func("/light-weights/tristimulus-weights-are-the-cameras-reading",
                    tristimulus_weights_are_the_cameras_reading);
    g_test_add_func("/light-weights/a-maps-tristimulus-weights-come-back-through-m",
                    a_maps_tristimulus_weights_come_back_through_m);
    g_test_add_func("/light-weights/a-constant-map-weights-lights-by-their-cells",
                    a_constant_map_weights_lights_by_their_cells);
    g_test_add_func("/light-weights/a-warm-map-asks-for-more-red", a_warm_map_asks_for_more_red);
    g_test_add_func("/light-weights/without-a-calibration-the-maps-numbers-are-used",
                    without_a_calibration_the_maps_numbers_are_used);
    g_test_add_func("/light-weights/light-comes-from-where-the-map-has-it",
                    the_light_comes_from_where_the_map_has_it);
    g_test_add_func("/light-weights/a-positive-rotation-turns-the-middle-to-camera-left",
                    a_positive_rotation_turns_the_middle_to_camera_left);
    g_test_add_func("/light-weights/a-captured-light-of-an-led-is-made-with-that-led",
                    a_captured_light_of_an_led_is_made_with_that_led);
    g_test_add_func("/light-weights/a-balls-reflectivity-comes-from-who-knows-it-best",
                    a_balls_reflectivity_comes_from_who_knows_it_best);
    g_test_add_func("/light-weights/another-chart-than-the-calibrations-is-refused",
                    another_chart_than_the_calibrations_is_refused);
    g_test_add_func("/light-weights/words-of-the-command-line-are-understood",
                    words_of_the_command_line_are_understood);
    g_test_add_func("/light-weights/a-model-uses-the-spectra-it-is-served",
                    a_model_uses_the_spectra_it_is_served);
    g_test_add_func("/light-weights/every-solve-and-method-finds-the-led",
                    every_solve_and_method_finds_the_led);
    g_test_add_func("/take-document/damaged-ones-are-refused-by-key",
                    damaged_documents_are_refused_by_key);
    return g_test_run();
}
