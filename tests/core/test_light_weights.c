#include "core/light_weights.h"

#include <glib.h>
#include <math.h>
#include <string.h>

enum { PATCHES = 12, SPECTRA = 6, LIGHTS = 6 };

static const float directions[LIGHTS][3] = {{1, 0, 0},  {-1, 0, 0}, {0, 1, 0},
                                            {0, -1, 0}, {0, 0, 1},  {0, 0, -1}};

/** A stage: Gaussian LEDs (the first broad), a Gaussian camera, a chart of smooth reflectances. */
struct stage {
    struct ls_spectrum led[SPECTRA], camera[3], reflectance[PATCHES];
    double l[PATCHES * 3 * SPECTRA];
    struct ls_stage_chart chart;
};

static void bump(struct ls_spectrum *s, double nm, double width, double height)
{
    for (int i = 0; i < LS_SPECTRUM_N; i++)
        s->v[i] = height * exp(-0.5 * pow((380 + 5 * i - nm) / width, 2));
}

static void stage_init(struct stage *stage, size_t n_channels)
{
    static const double led_nm[SPECTRA] = {550, 630, 595, 525, 500, 455};
    static const double camera_nm[3] = {600, 535, 460};
    memset(stage, 0, sizeof *stage);
    for (int s = 0; s < SPECTRA; s++)
        bump(&stage->led[s], led_nm[s], s ? 12 : 70, 0.01);
    for (int c = 0; c < 3; c++)
        bump(&stage->camera[c], n_channels == 3 ? camera_nm[c] : 550, n_channels == 3 ? 35 : 90, 1);
    for (int p = 0; p < PATCHES; p++) {
        bump(&stage->reflectance[p], 400 + 30 * p, 60, 0.8);
        for (int i = 0; p == 0 && i < LS_SPECTRUM_N; i++)
            stage->reflectance[p].v[i] = 0.9;
    }
    for (size_t p = 0; p < PATCHES; p++)
        for (size_t c = 0; c < n_channels; c++)
            for (size_t s = 0; s < SPECTRA; s++)
                stage->l[(p * n_channels + c) * SPECTRA + s] =
                    ls_spectrum_dot3(&stage->led[s], &stage->reflectance[p], &stage->camera[c]);
    stage->chart = (struct ls_stage_chart){
        .lighting = {.n_patches = PATCHES, .n_channels = n_channels, .n_spectra = SPECTRA,
                     .chart = stage->l},
        .reflectances = stage->reflectance,
        .sensitivities = stage->camera};
    ls_lighting_defaults(&stage->chart.lighting);
}

static void test_light_of_an_led_s_spectrum_is_that_led(void)
{
    struct stage stage;
    struct ls_lobe lobe[2] = {{.direction = {1, 0, 0}, .sharpness = 200, .radiance = 3},
                              {.direction = {0, 0, 1}, .sharpness = 200, .radiance = 1}};
    struct ls_lobes lobes = {.n = 2, .item = lobe};
    struct ls_environment environment = {.lobes = &lobes, .directions = directions,
                                         .n_lights = LIGHTS};
    struct ls_light_weights_report report;
    double w[LIGHTS * SPECTRA];
    stage_init(&stage, 3);
    lobe[0].spectrum = stage.led[2];
    lobe[1].spectrum = stage.led[0];
    g_assert_cmpint(ls_light_weights(&environment, &stage.chart, w, &report, NULL), ==, LS_OK);
    double energy = 2 * M_PI / 200; /* radiance x sr of a lobe, exp(-400) left out */
    for (int i = 0; i < LIGHTS; i++)
        for (int s = 0; s < SPECTRA; s++) {
            double expected = i == 0 && s == 2 ? 3 * energy : i == 4 && s == 0 ? energy : 0;
            g_assert_cmpfloat_with_epsilon(w[i * SPECTRA + s], expected, 1e-9);
        }
    g_assert_cmpuint(report.rank, ==, SPECTRA);
    g_assert_cmpfloat(report.worst_relative, <, 1e-9);
}

static void fill(float *rgb, size_t n, float r, float g, float b)
{
    for (size_t k = 0; k < n; k++)
        rgb[3 * k] = r, rgb[3 * k + 1] = g, rgb[3 * k + 2] = b;
}

/* a white map of radiance 1 reads 1 in the camera's green from all around */
static void test_radiance_one_of_a_map_reads_one_in_green(void)
{
    struct stage stage;
    float rgb[3 * 8 * 4];
    struct ls_map map = {.rgb = rgb, .width = 8, .height = 4};
    struct ls_environment environment = {.map = &map, .directions = directions,
                                         .n_lights = LIGHTS};
    struct ls_light_weights_report report;
    double w[LIGHTS * 3], green = 0;
    fill(rgb, 32, 1, 1, 1);
    stage_init(&stage, 3);
    g_assert_cmpint(
        ls_light_weights_tristimulus(&environment, stage.camera, w, &report, NULL), ==, LS_OK);
    for (int i = 0; i < LIGHTS; i++)
        green += w[3 * i + 1];
    /* D65 reads 1; the smoothest spectrum of the same colour is not D65, whose bumps this green of
     * 35 nm averages: 2 % */
    g_assert_cmpfloat_with_epsilon(green / (4 * M_PI), 1, 0.02);
    g_assert_cmpuint(report.unreachable, ==, 0);
}

static void test_a_camera_raw_map_is_met_in_the_camera(void)
{
    struct stage stage;
    float rgb[3 * 8 * 4];
    struct ls_map map = {.rgb = rgb, .width = 8, .height = 4, .space = LS_MAP_CAMERA_RAW};
    struct ls_environment environment = {.map = &map, .directions = directions,
                                         .n_lights = LIGHTS};
    struct ls_spectrum spectra[LIGHTS];
    double w[LIGHTS * 3], strengths[LIGHTS * SPECTRA];
    fill(rgb, 32, 0.8f, 1, 0.5f);
    stage_init(&stage, 3);
    g_assert_cmpint(ls_light_spectra(&environment, stage.camera, 3, spectra, NULL, NULL), ==,
                    LS_OK);
    g_assert_cmpint(ls_light_weights_tristimulus(&environment, stage.camera, w, NULL, NULL), ==,
                    LS_OK);
    for (int i = 0; i < LIGHTS; i++)
        for (int c = 0; c < 3; c++)
            /* the smoothest spectrum's 1e-6 */
            g_assert_cmpfloat_with_epsilon(ls_spectrum_dot(&spectra[i], &stage.camera[c]),
                                           w[3 * i + c], 1e-5);
    g_assert_cmpint(ls_light_weights(&environment, &stage.chart, strengths, NULL, NULL), ==, LS_OK);
    for (int i = 0; i < LIGHTS; i++)
        for (int c = 0; c < 3; c++) {
            double white = 0;
            for (int s = 0; s < SPECTRA; s++)
                white += strengths[i * SPECTRA + s] * stage.l[c * SPECTRA + s];
            /* the LEDs' white patch against 0.9 of the map: 12 patches compromise within 5 % */
            g_assert_cmpfloat_with_epsilon(white / (0.9 * w[3 * i + c]), 1, 0.05);
        }
    g_assert_cmpint(ls_light_weights(&(struct ls_environment){0}, &stage.chart, strengths, NULL,
                                     NULL),
                    ==, LS_ERR_INVALID);
}

static void test_a_mono_camera_gets_three_solutions(void)
{
    struct stage stage;
    float rgb[3 * 8 * 4];
    struct ls_map map = {.rgb = rgb, .width = 8, .height = 4};
    struct ls_environment environment = {.map = &map, .directions = directions,
                                         .n_lights = LIGHTS};
    struct ls_light_weights_report report;
    double w[LIGHTS * 3 * SPECTRA];
    fill(rgb, 32, 0.9f, 0.7f, 0.4f);
    stage_init(&stage, 1);
    g_assert_cmpint(ls_light_weights(&environment, &stage.chart, w, &report, NULL), ==, LS_OK);
    for (int i = 0; i < LIGHTS; i++)
        for (int t = 0; t < 3; t++) {
            double white = 0, expected = 0.9 * (double)rgb[t] * 4 * M_PI / LIGHTS;
            for (int s = 0; s < SPECTRA; s++)
                white += w[(i * 3 + t) * SPECTRA + s] * stage.l[s];
            /* Tikhonov 1e-3 and six LEDs: the white patch within 5 % */
            g_assert_cmpfloat_with_epsilon(white / expected, 1, 0.05);
        }
    map.space = LS_MAP_CAMERA_RAW;
    g_assert_cmpint(ls_light_weights(&environment, &stage.chart, w, &report, NULL), ==,
                    LS_ERR_UNSUPPORTED);
}

static void test_dark_cells_get_exactly_nothing(void)
{
    struct stage stage;
    float rgb[3 * 8 * 16] = {0};
    struct ls_map map = {.rgb = rgb, .width = 8, .height = 16};
    struct ls_environment environment = {.map = &map, .directions = directions,
                                         .n_lights = LIGHTS};
    double w[LIGHTS * SPECTRA];
    fill(rgb, 8, 1, 1, 1); /* the zenith's row */
    stage_init(&stage, 3);
    g_assert_cmpint(ls_light_weights(&environment, &stage.chart, w, NULL, NULL), ==, LS_OK);
    for (int s = 0; s < SPECTRA; s++)
        for (int i = 0; i < LIGHTS; i++)
            if (i != 2)
                g_assert_cmpfloat(w[i * SPECTRA + s], ==, 0);
    double up = 0;
    for (int s = 0; s < SPECTRA; s++)
        up += w[2 * SPECTRA + s];
    g_assert_cmpfloat(up, >, 0);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/light-weights/light-of-an-led-s-spectrum-is-that-led",
                    test_light_of_an_led_s_spectrum_is_that_led);
    g_test_add_func("/light-weights/radiance-one-of-a-map-reads-one-in-green",
                    test_radiance_one_of_a_map_reads_one_in_green);
    g_test_add_func("/light-weights/a-camera-raw-map-is-met-in-the-camera",
                    test_a_camera_raw_map_is_met_in_the_camera);
    g_test_add_func("/light-weights/a-mono-camera-gets-three-solutions",
                    test_a_mono_camera_gets_three_solutions);
    g_test_add_func("/light-weights/dark-cells-get-exactly-nothing",
                    test_dark_cells_get_exactly_nothing);
    return g_test_run();
}
