/* light_weights: environments whose weights are known. */
#include "tests/clients/weights_fixture.h"
#include "tests/daemon/take_fixture.h"

#include <glib.h>
#include <jansson.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

/* The chart's L and P come from the same integrals, so the solve must find its own LED: exactly,
 * but for the float storage of L and of the spectra (2^-24, amplified by the chart's condition). */
static void light_of_an_led_is_made_with_that_led(void)
{
    struct ls_take_document *document = weights_document(true);
    for (int channel = 0; channel < 2; channel++) {
        struct ls_environment_file environment = weights_lit_by(channel);
        struct ls_light_weights weights = weights_solved(document, &environment, false);
        g_assert_cmpint(weights.mode, ==, LIGHTSTAGE_SHARED);
        g_assert_cmpuint(weights.n_names, ==, 2);
        g_assert_cmpstr(weights.names[0], ==, "W");
        g_assert_cmpstr(weights.names[1], ==, "R");
        weights_assert_row(&weights, (uint32_t)channel, document->omega_sr, 2, 1e-4);
        weights_assert_row(&weights, (uint32_t)!channel, document->omega_sr, 0, 1e-4);
        ls_light_weights_finish(&weights);
    }
    ls_take_document_destroy(document);
}

/* Under light of the white LED the camera reads p(W, c): that, times Omega, is the baseline. */
static void tristimulus_weights_are_the_cameras_reading(void)
{
    struct ls_take_document *document = weights_document(true);
    struct ls_environment_file environment = weights_lit_by(0);
    struct ls_light_weights weights = weights_solved(document, &environment, true);
    g_assert_cmpint(weights.mode, ==, LIGHTSTAGE_TRISTIMULUS);
    for (uint32_t c = 0; c < 3; c++)
        weights_assert_row(&weights, c, document->omega_sr,
                           2 * (double)document->calibration->p[0][c], 1e-4);
    ls_light_weights_finish(&weights);
    ls_take_document_destroy(document);
}

/* A map's RGB through M's inverse: M brings it back. */
static void a_maps_tristimulus_weights_come_back_through_m(void)
{
    static const float rgb[3] = {0.8f, 0.5f, 0.3f};
    struct ls_take_document *document = weights_document(true);
    struct ls_environment_file environment = weights_constant_map(rgb[0], rgb[1], rgb[2]);
    struct ls_light_weights weights = weights_solved(document, &environment, true);
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
    struct ls_take_document *document = weights_document(true);
    struct ls_environment_file dim = weights_constant_map(1, 1, 1),
                               bright = weights_constant_map(3, 3, 3);
    struct ls_light_weights a = weights_solved(document, &dim, false),
                            b = weights_solved(document, &bright, false);
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
    struct ls_take_document *document = weights_document(true);
    struct ls_environment_file warm = weights_constant_map(1, 0.5f, 0.2f),
                               cold = weights_constant_map(0.4f, 0.6f, 1);
    struct ls_light_weights a = weights_solved(document, &warm, false),
                            b = weights_solved(document, &cold, false);
    g_assert_cmpfloat((double)a.rows[TAKE_LIGHTS], >, 2 * (double)b.rows[TAKE_LIGHTS]);
    ls_light_weights_finish(&a);
    ls_light_weights_finish(&b);
    ls_take_document_destroy(document);
}

static void without_a_calibration_the_maps_numbers_are_used(void)
{
    struct ls_take_document *document = weights_document(false);
    struct ls_environment_file environment = weights_constant_map(1, 2, 3);
    struct ls_light_weights weights = weights_solved(document, &environment, false);
    struct ls_diag diag = {0};
    g_assert_cmpint(weights.mode, ==, LIGHTSTAGE_TRISTIMULUS);
    g_assert_nonnull(weights.warning);
    for (uint32_t c = 0; c < 3; c++)
        weights_assert_row(&weights, c, document->omega_sr, 1 + c, 1e-5);
    ls_light_weights_finish(&weights);
    environment = weights_lit_by(0);
    const struct ls_light_options spectral = {.model = LIGHTSTAGE_SPHERE};
    g_assert_cmpint(ls_light_weights_make(document, &environment, &spectral, &weights, &diag), ==,
                    LS_ERR_UNSUPPORTED);
    g_assert_nonnull(strstr(diag.text, "RGB map"));
    ls_environment_file_finish(&environment);
    ls_take_document_destroy(document);
}

/* A bright cap about the zenith lights from above only. */
static void the_light_comes_from_where_the_map_has_it(void)
{
    struct ls_take_document *document = weights_document(true);
    struct ls_environment_file map = weights_constant_map(0, 0, 0);
    double above = 0, below = 0;
    for (int i = 0; i < 32 * 4 * 3; i++)
        map.image.pixels[i] = 1; /* v < 1/4: within 45 degrees of up */
    struct ls_light_weights weights = weights_solved(document, &map, true);
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
    struct ls_environment_file map = weights_constant_map(0, 0, 0);
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
    struct ls_take_document *document = weights_document(true);
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
            struct ls_environment_file environment = weights_lit_by(1);
            const struct ls_light_options options = {.model = (enum lightstage_model)model};
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
    g_test_add_func("/light-weights/a-model-uses-the-spectra-it-is-served",
                    a_model_uses_the_spectra_it_is_served);
    g_test_add_func("/take-document/damaged-ones-are-refused-by-key",
                    damaged_documents_are_refused_by_key);
    return g_test_run();
}
