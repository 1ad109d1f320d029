/* The simulated sensor against its own noise model, and stamps through every format. */
#include "core/pixel.h"
#include "sim/sensor.h"
#include "sim/stamp.h"

#include <glib.h>
#include <math.h>
#include <string.h>

enum { SIDE = 128, PIXELS = SIDE * SIDE };

static struct sim_view_config perfect(void)
{
    struct sim_view_config config;
    sim_view_config_default(&config, SIDE, SIDE);
    config.prnu = 0;
    config.hot_per_mpixel = 0;
    return config;
}

static void statistics(const struct sim_sensor *s, double e, double t, double *mean,
                       double *variance)
{
    float *signal = g_new(float, SIDE);
    uint16_t *dn = g_new(uint16_t, SIDE);
    double sum = 0, square = 0;
    struct sim_readout r = {
        .key = sim_sensor_key(1, 0, 5), .exposure_s = t, .gain = 1, .max_dn = 4095};
    for (int x = 0; x < SIDE; x++)
        signal[x] = (float)e;
    for (uint32_t y = 0; y < SIDE; y++) {
        sim_sensor_row(s, &r, 0, y, SIDE, signal, dn);
        for (int x = 0; x < SIDE; x++) {
            sum += dn[x];
            square += (double)dn[x] * dn[x];
        }
    }
    *mean = sum / PIXELS;
    *variance = square / PIXELS - *mean * *mean;
    g_free(signal);
    g_free(dn);
}

static void test_noise(void)
{
    struct sim_view_config config = perfect();
    struct sim_sensor s;
    g_assert_cmpint(sim_sensor_build(&config, 7, &s, NULL), ==, LS_OK);
    const double signals[] = {0, 50, 1000, 5000, 9000};
    for (size_t i = 0; i < G_N_ELEMENTS(signals); i++) {
        double mean, variance, t = 0.5, to_dn = 4095 / config.full_well_e;
        double e = signals[i] + config.dark_current_e_s * t;
        double expected =
            (e + config.read_noise_e * config.read_noise_e) * to_dn * to_dn + 1 / 12.0;
        statistics(&s, signals[i], t, &mean, &variance);
        /* four standard errors of a mean and of a variance of 16384 */
        g_assert_cmpfloat(fabs(mean - 64 - e * to_dn), <, 4 * sqrt(expected / PIXELS));
        g_assert_cmpfloat(fabs(variance / expected - 1), <, 4 * sqrt(2.0 / PIXELS));
    }
    sim_sensor_finish(&s);
}

/* Neighbours in space and in sequence share nothing: correlation within four standard errors. */
static void test_independence(void)
{
    struct sim_view_config config = perfect();
    struct sim_sensor s;
    g_assert_cmpint(sim_sensor_build(&config, 7, &s, NULL), ==, LS_OK);
    float signal[SIDE];
    uint16_t a[SIDE], b[SIDE];
    double next = 0, frame = 0, square = 0, mean = 64 + 2000 * 4095 / config.full_well_e;
    for (int x = 0; x < SIDE; x++)
        signal[x] = 2000;
    for (uint32_t y = 0; y < SIDE; y++) {
        struct sim_readout r = {.key = sim_sensor_key(1, 0, 1), .gain = 1, .max_dn = 4095};
        sim_sensor_row(&s, &r, 0, y, SIDE, signal, a);
        r.key = sim_sensor_key(1, 0, 2);
        sim_sensor_row(&s, &r, 0, y, SIDE, signal, b);
        for (int x = 0; x + 1 < SIDE; x++) {
            square += (a[x] - mean) * (a[x] - mean);
            next += (a[x] - mean) * (a[x + 1] - mean);
            frame += (a[x] - mean) * (b[x] - mean);
        }
    }
    g_assert_cmpfloat(fabs(next / square), <, 4.0 / SIDE);
    g_assert_cmpfloat(fabs(frame / square), <, 4.0 / SIDE);
    sim_sensor_finish(&s);
}

/* A row read in pieces at odd offsets is the row. */
static void test_regions(void)
{
    struct sim_view_config config;
    sim_view_config_default(&config, SIDE, SIDE);
    struct sim_sensor s;
    g_assert_cmpint(sim_sensor_build(&config, 3, &s, NULL), ==, LS_OK);
    float signal[SIDE];
    uint16_t row[SIDE], part[SIDE];
    struct sim_readout r = {.key = 99, .exposure_s = 0.001, .gain = 1, .max_dn = 255};
    for (int x = 0; x < SIDE; x++)
        signal[x] = 30.0f * (float)x;
    sim_sensor_row(&s, &r, 0, 17, SIDE, signal, row);
    for (uint32_t x = 0; x < 12; x++) {
        sim_sensor_row(&s, &r, x, 17, SIDE - 2 * x, signal + x, part);
        g_assert_cmpint(memcmp(part, row + x, (SIDE - 2 * x) * sizeof *row), ==, 0);
    }
    sim_sensor_finish(&s);
}

static void test_unequal_pixels(void)
{
    struct sim_view_config config;
    sim_view_config_default(&config, 1024, 1024);
    struct sim_sensor s;
    g_assert_cmpint(sim_sensor_build(&config, 3, &s, NULL), ==, LS_OK);
    double sum = 0, square = 0, n = 1024.0 * 1024;
    for (size_t i = 0; i < (size_t)n; i++) {
        sum += s.gain[i] - 1;
        square += (s.gain[i] - 1) * (s.gain[i] - 1);
    }
    g_assert_cmpfloat(fabs(sum / n), <, 4 * 0.005 / 1024);
    g_assert_cmpfloat(fabs(sqrt(square / n) / 0.005 - 1), <, 4 / sqrt(2 * n));
    g_assert_cmpuint(s.n_hot, ==, 21); /* 20 per million */
    for (uint32_t i = 0; i < s.n_hot; i++)
        g_assert_cmpfloat(s.dark_e_s[(size_t)s.hot[i][1] * 1024 + s.hot[i][0]], >, 1000);
    sim_sensor_finish(&s);
}

static struct sim_scene *stamping(const char *cfa, uint32_t width, uint32_t height,
                                  uint32_t stamp_frames)
{
    struct sim_scene_config config;
    struct sim_scene *scene = NULL;
    sim_scene_config_default(&config);
    sim_view_config_default(&config.views[0], width, height);
    g_strlcpy(config.scene, "stamp", sizeof config.scene);
    g_strlcpy(config.views[0].cfa, cfa, sizeof config.views[0].cfa);
    config.views[0].read_noise_e = 100; /* twenty times the usual */
    config.n_lights = 12;
    config.stamp_frames = stamp_frames;
    struct ls_diag diag = {{0}};
    g_assert_cmpint(sim_scene_create(&config, &scene, &diag), ==, LS_OK);
    return scene;
}

static void stamp_in(struct sim_scene *scene, const struct ls_pixel_format *pixel, uint32_t width,
                     uint32_t height)
{
    struct sim_raw_format f = {.width = width, .height = height, .pixel_format = pixel->code};
    struct sim_exposure e = {
        .condition = 1, .step = 70000, .exposure_us = 513.7, .lit_us = 500, .sequence = 123456};
    size_t bytes = sim_raw_bytes(&f);
    uint8_t *raw = g_malloc(bytes);
    uint16_t *dn = g_new(uint16_t, width * height);
    struct sim_stamp found;
    struct ls_diag diag = {{0}};
    g_assert_cmpint(sim_scene_expose(scene, &e, &f, raw, bytes, &diag), ==, LS_OK);
    ls_pixel_unpack(pixel, raw, 0, (size_t)width * height, dn);
    g_assert_cmpint(sim_stamp_read(dn, width, height, ls_pixel_max_dn(pixel), &found, &diag), ==,
                    LS_OK);
    g_assert_cmpuint(found.condition, ==, 1);
    g_assert_cmpuint(found.kind, ==, LS_WIRE_CONDITION_ONE);
    g_assert_cmpuint(found.light, ==, 11);
    g_assert_cmpuint(found.channel, ==, 5);
    g_assert_cmpuint(found.n_leds, ==, 1);
    g_assert_cmpuint(found.step, ==, 70000);
    g_assert_cmpuint(found.exposure_ns_10, ==, 51370);
    g_assert_cmpuint(found.lit_ns_10, ==, 50000);
    g_assert_cmpuint(found.sequence, ==, 123456);
    g_free(raw);
    g_free(dn);
}

static void test_stamps(void)
{
    static const struct {
        enum ls_cfa cfa;
        const char *name;
    } filters[] = {{LS_CFA_NONE, "mono"},
                   {LS_CFA_RGGB, "RG"},
                   {LS_CFA_GRBG, "GR"},
                   {LS_CFA_GBRG, "GB"},
                   {LS_CFA_BGGR, "BG"}};
    const struct ls_pixel_format *pixel;
    struct sim_led led = {11, 5, 1};
    struct sim_condition program[] = {{LS_WIRE_CONDITION_DARK, 0, NULL},
                                      {LS_WIRE_CONDITION_ONE, 1, &led}};
    uint32_t tried = 0;
    for (size_t k = 0; k < 2 * G_N_ELEMENTS(filters); k++) {
        const uint32_t stamp_frames = k % 2 * 3; /* read out each; cut out of three */
        struct sim_scene *scene = stamping(filters[k / 2].name, 100, 84, stamp_frames);
        g_assert_cmpint(sim_scene_commit(scene, program, 2, NULL, NULL, NULL), ==, LS_OK);
        for (size_t i = 0; (pixel = ls_pixel_at(i)); i++)
            if (pixel->cfa == filters[k / 2].cfa) {
                stamp_in(scene, pixel, 100, 84);
                tried++;
            }
        sim_scene_destroy(scene);
    }
    g_assert_cmpuint(tried, >=, 30);
}

/* A frame of 512 x 512, always of the same exposure. */
static uint16_t *stamped(uint32_t stamp_frames)
{
    struct sim_scene *scene = stamping("mono", 512, 512, stamp_frames);
    struct sim_raw_format f = {
        .width = 512, .height = 512, .pixel_format = ls_pixel_by_name("Mono16")->code};
    struct sim_exposure e = {.condition = UINT32_MAX, .exposure_us = 400};
    uint16_t *raw = g_new(uint16_t, 512 * 512);
    struct ls_diag diag = {{0}};
    g_assert_cmpint(sim_scene_expose(scene, &e, &f, raw, sim_raw_bytes(&f), &diag), ==, LS_OK);
    sim_scene_destroy(scene);
    return raw;
}

static void test_cut_stamps(void)
{
    enum { N = 512 * 512 };
    uint16_t *read = stamped(0), *cut = stamped(2);
    for (int light = 0; light < 2; light++) {
        double sum[2] = {0}, square[2] = {0}, n = 0;
        for (uint32_t i = 0; i < N; i++) {
            if ((read[i] > 0.45 * 65535) != light || (cut[i] > 0.45 * 65535) != light)
                continue;
            double v[2] = {read[i], cut[i]};
            for (int k = 0; k < 2; k++) {
                sum[k] += v[k];
                square[k] += v[k] * v[k];
            }
            n++;
        }
        double mean[2] = {sum[0] / n, sum[1] / n};
        double variance[2] = {square[0] / n - mean[0] * mean[0], square[1] / n - mean[1] * mean[1]};
        /* five standard errors of a difference of means, and of a ratio of variances */
        g_assert_cmpfloat(fabs(mean[0] - mean[1]), <, 5 * sqrt(2 * variance[0] / n));
        g_assert_cmpfloat(fabs(variance[1] / variance[0] - 1), <, 5 * sqrt(4 / n));
    }
    g_free(read);
    g_free(cut);
}

static void test_no_stamp(void)
{
    uint16_t *dn = g_new0(uint16_t, 64 * 64);
    struct sim_stamp found;
    struct ls_diag diag = {{0}};
    g_assert_cmpint(sim_stamp_read(dn, 64, 64, 4095, &found, &diag), ==, LS_ERR_MISMATCH);
    g_assert_cmpint(sim_stamp_read(dn, 31, 64, 4095, &found, &diag), ==, LS_ERR_INVALID);
    g_free(dn);
}

static void test_refusals(void)
{
    struct sim_scene *scene = stamping("RG", 64, 64, 0);
    struct sim_exposure e = {.condition = UINT32_MAX};
    struct ls_diag diag = {{0}};
    uint8_t raw[64 * 64 * 2];
    struct sim_raw_format wrong_order = {.width = 32,
                                         .height = 32,
                                         .offset_x = 1,
                                         .pixel_format = ls_pixel_by_name("BayerRG8")->code};
    g_assert_cmpint(sim_scene_expose(scene, &e, &wrong_order, raw, sizeof raw, &diag), ==,
                    LS_ERR_INVALID);
    wrong_order.pixel_format = ls_pixel_by_name("BayerGR8")->code;
    g_assert_cmpint(sim_scene_expose(scene, &e, &wrong_order, raw, sizeof raw, &diag), ==, LS_OK);
    wrong_order.offset_x = 40;
    g_assert_cmpint(sim_scene_expose(scene, &e, &wrong_order, raw, sizeof raw, &diag), ==,
                    LS_ERR_INVALID);
    wrong_order.offset_x = 1;
    g_assert_cmpint(sim_scene_expose(scene, &e, &wrong_order, raw, 10, &diag), ==, LS_ERR_INVALID);
    sim_scene_destroy(scene);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/sensor/mean-and-variance-follow-the-model", test_noise);
    g_test_add_func("/sensor/pixels-and-frames-are-independent", test_independence);
    g_test_add_func("/sensor/a-region-is-the-same-pixels", test_regions);
    g_test_add_func("/sensor/gains-spread-and-hot-pixels-glow", test_unequal_pixels);
    g_test_add_func("/stamp/is-legible-through-noise-in-every-format", test_stamps);
    g_test_add_func("/stamp/cut-out-of-frames-it-has-the-sensors-levels-and-noise",
                    test_cut_stamps);
    g_test_add_func("/stamp/its-absence-is-noticed", test_no_stamp);
    g_test_add_func("/scene/formats-and-regions-that-do-not-fit-are-refused", test_refusals);
    return g_test_run();
}
