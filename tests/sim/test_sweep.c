/* A sweep over lights against the questions asked one by one. */
#include "core/pixel.h"
#include "sim/sweep.h"

#include <glib.h>
#include <string.h>

enum { SIZE = 64 };

static struct sim_scene *new_scene(const char *name, double blur_px)
{
    struct sim_scene_config config;
    struct ls_diag diag = {{0}};
    struct sim_scene *scene = NULL;
    sim_scene_config_default(&config);
    sim_view_config_default(&config.views[0], SIZE, SIZE);
    g_strlcpy(config.scene, name, sizeof config.scene);
    config.views[0].blur_px = blur_px;
    config.n_lights = 24;
    config.threads = 1;
    enum ls_err err = sim_scene_create(&config, &scene, &diag);
    g_assert_cmpstr(diag.text, ==, "");
    g_assert_cmpint(err, ==, LS_OK);
    return scene;
}

/* Channels out of order, a region at odd offsets with tiles cut on all sides: the same bits. */
static void assert_same_bits(double blur_px)
{
    static const uint32_t channels[] = {3, 0, 5};
    const struct sim_region region = {0, 5, 3, 41, 57};
    const size_t n = (size_t)region.width * region.height;
    struct sim_scene *scene = new_scene("stilllife", blur_px);
    struct sim_sweep *sweep = NULL;
    struct sim_sweep_region *part = NULL;
    g_assert_cmpint(sim_sweep_create(scene, 0, channels, 3, &sweep, NULL), ==, LS_OK);
    g_assert_cmpint(sim_sweep_open(sweep, &region, &part, NULL), ==, LS_OK);
    float *mosaic = g_new(float, 3 * n), *specular = g_new(float, n), *share = g_new(float, n);
    float *field = g_new(float, 8 * 3 * n);
    size_t lit = 0, shiny = 0;
    for (uint32_t light = 0; light < 24; light++) {
        sim_sweep_light(part, light, mosaic, specular);
        g_assert_cmpint(sim_truth_field(scene, &region, light, field, NULL), ==, LS_OK);
        g_assert_cmpint(sim_truth_specular(scene, &region, light, share, NULL), ==, LS_OK);
        for (size_t j = 0; j < n; j++) {
            uint32_t x = region.x + (uint32_t)(j % region.width);
            uint32_t y = region.y + (uint32_t)(j / region.width);
            uint32_t colour = ls_cfa_channel(LS_CFA_RGGB, x, y);
            for (uint32_t k = 0; k < 3; k++)
                g_assert_cmpfloat(mosaic[k * n + j], ==, field[(channels[k] * n + j) * 3 + colour]);
            g_assert_cmpfloat(specular[j], ==, share[j]);
            lit += mosaic[n + j] > 0;
            shiny += specular[j] > 0.5f;
        }
    }
    g_assert_cmpuint(lit, >, n);
    g_assert_cmpuint(shiny, >, 0);
    g_free(mosaic);
    g_free(specular);
    g_free(share);
    g_free(field);
    sim_sweep_close(part);
    sim_sweep_destroy(sweep);
    sim_scene_destroy(scene);
}

static void test_same_bits(void)
{
    assert_same_bits(0);
    assert_same_bits(0.7);
}

static void test_refusals(void)
{
    static const uint32_t channel = 8;
    const struct sim_region outside = {0, 60, 0, 5, 1};
    struct sim_scene *scene = new_scene("stilllife", 0), *stamp = new_scene("stamp", 0);
    struct sim_sweep *sweep = NULL;
    struct sim_sweep_region *part = NULL;
    struct ls_diag diag = {{0}};
    g_assert_cmpint(sim_sweep_create(scene, 1, NULL, 0, &sweep, &diag), ==, LS_ERR_INVALID);
    g_assert_nonnull(strstr(diag.text, "camera 1"));
    g_assert_cmpint(sim_sweep_create(scene, 0, &channel, 1, &sweep, &diag), ==, LS_ERR_INVALID);
    g_assert_nonnull(strstr(diag.text, "channel 8"));
    g_assert_cmpint(sim_sweep_create(stamp, 0, NULL, 0, &sweep, &diag), ==, LS_ERR_UNSUPPORTED);
    g_assert_cmpint(sim_sweep_create(scene, 0, NULL, 0, &sweep, &diag), ==, LS_OK);
    g_assert_cmpint(sim_sweep_open(sweep, &outside, &part, &diag), ==, LS_ERR_INVALID);
    sim_sweep_destroy(sweep);
    sim_scene_destroy(stamp);
    sim_scene_destroy(scene);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/sweep/equals-the-field-and-the-specular-share-bit-for-bit", test_same_bits);
    g_test_add_func("/sweep/refuses-what-it-cannot-answer", test_refusals);
    return g_test_run();
}
