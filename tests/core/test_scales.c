/* What a grey and a chrome ball say beside the gains: factors of patterns, p, closure, V + H = W,
 * the mirror's reflectivity; against the simulator's truth. */
#include "core/calibration.h"
#include "core/chrome_ball.h"
#include "core/merge.h"
#include "core/pattern_factor.h"
#include "core/sample.h"
#include "sim/truth.h"
#include "sim/world.h"
#include "tests/core/grey_bench.h"

#include <glib.h>
#include <math.h>
#include <string.h>

/* ---- patterns ---- */

static void refuse(enum ls_err err, const struct ls_diag *diag, const char *words)
{
    g_test_message("%s", diag->text);
    g_assert_cmpint(err, !=, LS_OK);
    g_assert_nonnull(strstr(diag->text, words));
}

static void test_hostile_patterns(void)
{
    struct ls_pinhole camera;
    const double eye[3] = {0, 0, 1.6}, at[3] = {0};
    struct ls_sphere ball = {{0}, 0.1};
    struct ls_sphere_view *view = NULL;
    struct ls_pattern_factor f;
    struct ls_diag diag = {{0}};
    static float sum[64 * 64], shot[64 * 64];
    static uint8_t bad[64 * 64];
    g_assert_cmpint(ls_pinhole_aim(eye, at, 50, 8, 64, 64, &camera, NULL), ==, LS_OK);
    g_assert_cmpint(ls_sphere_view_create(&camera, LS_CFA_RGGB, &ball, NULL, 0, &view, NULL), ==,
                    LS_OK);
    refuse(ls_pattern_factor(view, sum, NULL, shot, NULL, 0.01, &f, &diag), &diag, "usable");
    for (int k = 0; k < 64 * 64; k++) {
        sum[k] = 12;
        shot[k] = 0.1f;
        bad[k] = LS_VALIDITY_SATURATED;
    }
    refuse(ls_pattern_factor(view, sum, NULL, shot, bad, 0.01, &f, &diag), &diag, "usable");
    refuse(ls_pattern_factor(view, sum, NULL, shot, NULL, 0, &f, &diag), &diag, "duty");
    refuse(ls_pattern_factor(view, sum, NULL, shot, NULL, 1, &f, &diag), &diag, "0.2 to 5");
    /* a fifth of the pixels is nonsense: the others are believed */
    for (int k = 0; k < 64 * 64; k += 5)
        shot[k] = k % 2 ? NAN : 40;
    g_assert_cmpint(ls_pattern_factor(view, sum, NULL, shot, NULL, 0.01, &f, &diag), ==, LS_OK);
    g_assert_cmpfloat(fabs(f.factor - 1.2), <, 1e-6);
    for (int k = 0; k < 64 * 64; k++)
        shot[k] = 0;
    refuse(ls_pattern_factor(view, sum, NULL, shot, NULL, 0.01, &f, &diag), &diag, "0.2 to 5");
    refuse(ls_pattern_factor_combine(NULL, 0, &f, &diag), &diag, "nothing");
    ls_sphere_view_destroy(view);
}

/* ---- closure ---- */

static void check_polarised(const struct grey_bench *b, const struct ls_grey *m, uint32_t s)
{
    double worst = 0;
    for (uint32_t i = 0; i < m->n_lights; i++)
        if (!m->flags[i])
            worst = fmax(worst, fabs(m->gains[s].k[i] * sim_scene_gain(b->rig->scene, i, s) - 1));
    g_test_message("k of polariser %u: worst %.3f %%", s, 100 * worst);
    g_assert_cmpfloat(worst, <, 0.005);
}

static void check_factors(const struct grey_bench *b, const struct ls_grey *m)
{
    g_assert_cmpuint(m->n_factors, ==, 2 * m->n_channels);
    for (uint32_t k = 0; k < m->n_factors; k++) {
        const struct ls_grey_factor *f = &m->factors[k];
        double truth = strcmp(f->pattern, "sphere") ? grey_bench_group_factor(b, f->channel)
                                                    : grey_bench_sphere_factor(b, f->channel);
        g_test_message("%s of channel %u: %.5f, truth %.5f", f->pattern, f->channel,
                       f->value.factor, truth);
        g_assert_cmpfloat(fabs(f->value.factor / truth - 1), <, 0.005);
    }
}

static void test_closure(void)
{
    struct grey_rig_options o = {"grey", 9, 0.05, 1, "WAVH", 96, "RG", 1};
    struct grey_bench *b = grey_bench_new(&o);
    struct ls_grey *m = grey_bench_measure(b);
    const struct ls_grey_view *view = &m->cameras[0];
    struct ls_calibration *truth = NULL;
    check_polarised(b, m, 2);
    check_polarised(b, m, 3);
    check_factors(b, m);
    g_assert_cmpint(sim_truth_calibration(b->rig->scene, 0, "BayerRG12", NULL, 0, &truth, NULL), ==,
                    LS_OK);
    g_test_message("scale %.6g, truth %.6g", view->scale, truth->scale);
    /* the sensor's unequal pixels, 0.5 % each, and the mean of the lights behind, 0.1 % */
    g_assert_cmpfloat(fabs(view->scale / truth->scale - 1), <, 0.004);
    for (int s = 0; s < 4; s++)
        for (int c = 0; c < 3; c++) {
            g_test_message("p(%d,%d) %.5f, truth %.5f", s, c, view->p[s][c], truth->p[s][c]);
            g_assert_cmpfloat(fabs((double)(view->p[s][c] - truth->p[s][c])), <, 0.004);
        }
    ls_calibration_destroy(truth);
    ls_grey_destroy(m);
    grey_bench_free(b);
}

/* ---- mirror ---- */

static void test_mirror(void)
{
    struct grey_rig_options o = {"chrome", 5, 0.05, 1, "W", 128, "RG", 0.02};
    struct grey_rig *rig = grey_rig_create(&o, 0.011, GREY_GROUPS, 0.1);
    const struct sim_response *r = &rig->scene->response[0];
    struct ls_sphere_view *view = NULL;
    float *e = g_new(float, rig->n_pixels), found[3][346];
    uint8_t *validity = g_new(uint8_t, rig->n_pixels);
    uint32_t n = 0;
    g_assert_cmpint(
        ls_sphere_view_create(&rig->camera[0], LS_CFA_RGGB, &rig->sphere, NULL, 0, &view, NULL), ==,
        LS_OK);
    for (uint32_t i = 0; i < rig->n_lights; i += 2) {
        double position[3], strength[3], rho[3], sigma[3];
        grey_rig_position(rig, i, position);
        if (position[2] < 0.3)
            continue;
        for (uint32_t c = 0; c < 3; c++) /* as a grey sphere would have it */
            strength[c] = grey_reflectance * sim_scene_gain(rig->scene, i, 0) *
                          (double)sim_response_of(r, 0, c, SIM_MAT_FLAT) *
                          sim_world_rate(&sim_scene_config(rig->scene)->views[0]);
        grey_rig_picture(rig, 0, grey_rig_light(rig, 0, i), e, validity);
        struct ls_diag diag = {{0}};
        enum ls_err err = ls_chrome_reflectivity(view, position, e, validity, strength,
                                                 grey_reflectance, rho, sigma, &diag);
        g_assert_cmpstr(diag.text, ==, "");
        g_assert_cmpint(err, ==, LS_OK);
        for (uint32_t c = 0; c < 3; c++)
            found[c][n] = (float)rho[c];
        n++;
    }
    for (uint32_t c = 0; c < 3; c++) {
        double truth = (double)(sim_response_of(r, 0, c, SIM_MAT_CHROME) /
                                sim_response_of(r, 0, c, SIM_MAT_FLAT));
        double rho = (double)ls_median(found[c], n);
        g_test_message("colour %u: reflectivity %.4f, truth %.4f, of %u lights", c, rho, truth, n);
        /* a rough metal throws 1 % of its light past 60 degrees */
        g_assert_cmpfloat(fabs(rho / truth - 1), <, 0.02);
    }
    ls_sphere_view_destroy(view);
    g_free(e);
    g_free(validity);
    grey_rig_destroy(rig);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/scales/patterns-that-make-no-sense-are-refused", test_hostile_patterns);
    g_test_add_func("/scales/closure-p-polarisers-and-factors-are-those-of-the-simulator",
                    test_closure);
    g_test_add_func("/scales/a-chrome-ball-tells-its-reflectivity", test_mirror);
    return g_test_run();
}
