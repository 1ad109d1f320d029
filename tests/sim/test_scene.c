/* The simulated world against closed forms. */
#include "sim/truth.h"
#include "sim/world.h"

#include "core/half.h"

#include <glib.h>
#include <math.h>
#include <string.h>

static struct sim_scene *new_scene(const char *name, uint32_t size)
{
    struct sim_scene_config config;
    struct ls_diag diag = {{0}};
    struct sim_scene *scene = NULL;
    sim_scene_config_default(&config);
    sim_view_config_default(&config.views[0], size, size);
    g_strlcpy(config.scene, name, sizeof config.scene);
    config.threads = 1;
    enum ls_err err = sim_scene_create(&config, &scene, &diag);
    g_assert_cmpstr(diag.text, ==, "");
    g_assert_cmpint(err, ==, LS_OK);
    return scene;
}

static struct sim_region whole(const struct sim_scene *scene)
{
    return (struct sim_region){0, 0, 0, scene->view[0].width, scene->view[0].height};
}

static float *weights_for(const struct sim_scene *scene)
{
    return g_new0(float, scene->config.n_channels * scene->geometry.n_lights);
}

static float *relight(const struct sim_scene *scene, const float *weights)
{
    struct sim_region region = whole(scene);
    float *out = g_new(float, region.width *region.height * 3);
    g_assert_cmpint(sim_truth_relight(scene, &region, weights, 1, out, NULL), ==, LS_OK);
    return out;
}

/* Constant radiance 1 from everywhere through W: a 33 % sphere reads 0.33 p. The dome has no light
 * below -70 degrees; its cells reach down to the pole, so no direction is missing. */
static void test_furnace(void)
{
    struct sim_scene *scene = new_scene("grey", 64);
    float *weights = weights_for(scene);
    for (uint32_t i = 0; i < scene->geometry.n_lights; i++)
        weights[i] = scene->geometry.omega_sr[i];
    float *out = relight(scene, weights);
    double sum[3] = {0};
    uint32_t n = 0;
    for (uint32_t k = 0; k < 64 * 64; k++) {
        const struct sim_pixel *pixel = &scene->view[0].pixels[k];
        if (pixel->surface == SIM_NO_SURFACE || pixel->normal.y < -0.3f)
            continue; /* the hole is in sight of points that look down */
        n++;
        for (int c = 0; c < 3; c++) {
            double p = sim_response_of(&scene->response[0], 0, (uint32_t)c, SIM_MAT_FLAT);
            double found = out[3 * k + (uint32_t)c] / (0.33 * p);
            sum[c] += found;
            /* a point 0.1 m off the centre sees the 346 discrete lights unevenly */
            g_assert_cmpfloat(fabs(found - 1), <, 0.03);
        }
    }
    g_assert_cmpuint(n, >, 150);
    for (int c = 0; c < 3; c++)
        g_assert_cmpfloat(fabs(sum[c] / n - 1), <, 0.01);
    g_free(weights);
    g_free(out);
    sim_scene_destroy(scene);
}

/* R = 0.33 / pi r^2 cos(emission) cos(incidence) / d^2 p at every pixel, in double. */
static void test_lambert(void)
{
    struct sim_scene *scene = new_scene("grey", 48);
    struct sim_region region = whole(scene);
    uint32_t n = 48 * 48, lit = 0;
    float *out = g_new(float, (size_t)scene->config.n_channels *n * 3);
    for (uint32_t light = 5; light < 346; light += 37) {
        g_assert_cmpint(sim_truth_field(scene, &region, light, out, NULL), ==, LS_OK);
        const float *l = scene->geometry.position_m[light];
        for (uint32_t k = 0; k < n; k++) {
            const struct sim_pixel *pixel = &scene->view[0].pixels[k];
            if (pixel->surface == SIM_NO_SURFACE)
                continue;
            double to[3] = {l[0] - pixel->x.x, l[1] - pixel->x.y, l[2] - pixel->x.z};
            double d2 = to[0] * to[0] + to[1] * to[1] + to[2] * to[2];
            double incidence =
                to[0] * pixel->normal.x + to[1] * pixel->normal.y + to[2] * pixel->normal.z;
            double emission = to[0] * l[0] + to[1] * l[1] + to[2] * l[2]; /* x r */
            double r = sqrt((double)l[0] * l[0] + l[1] * l[1] + l[2] * l[2]);
            double expected = 0.33 / M_PI * r * fmax(0, incidence) * emission / (d2 * d2);
            lit += expected > 0;
            for (uint32_t s = 0; s < scene->config.n_channels; s++)
                for (uint32_t c = 0; c < 3; c++) {
                    double p = sim_response_of(&scene->response[0], s, c, SIM_MAT_FLAT) *
                               (s >= 6 ? 0.5 : 1);
                    /* single precision geometry */
                    g_assert_cmpfloat(fabs(out[((size_t)s * n + k) * 3 + c] - expected * p), <,
                                      2e-5);
                }
        }
    }
    g_assert_cmpuint(lit, >, 500);
    g_free(out);
    sim_scene_destroy(scene);
}

/* The brightest pixel of the chrome ball under a light is where the half vector is normal. */
static void test_highlight(void)
{
    struct sim_scene *scene = new_scene("chrome", 256);
    struct sim_region region = whole(scene);
    uint32_t n = 256 * 256, tried = 0;
    float *out = g_new(float, (size_t)scene->config.n_channels *n * 3);
    for (uint32_t light = 3; light < 346; light += 61) {
        if (scene->geometry.direction[light][2] < 0)
            continue; /* behind: at the ball's edge, where a pixel spans degrees */
        g_assert_cmpint(sim_truth_field(scene, &region, light, out, NULL), ==, LS_OK);
        uint32_t best = 0;
        for (uint32_t k = 0; k < n; k++)
            if (out[3 * k + 1] > out[3 * best + 1])
                best = k;
        const struct sim_pixel *pixel = &scene->view[0].pixels[best];
        struct sim_vec to_light =
            sim_unit(sim_sub(sim_vec_of(scene->geometry.position_m[light]), pixel->x));
        struct sim_vec to_eye = sim_unit(sim_sub(scene->view[0].eye, pixel->x));
        struct sim_vec half = sim_unit(sim_add(to_light, to_eye));
        /* one pixel is 0.003 m of a 0.1 m ball: 1.6 degrees */
        g_assert_cmpfloat(sim_dot(half, pixel->normal), >, cos(2.5 * M_PI / 180));
        tried++;
    }
    g_assert_cmpuint(tried, >=, 2);
    g_free(out);
    sim_scene_destroy(scene);
}

static const struct sim_body *matte_sphere(const struct sim_scene *scene)
{
    for (uint32_t i = 0; i < scene->subject.n_bodies; i++)
        if (scene->subject.body[i].shape == SIM_SPHERE &&
            scene->subject.surface[scene->subject.dress[i].front].material == SIM_MAT_OCHRE)
            return &scene->subject.body[i];
    g_assert_not_reached();
}

/* The table point on the line from a high light behind through the middle of the matte sphere is in
 * its shadow; a light from the front reaches it. */
static void test_shadow(void)
{
    struct sim_scene *scene = new_scene("stilllife", 512);
    const struct sim_body *sphere = matte_sphere(scene);
    const float behind[3] = {0.2f, 0.8f, -0.5f}, front[3] = {0, 0.5f, 1};
    uint32_t light = sim_geometry_nearest(&scene->geometry, behind);
    struct sim_vec from = sim_vec_of(scene->geometry.position_m[light]);
    struct sim_vec ray = sim_sub(sphere->origin, from);
    struct sim_vec at = sim_along(from, ray, (-0.22f - from.y) / ray.y);
    double x, y;
    sim_view_project(&scene->view[0], at, &x, &y);
    struct sim_region region = {0, (uint32_t)x, (uint32_t)y, 1, 1};
    const struct sim_pixel *pixel = &scene->view[0].pixels[region.y * 512 + region.x];
    g_assert_cmpfloat(fabsf(pixel->x.y + 0.22f), <, 1e-4f); /* the pixel sees the table ... */
    g_assert_cmpfloat(sim_length(sim_sub(pixel->x, at)), <, 0.02f); /* ... there */
    float *out = g_new(float, (size_t)scene->config.n_channels * 3);
    g_assert_cmpint(sim_truth_field(scene, &region, light, out, NULL), ==, LS_OK);
    float shadow = out[1];
    g_assert_cmpint(
        sim_truth_field(scene, &region, sim_geometry_nearest(&scene->geometry, front), out, NULL),
        ==, LS_OK);
    g_assert_cmpfloat(out[1], >, 0.01f);
    g_assert_cmpfloat(shadow, <, 0.1f * out[1]); /* bounced light alone */
    g_free(out);
    sim_scene_destroy(scene);
}

/* The rows of the transport never gather more than was sent: bounced light of a white light is less
 * than what an all-white closed box could return, and never negative. */
static void test_bounce_energy(void)
{
    struct sim_scene *scene = new_scene("stilllife", 16);
    const struct sim_bounce *b = &scene->bounce;
    for (uint32_t i = 0; i < b->n_lights; i++)
        for (uint32_t node = 0; node < b->n_nodes; node++) {
            const float *coef = b->coef + ((size_t)i * b->n_nodes + node) * SIM_CHAINS;
            double once = 0, twice = 0;
            for (int k = 0; k < SIM_CHAINS; k++) {
                g_assert_cmpfloat(coef[k], >=, 0);
                *(k < 4 ? &once : &twice) += coef[k] * M_PI;
            }
            /* no sender is lit stronger than 1.35^2 / 0.6^2 = 5: objects stay within 0.75 m */
            g_assert_cmpfloat(once, <, 5);
            g_assert_cmpfloat(twice, <, 5);
        }
    double strongest = 0;
    struct sim_region region = whole(scene);
    float share[16 * 16];
    g_assert_cmpint(sim_truth_bounced(scene, &region, share, NULL), ==, LS_OK);
    for (int k = 0; k < 256; k++) {
        g_assert_cmpfloat(share[k], >=, 0);
        g_assert_cmpfloat(share[k], <=, 1);
        strongest = fmax(strongest, share[k]);
    }
    g_assert_cmpfloat(strongest, >, 0.1); /* and there is some to see */
    sim_scene_destroy(scene);
}

/* Unpolarised light is both polarisers' sum, up to what the sheet takes from the spectrum. A mirror
 * facing the camera keeps the polarisation: V passes, H is stopped. */
static void test_polarisers(void)
{
    struct sim_scene *scene = new_scene("gloss", 128);
    struct sim_region region = whole(scene);
    uint32_t n = 128 * 128;
    float *out = g_new(float, (size_t)scene->config.n_channels *n * 3);
    float front[3] = {0, 0, 1};
    uint32_t near = sim_geometry_nearest(&scene->geometry, front), compared = 0;
    for (uint32_t light = 1; light < 346; light += 23) {
        g_assert_cmpint(sim_truth_field(scene, &region, light, out, NULL), ==, LS_OK);
        for (uint32_t k = 0; k < n; k++) {
            double w = out[3 * k + 1], v = out[((size_t)6 * n + k) * 3 + 1];
            double h = out[((size_t)7 * n + k) * 3 + 1];
            g_assert_cmpfloat(fabs(v + h - w), <=, 1e-4 * w + 1e-9); /* float rounding */
            compared += w > 0;
        }
    }
    g_assert_cmpuint(compared, >, 1000);
    g_assert_cmpint(sim_truth_field(scene, &region, near, out, NULL), ==, LS_OK);
    uint32_t centre = 64 * 128 + 64;
    double v = out[((size_t)6 * n + centre) * 3 + 1], h = out[((size_t)7 * n + centre) * 3 + 1];
    g_assert_cmpfloat(v, >, 50 * h);
    g_free(out);
    sim_scene_destroy(scene);
}

static void test_gains(void)
{
    struct sim_scene *scene = new_scene("grey", 8);
    uint32_t n = scene->geometry.n_lights;
    for (uint32_t s = 0; s < scene->config.n_channels; s++) {
        double sum = 0, square = 0, wanted = s < 6 ? 1 : scene->polariser_gain;
        for (uint32_t i = 0; i < n; i++) {
            double g = sim_scene_gain(scene, i, s) / wanted;
            sum += g;
            square += (g - 1) * (g - 1);
        }
        g_assert_cmpfloat(fabs(sum / n - 1), <, 1e-5);
        /* 5 % within four standard errors of a sample of 346: 4 / sqrt(2 * 346) = 15 % of it */
        g_assert_cmpfloat(fabs(sqrt(square / n) - 0.05), <, 0.0076);
    }
    g_assert_cmpfloat(fabs(sim_scene_gain(scene, 0, 0) - sim_scene_gain(scene, 0, 1)), >, 1e-6);
    g_assert_cmpfloat(sim_scene_droop(scene, 0, 1), ==, 1);
    g_assert_cmpfloat(fabs(sim_scene_droop(scene, 0, n) - 1.20), <, 1e-12);
    g_assert_cmpfloat(fabs(sim_scene_droop(scene, 2, n) - 1.14), <, 1e-12);
    sim_scene_destroy(scene);
}

static void test_same_again(void)
{
    struct sim_scene *a = new_scene("stilllife", 32), *b = new_scene("stilllife", 32);
    struct sim_led led = {120, 0, 1};
    struct sim_condition condition = {LS_WIRE_CONDITION_ONE, 1, &led};
    struct sim_exposure e = {.exposure_us = 4000, .lit_us = 4000, .sequence = 9};
    struct sim_raw_format f = {
        .width = 32, .height = 32, .pixel_format = ls_pixel_by_name("BayerRG12")->code};
    uint8_t first[2048], second[2048], other[2048];
    g_assert_cmpint(sim_scene_commit(a, &condition, 1, NULL, NULL, NULL), ==, LS_OK);
    g_assert_cmpint(sim_scene_commit(b, &condition, 1, NULL, NULL, NULL), ==, LS_OK);
    g_assert_cmpint(sim_scene_expose(a, &e, &f, first, sizeof first, NULL), ==, LS_OK);
    g_assert_cmpint(sim_scene_expose(b, &e, &f, second, sizeof second, NULL), ==, LS_OK);
    e.sequence = 10;
    g_assert_cmpint(sim_scene_expose(b, &e, &f, other, sizeof other, NULL), ==, LS_OK);
    g_assert_cmpint(memcmp(first, second, sizeof first), ==, 0);
    g_assert_cmpint(memcmp(first, other, sizeof first), !=, 0);
    sim_scene_destroy(a);
    sim_scene_destroy(b);
}

/* Pictures in memory hold the truth within half precision; what does not fit is rendered on demand
 * and shows the same; a second commit of a part keeps what is there. */
static void test_commit(void)
{
    struct sim_scene *scene = new_scene("stilllife", 48);
    uint32_t n = scene->geometry.n_lights;
    struct sim_led *all = g_new(struct sim_led, n), one = {200, 1, 1};
    for (uint32_t i = 0; i < n; i++)
        all[i] = (struct sim_led){(uint16_t)i, 1, 0.011f};
    struct sim_condition program[] = {{LS_WIRE_CONDITION_DARK, 0, NULL},
                                      {LS_WIRE_CONDITION_ONE, 1, &one},
                                      {LS_WIRE_CONDITION_SPHERE, n, all}};
    g_assert_cmpint(sim_scene_commit(scene, program, 3, NULL, NULL, NULL), ==, LS_OK);
    g_assert_null(scene->program[0]);
    float *weights = weights_for(scene);
    for (uint32_t i = 0; i < n; i++)
        weights[n + i] = (float)(0.011 * sim_scene_gain(scene, i, 1) / 1.20);
    float *truth = relight(scene, weights);
    for (uint32_t k = 0; k < 48 * 48; k++) {
        uint32_t c = ls_cfa_channel(LS_CFA_RGGB, k % 48, k / 48);
        double got = ls_half_to_float(scene->program[2]->half[0][k]) / sim_picture_scale;
        g_assert_cmpfloat(fabs(got - truth[3 * k + c]), <=, 6e-4 * truth[3 * k + c] + 1e-6);
    }
    const uint16_t *kept = scene->program[1]->half[0];
    g_assert_cmpint(sim_scene_commit(scene, program + 1, 1, NULL, NULL, NULL), ==, LS_OK);
    g_assert_true(scene->program[0]->half[0] == kept);
    scene->config.memory_bytes = 0;
    one.light = 201;
    g_assert_cmpint(sim_scene_commit(scene, program + 1, 1, NULL, NULL, NULL), ==, LS_OK);
    g_assert_null(scene->program[0]->half[0]);
    struct sim_exposure e = {.exposure_us = 4000, .lit_us = 4000};
    struct sim_raw_format f = {.width = 48,
                               .height = 48,
                               .pixel_format = ls_pixel_by_name("BayerRG16")
                                                   ? ls_pixel_by_name("BayerRG16")->code
                                                   : ls_pixel_by_name("BayerRG12")->code};
    uint8_t cold[48 * 48 * 2], warm[48 * 48 * 2];
    g_assert_cmpint(sim_scene_expose(scene, &e, &f, cold, sizeof cold, NULL), ==, LS_OK);
    scene->config.memory_bytes = 1 << 20;
    g_assert_cmpint(sim_scene_commit(scene, program + 1, 1, NULL, NULL, NULL), ==, LS_OK);
    g_assert_nonnull(scene->program[0]->half[0]);
    g_assert_cmpint(sim_scene_expose(scene, &e, &f, warm, sizeof warm, NULL), ==, LS_OK);
    g_assert_cmpint(memcmp(cold, warm, sizeof warm), ==, 0);
    one.light = 400;
    struct ls_diag diag = {{0}};
    g_assert_cmpint(sim_scene_commit(scene, program + 1, 1, NULL, NULL, &diag), ==, LS_ERR_INVALID);
    g_assert_nonnull(strstr(diag.text, "346"));
    g_assert_cmpint(sim_scene_expose(scene, &e, &f, warm, sizeof warm, NULL), ==, LS_OK);
    g_free(all);
    g_free(weights);
    g_free(truth);
    sim_scene_destroy(scene);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/scene/white-furnace-reads-the-sphere's-reflectance", test_furnace);
    g_test_add_func("/scene/grey-sphere-follows-lambert-and-inverse-square", test_lambert);
    g_test_add_func("/scene/chrome-shows-a-light-where-reflection-says", test_highlight);
    g_test_add_func("/scene/matte-sphere-casts-its-shadow-on-the-table", test_shadow);
    g_test_add_func("/scene/bounced-light-is-never-more-than-was-sent", test_bounce_energy);
    g_test_add_func("/scene/polarisers-add-up-and-a-mirror-keeps-them-apart", test_polarisers);
    g_test_add_func("/scene/gains-spread-as-configured-around-one", test_gains);
    g_test_add_func("/scene/a-run-repeats-exactly", test_same_again);
    g_test_add_func("/scene/committed-pictures-are-the-truth", test_commit);
    return g_test_run();
}
