#include "tests/clients/weights_fixture.h"

#include "tests/daemon/take_fixture.h"

#include <glib.h>
#include <string.h>

struct ls_take_document *weights_document(bool calibrated)
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

struct ls_environment_file weights_lit_by(int channel)
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

struct ls_environment_file weights_constant_map(float r, float g, float b)
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

struct ls_light_weights weights_solved(const struct ls_take_document *document,
                                       struct ls_environment_file *environment, bool tristimulus)
{
    struct ls_light_weights weights;
    struct ls_diag diag = {0};
    const struct ls_light_options options = {.model = LIGHTSTAGE_SPHERE,
                                             .solve = tristimulus ? LS_LIGHT_TRISTIMULUS
                                                                  : LS_LIGHT_SPECTRAL};
    enum ls_err err = ls_light_weights_make(document, environment, &options, &weights, &diag);
    g_assert_cmpstr(diag.text, ==, "");
    g_assert_cmpint(err, ==, LS_OK);
    ls_environment_file_finish(environment);
    return weights;
}

void weights_assert_row(const struct ls_light_weights *weights, uint32_t row, const double *omega,
                        double radiance, double tolerance)
{
    for (uint32_t i = 0; i < weights->n_lights; i++)
        g_assert_cmpfloat_with_epsilon((double)weights->rows[(size_t)row * weights->n_lights + i],
                                       radiance * omega[i], tolerance);
}
