/* The optics' blur against sums written down plainly, in the truth and in what the cameras show. */
#include "core/half.h"
#include "sim/blur.h"
#include "sim/sweep.h"
#include "sim/truth.h"
#include "sim/world.h"

#include <glib.h>
#include <math.h>
#include <string.h>

enum { SIZE = 64, WIDE = 128, LIGHTS = 24, CHANNELS = 8, LIGHT = 13 };

static const double sigma = 0.7;

static struct sim_scene *new_scene(uint32_t size, double blur_px)
{
    struct sim_scene_config config;
    struct ls_diag diag = {{0}};
    struct sim_scene *scene = NULL;
    sim_scene_config_default(&config);
    sim_view_config_default(&config.views[0], size, size);
    config.views[0].sensor_width_mm *= size / (double)SIZE; /* the same photosites, more of them */
    config.views[0].blur_px = blur_px;
    config.n_lights = LIGHTS;
    enum ls_err err = sim_scene_create(&config, &scene, &diag);
    g_assert_cmpstr(diag.text, ==, "");
    g_assert_cmpint(err, ==, LS_OK);
    return scene;
}

static float *field(const struct sim_scene *scene, struct sim_region region)
{
    float *out = g_new(float, (size_t)CHANNELS *region.width *region.height * 3);
    g_assert_cmpint(sim_truth_field(scene, &region, LIGHT, out, NULL), ==, LS_OK);
    return out;
}

/* A Gaussian summed up in two dimensions over all that lies within 3 sigma + 1/2; @in: WIDE x WIDE
 * with @step values a pixel, at (x, y). */
static double gaussian(const float *in, uint32_t step, int x, int y)
{
    int reach = (int)(3 * sigma + 0.5);
    double sum = 0, weights = 0;
    for (int dy = -reach; dy <= reach; dy++)
        for (int dx = -reach; dx <= reach; dx++) {
            double w = exp(-(dx * dx + dy * dy) / (2 * sigma * sigma));
            sum += w * (double)in[(size_t)((y + dy) * WIDE + x + dx) * step];
            weights += w;
        }
    return sum / weights;
}

static void test_energy(void)
{
    enum { SIDE = 40, OUT = 28 };
    static const double sigmas[] = {0, 0.3, 0.7, 1.1, 2};
    float in[SIDE * SIDE], out[SIDE * SIDE];
    const struct sim_planes planes = {in, 1, SIDE, SIDE};
    for (size_t k = 0; k < G_N_ELEMENTS(sigmas); k++) {
        struct sim_blur blur;
        sim_blur_build(sigmas[k], &blur);
        uint32_t side = SIDE - 2 * blur.reach;
        double sum = 0;
        memset(in, 0, sizeof in);
        in[17 * SIDE + 21] = 5000;
        sim_blur_plane(&blur, &planes, 0, out);
        for (uint32_t i = 0; i < side * side; i++)
            sum += (double)out[i];
        g_assert_cmpfloat(fabs(sum / 5000 - 1), <, 1e-5);
        g_assert_cmpfloat(out[(17 - blur.reach) * side + 21 - blur.reach], <=, 5000);
        for (uint32_t i = 0; i < SIDE * SIDE; i++)
            in[i] = 0.37f;
        sim_blur_plane(&blur, &planes, 0, out);
        for (uint32_t i = 0; i < side * side; i++) /* taps are rounded: 1e-6 */
            g_assert_cmpfloat(fabs((double)out[i] / 0.37 - 1), <, 1e-6);
    }
}

static void test_none(void)
{
    enum { SIDE = 150 };
    g_autofree float *in = g_new(float, SIDE *SIDE), *out = g_new(float, SIDE *SIDE);
    const struct sim_planes planes = {in, 1, SIDE, SIDE};
    struct sim_blur blur;
    for (int i = 0; i < SIDE * SIDE; i++)
        in[i] = (float)(i * 7919 % 1009) / 997;
    sim_blur_build(0, &blur);
    sim_blur_plane(&blur, &planes, 0, out);
    g_assert_cmpmem(in, SIDE * SIDE * sizeof *in, out, SIDE * SIDE * sizeof *out);
}

/* The sensor's edges included: what lies beyond is traced. */
static void test_truth(void)
{
    struct sim_scene *sharp = new_scene(WIDE, 0), *soft = new_scene(SIZE, sigma);
    const struct sim_region all = {0, 0, 0, WIDE, WIDE}, sensor = {0, 0, 0, SIZE, SIZE};
    const int margin = (WIDE - SIZE) / 2;
    g_autofree float *before = field(sharp, all), *after = field(soft, sensor);
    g_autofree float *share = g_new(float, WIDE *WIDE), *blurred = g_new(float, SIZE *SIZE);
    g_assert_cmpint(sim_truth_specular(sharp, &all, LIGHT, share, NULL), ==, LS_OK);
    g_assert_cmpint(sim_truth_specular(soft, &sensor, LIGHT, blurred, NULL), ==, LS_OK);
    for (size_t i = 0; i < (size_t)WIDE * WIDE; i++)
        share[i] *= before[3 * i + 1]; /* of white's green */
    double largest = 0;
    uint32_t shiny = 0, changed = 0;
    for (int y = 0; y < SIZE; y++)
        for (int x = 0; x < SIZE; x++) {
            size_t at = (size_t)y * SIZE + (size_t)x;
            for (size_t k = 0; k < CHANNELS * 3; k++) {
                const float *plane = before + k / 3 * WIDE * WIDE * 3 + k % 3;
                double expected = gaussian(plane, 3, x + margin, y + margin);
                double found = (double)after[(k / 3 * SIZE * SIZE + at) * 3 + k % 3];
                double own = (double)plane[((y + margin) * WIDE + x + margin) * 3];
                largest = fmax(largest, fabs(found - expected) / (expected + 1e-9));
                changed += fabs(found - own) > 0.01 * found;
            }
            double all_light = gaussian(before + 1, 3, x + margin, y + margin);
            double part = gaussian(share, 1, x + margin, y + margin);
            if (all_light > 0)
                g_assert_cmpfloat(fabs((double)blurred[at] - part / all_light), <, 1e-5);
            shiny += blurred[at] > 0.5f;
        }
    g_test_message("largest difference %.2g of the value, %u values changed", largest, changed);
    g_assert_cmpfloat(largest, <, 1e-5); /* sums of 25 floats */
    g_assert_cmpuint(changed, >, SIZE * SIZE);
    g_assert_cmpuint(shiny, >, 0);
    sim_scene_destroy(sharp);
    sim_scene_destroy(soft);
}

static void test_crops(void)
{
    static const struct sim_region crops[] = {
        {0, 0, 0, 1, 1}, {0, 63, 63, 1, 1}, {0, 5, 3, 41, 57}, {0, 30, 0, 34, 7}};
    struct sim_scene *scene = new_scene(SIZE, sigma);
    g_autofree float *whole = field(scene, (struct sim_region){0, 0, 0, SIZE, SIZE});
    for (size_t k = 0; k < G_N_ELEMENTS(crops); k++) {
        struct sim_region r = crops[k];
        g_autofree float *part = field(scene, r);
        for (uint32_t row = 0; row < CHANNELS * r.height; row++) {
            uint32_t channel = row / r.height, y = r.y + row % r.height;
            const float *expected = whole + ((channel * SIZE + y) * SIZE + r.x) * 3;
            g_assert_cmpmem(part + (size_t)row * r.width * 3, r.width * 12, expected, r.width * 12);
        }
    }
    sim_scene_destroy(scene);
}

/* What cameras show, of one LED and of several, is the truth, to the rounding of halves. */
static void test_shown(void)
{
    struct sim_scene *scene = new_scene(SIZE, sigma);
    struct sim_led leds[3] = {{LIGHT, 0, 0.5f}, {LIGHT, 3, 0.25f}, {LIGHT, 5, 1}};
    const struct sim_condition conditions[] = {{0, 1, leds}, {0, 3, leds}};
    g_assert_cmpint(sim_scene_commit(scene, conditions, 2, NULL, NULL, NULL), ==, LS_OK);
    g_autofree float *truth = field(scene, (struct sim_region){0, 0, 0, SIZE, SIZE});
    for (uint32_t p = 0; p < 2; p++) {
        float shown[SIZE * SIZE];
        ls_half_to_floats(scene->program[p]->half[0], shown, SIZE * SIZE);
        for (uint32_t i = 0; i < SIZE * SIZE; i++) {
            uint32_t colour = (uint32_t)ls_cfa_channel(LS_CFA_RGGB, i % SIZE, i / SIZE),
                     n = 2 * p + 1;
            double expected = 0;
            for (uint32_t k = 0; k < n; k++)
                expected += (double)sim_world_weight(scene, &leds[k], n) *
                            (double)truth[(leds[k].channel * SIZE * SIZE + i) * 3 + colour];
            expected = fmin(expected * (double)sim_picture_scale, (double)LS_HALF_MAX);
            g_assert_cmpfloat(fabs((double)shown[i] - expected), <=, 1e-3 * expected + 1e-6);
        }
    }
    sim_scene_destroy(scene);
}

/* With the blur's reach around it, each sample's rectangle sees one surface. */
static void test_samples(void)
{
    enum { LARGE = 320 };
    struct sim_scene_config config;
    struct sim_scene *scene = NULL;
    struct sim_sample samples[SIM_SAMPLES];
    sim_scene_config_default(&config);
    sim_view_config_default(&config.views[0], LARGE, LARGE);
    config.views[0].blur_px = 1;
    config.n_lights = 4;
    g_assert_cmpint(sim_scene_create(&config, &scene, NULL), ==, LS_OK);
    g_assert_cmpint(sim_truth_samples(scene, 0, samples, NULL), ==, LS_OK);
    const struct sim_view *view = &scene->view[0];
    int reach = (int)view->blur.reach;
    g_assert_cmpint(reach, ==, 3);
    for (int k = 0; k < SIM_SAMPLES; k++) {
        const struct sim_sample *s = &samples[k];
        uint16_t surface = sim_view_pixel(view, (int32_t)s->x, (int32_t)s->y)->surface;
        g_assert_cmpuint(surface, !=, SIM_NO_SURFACE);
        for (int y = -reach; y < (int)s->height + reach; y++)
            for (int x = -reach; x < (int)s->width + reach; x++)
                g_assert_cmpuint(sim_view_pixel(view, (int)s->x + x, (int)s->y + y)->surface, ==,
                                 surface);
    }
    sim_scene_destroy(scene);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/blur/keeps-a-points-energy-and-a-constant", test_energy);
    g_test_add_func("/blur/of-nothing-changes-no-bit", test_none);
    g_test_add_func("/blur/truth-is-the-sharp-truth-under-a-gaussian", test_truth);
    g_test_add_func("/blur/a-region-has-the-bits-of-the-whole", test_crops);
    g_test_add_func("/blur/cameras-show-the-truth", test_shown);
    g_test_add_func("/blur/samples-stay-clear-of-their-edges", test_samples);
    return g_test_run();
}
