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

enum { GROUPS = 14 };
static const double reflectance = 0.33; /* materials.csv: 0.3300 at every wavelength */

/* ---- patterns ---- */

static void add_picture(struct grey_bench *b, uint32_t channel, uint32_t light, float *sum,
                        uint8_t *worst)
{
    grey_rig_picture(b->rig, 0, grey_rig_light(b->rig, channel, light), b->e, b->validity);
    for (uint32_t p = 0; p < b->rig->n_pixels; p++) {
        sum[p] += b->e[p];
        worst[p] = b->validity[p] == LS_VALIDITY_SATURATED ? LS_VALIDITY_SATURATED : worst[p];
    }
}

static struct ls_pattern_factor factor_of(struct grey_bench *b, uint32_t condition,
                                          const float *sum, const uint8_t *worst, double duty)
{
    struct ls_pattern_factor f;
    struct ls_diag diag = {{0}};
    grey_rig_picture(b->rig, 0, condition, b->e, b->validity);
    enum ls_err err = ls_pattern_factor(b->view[0], sum, worst, b->e, b->validity, duty, &f, &diag);
    g_assert_cmpstr(diag.text, ==, "");
    g_assert_cmpint(err, ==, LS_OK);
    return f;
}

/* Duty as driven holds 11 of 1000 steps, so that 0.0111 is quantised by 0.9 %. */
static void patterns_case(double spread)
{
    const double duty = 0.0111, group_duty = 0.1;
    struct grey_rig_options o = {"grey", 7, spread, 1, "A", 96, "RG", 1};
    struct grey_bench *b = grey_bench_new_with(&o, duty, GROUPS, group_duty);
    uint32_t n = b->rig->n_pixels, lights = b->rig->n_lights;
    float *sum[GROUPS + 1];
    uint8_t *worst = g_new0(uint8_t, n);
    struct ls_pattern_factor each[GROUPS], group, f;
    double worst_z = 0, wanted = 0;
    for (uint32_t g = 0; g <= GROUPS; g++)
        sum[g] = g_new0(float, n);
    for (uint32_t i = 0; i < lights; i++)
        add_picture(b, 0, i, sum[i % GROUPS], worst);
    for (uint32_t g = 0; g < GROUPS; g++)
        for (uint32_t p = 0; p < n; p++)
            sum[GROUPS][p] += sum[g][p];

    f = factor_of(b, grey_rig_full(b->rig, 0), sum[GROUPS], worst, duty);
    double truth =
        duty / sim_scene_quantise(b->rig->scene, duty) * sim_scene_droop(b->rig->scene, 0, lights);
    g_test_message("spread %g: sphere: %.5f +- %.5f, truth %.5f, %u pixels", spread, f.factor,
                   f.sigma, truth, f.n);
    g_assert_cmpfloat(fabs(f.factor / truth - 1), <, 0.005);
    g_assert_cmpfloat(fabs(f.factor - truth), <, 4 * f.sigma + 2e-4 * truth);
    for (uint32_t g = 0; g < GROUPS; g++) {
        each[g] = factor_of(b, grey_rig_group(b->rig, 0, g, GROUPS), sum[g], worst, group_duty);
        uint32_t lit = lights / GROUPS + (g < lights % GROUPS);
        double t = sim_scene_droop(b->rig->scene, 0, lit) * group_duty /
                   sim_scene_quantise(b->rig->scene, group_duty);
        wanted += t / GROUPS;
        worst_z = fmax(worst_z, fabs(each[g].factor - t) / each[g].sigma);
        g_assert_cmpfloat(fabs(each[g].factor / t - 1), <, 0.005);
    }
    g_assert_cmpint(ls_pattern_factor_combine(each, GROUPS, &group, NULL), ==, LS_OK);
    g_test_message("segments: %.5f +- %.5f, truth %.5f; single ones within %.1f sigma",
                   group.factor, group.sigma, wanted, worst_z);
    g_assert_cmpfloat(fabs(group.factor / wanted - 1), <, 0.001);
    g_assert_cmpfloat(worst_z, <, 4.5); /* of 14 */
    for (uint32_t g = 0; g <= GROUPS; g++)
        g_free(sum[g]);
    g_free(worst);
    grey_bench_free(b);
}

static void test_patterns(void)
{
    patterns_case(0.05);
    patterns_case(0.10);
}

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

static void check_closure(struct grey_bench *b, const struct grey_measured *m)
{
    struct ls_calibration *truth = NULL;
    const struct ls_gains *channels[4] = {&m[0].gains, &m[1].gains, &m[2].gains, &m[3].gains};
    double scale, rho[12];
    float p[4][3];
    for (int k = 0; k < 12; k++)
        rho[k] = reflectance;
    g_assert_cmpint(ls_gains_closure(channels, 4, 0, 3, rho, &scale, p, NULL), ==, LS_OK);
    g_assert_cmpint(sim_truth_calibration(b->rig->scene, 0, "BayerRG12", NULL, 0, &truth, NULL), ==,
                    LS_OK);
    g_test_message("scale %.6g, truth %.6g", scale, truth->scale);
    /* the sensor's unequal pixels, 0.5 % each, and the mean of the lights behind, 0.1 % */
    g_assert_cmpfloat(fabs(scale / truth->scale - 1), <, 0.004);
    for (int s = 0; s < 4; s++)
        for (int c = 0; c < 3; c++) {
            g_test_message("p(%d,%d) %.5f, truth %.5f", s, c, p[s][c], truth->p[s][c]);
            g_assert_cmpfloat(fabs((double)(p[s][c] - truth->p[s][c])), <, 0.004);
        }
    ls_calibration_destroy(truth);
}

static void test_closure(void)
{
    struct grey_rig_options o = {"grey", 9, 0.05, 1, "WAVH", 96, "RG", 1};
    struct grey_bench *b = grey_bench_new(&o);
    struct grey_measured m[4];
    for (uint32_t s = 0; s < 4; s++)
        grey_measure(b, s, &m[s]);
    for (uint32_t s = 2; s < 4; s++) {
        double worst = 0;
        g_assert_cmpint(
            ls_gains_scale_polarised(&m[s].gains, &m[0].gains, b->rig->n_lights, 1, 3, NULL), ==,
            LS_OK);
        for (uint32_t i = 0; i < b->rig->n_lights; i++)
            if (!m[s].gains.flags[i])
                worst =
                    fmax(worst, fabs(m[s].gains.k[i] * sim_scene_gain(b->rig->scene, i, s) - 1));
        g_test_message("k of polariser %u: worst %.3f %%", s, 100 * worst);
        g_assert_cmpfloat(worst, <, 0.005);
    }
    check_closure(b, m);
    for (uint32_t s = 0; s < 4; s++)
        grey_measured_finish(&m[s]);
    grey_bench_free(b);
}

/* ---- mirror ---- */

static void test_mirror(void)
{
    struct grey_rig_options o = {"chrome", 5, 0.05, 1, "W", 128, "RG", 0.02};
    struct grey_rig *rig = grey_rig_create(&o, 0.011, GROUPS, 0.1);
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
            strength[c] = reflectance * sim_scene_gain(rig->scene, i, 0) *
                          (double)sim_response_of(r, 0, c, SIM_MAT_FLAT) *
                          sim_world_rate(&sim_scene_config(rig->scene)->views[0]);
        grey_rig_picture(rig, 0, grey_rig_light(rig, 0, i), e, validity);
        struct ls_diag diag = {{0}};
        enum ls_err err = ls_chrome_reflectivity(view, position, e, validity, strength, reflectance,
                                                 rho, sigma, &diag);
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
    g_test_add_func("/scales/pattern-factors-come-back-within-half-a-percent", test_patterns);
    g_test_add_func("/scales/patterns-that-make-no-sense-are-refused", test_hostile_patterns);
    g_test_add_func("/scales/closure-p-and-polarisers-are-those-of-the-simulator", test_closure);
    g_test_add_func("/scales/a-chrome-ball-tells-its-reflectivity", test_mirror);
    return g_test_run();
}
