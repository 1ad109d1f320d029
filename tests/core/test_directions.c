/* Where lights stand: by shading of a grey sphere, and by the highlight on a chrome ball. */
#include "core/calibration.h"
#include "core/chrome_ball.h"
#include "core/vec3.h"
#include "tests/core/grey_bench.h"

#include <glib.h>
#include <math.h>
#include <string.h>

static double angle_deg(const double a[3], const double b[3])
{
    double d[3];
    ls_along3(a, b, -1, d);
    return 2 * asin(0.5 * ls_length3(d)) * 180 / M_PI;
}

static void unit_position(const struct grey_rig *rig, uint32_t light, double d[3])
{
    grey_rig_position(rig, light, d);
    ls_unit3(d);
}

/* The rig file's idea of a light: its direction turned by up to @deg, from a fixed pattern. */
static void believed(const double truth[3], uint32_t light, double deg, double d[3])
{
    double e1[3], e2[3], a = light * 2.399963, r = deg * M_PI / 180;
    ls_tangents(truth, e1, e2);
    ls_along3(truth, e1, r * cos(a), d);
    ls_along3(d, e2, r * sin(a), d);
    ls_unit3(d);
}

static void measure_direction(struct grey_bench *b, uint32_t light, double deg, double found[3],
                              double *sigma_deg)
{
    struct ls_shading fits[SIM_MAX_CAMERAS];
    double truth[3], nominal[3], position[3];
    unit_position(b->rig, light, truth);
    believed(truth, light, deg, nominal);
    for (int k = 0; k < 3; k++)
        position[k] = 1.35 * nominal[k]; /* the radius of the simulated rig */
    for (uint32_t k = 0; k < b->rig->options.n_cameras; k++)
        grey_bench_fit(b, k, 0, light, position, &fits[k]);
    g_assert_cmpint(
        ls_direction_combine(nominal, fits, b->rig->options.n_cameras, found, sigma_deg, NULL), ==,
        LS_OK);
}

static void directions_case(uint32_t cameras, double spread, uint32_t every)
{
    struct grey_rig_options o = {"grey", 5, spread, cameras, "W", 96, "RG", 1};
    struct grey_bench *b = grey_bench_new(&o);
    double worst = 0, square = 0, z2 = 0;
    uint32_t n = 0;
    for (uint32_t i = 0; i < b->rig->n_lights; i += every) {
        double truth[3], found[3], sigma;
        unit_position(b->rig, i, truth);
        if (ls_gains_one_sided(truth, (const double(*)[3])b->rig->camera_m, cameras))
            continue;
        measure_direction(b, i, 2, found, &sigma);
        double off = angle_deg(found, truth);
        worst = fmax(worst, off);
        square += off * off;
        z2 += off * off / (2 * sigma * sigma);
        n++;
    }
    g_test_message("%u cameras, spread %g, %u lights believed 2 degrees off: worst %.3f, rms %.3f "
                   "degrees, error over sigma %.2f",
                   cameras, spread, n, worst, sqrt(square / n), sqrt(z2 / n));
    g_assert_cmpfloat(worst, <, 0.5);
    /* honest: the rms of n > 100 pairs over sigma lies within 15 % of 1, plus what the sphere's own
     * place (from lights in their true places) may add */
    g_assert_cmpfloat(sqrt(z2 / n), <, 1.3);
    g_assert_cmpfloat(sqrt(z2 / n), >, 0.7);
    grey_bench_free(b);
}

static void test_shading(void)
{
    directions_case(1, 0.05, 2);
    directions_case(4, 0.10, 3);
}

static void test_unseen(void)
{
    struct ls_shading none = {.has_direction = false};
    const double nominal[3] = {0, 0, -1};
    double found[3], sigma;
    struct ls_diag diag = {{0}};
    g_assert_cmpint(ls_direction_combine(nominal, &none, 1, found, &sigma, &diag), ==,
                    LS_ERR_NOT_FOUND);
    g_assert_nonnull(strstr(diag.text, "no camera saw enough"));
}

/* ---- chrome ---- */

static struct ls_sphere_view *ball_view(const struct grey_rig *rig)
{
    struct ls_sphere_view *view = NULL;
    g_assert_cmpint(
        ls_sphere_view_create(&rig->camera[0], LS_CFA_RGGB, &rig->sphere, NULL, 0, &view, NULL), ==,
        LS_OK);
    return view;
}

static void test_chrome(void)
{
    /* exposures for a highlight sixty times as bright as white */
    struct grey_rig_options o = {"chrome", 5, 0.05, 1, "W", 128, "RG", 0.02};
    struct grey_rig *rig = grey_rig_create(&o, 0.011, 14, 0.1);
    struct ls_sphere_view *view = ball_view(rig);
    float *e = g_new(float, rig->n_pixels);
    uint8_t *validity = g_new(uint8_t, rig->n_pixels);
    double worst = 0, sum = 0, worst_z = 0;
    uint32_t n = 0, refused = 0;
    for (uint32_t i = 0; i < rig->n_lights; i += 3) {
        double truth[3];
        struct ls_highlight h;
        unit_position(rig, i, truth);
        if (truth[2] < -0.5)
            continue; /* beyond 120 degrees its highlight smears over the rim */
        grey_rig_picture(rig, 0, grey_rig_light(rig, 0, i), e, validity);
        if (ls_chrome_highlight(view, e, 1.35, &h, NULL)) {
            refused++;
            continue;
        }
        double off = angle_deg(h.direction, truth);
        worst = fmax(worst, off);
        worst_z = fmax(worst_z, off / h.sigma_deg);
        sum += off;
        n++;
    }
    g_test_message(
        "%u lights on a chrome ball of 50 px: mean %.3f, worst %.3f degrees (%.1f sigma), "
        "%u refused",
        n, sum / n, worst, worst_z, refused);
    g_assert_cmpuint(refused, ==, 0);
    g_assert_cmpfloat(sum / n, <, 0.5);
    /* the sampled highlight of a rough metal leans by its shading at the slanted side */
    g_assert_cmpfloat(worst, <, 2);
    ls_sphere_view_destroy(view);
    g_free(e);
    g_free(validity);
    grey_rig_destroy(rig);
}

static void refuse(struct ls_sphere_view *view, const float *e, double distance, const char *words)
{
    struct ls_highlight h;
    struct ls_diag diag = {{0}};
    enum ls_err err = ls_chrome_highlight(view, e, distance, &h, &diag);
    g_test_message("%s", diag.text);
    g_assert_cmpint(err, !=, LS_OK);
    g_assert_nonnull(strstr(diag.text, words));
}

static void test_no_highlight(void)
{
    struct ls_pinhole camera;
    const double eye[3] = {0, 0, 1.6}, at[3] = {0};
    struct ls_sphere ball = {{0}, 0.1};
    struct ls_sphere_view *view = NULL;
    g_assert_cmpint(ls_pinhole_aim(eye, at, 50, 8, 64, 64, &camera, NULL), ==, LS_OK);
    g_assert_cmpint(ls_sphere_view_create(&camera, LS_CFA_NONE, &ball, NULL, 0, &view, NULL), ==,
                    LS_OK);
    float *e = g_new0(float, 64 * 64);
    refuse(view, e, 1.35, "no highlight");
    for (int k = 0; k < 64 * 64; k++)
        e[k] = 1;
    refuse(view, e, 1.35, "no highlight");
    for (int k = 0; k < 64 * 64; k++)
        e[k] = k < 64 * 18 ? 9 : 1; /* over the top of the ball */
    refuse(view, e, 1.35, "rim");
    for (int k = 0; k < 64 * 64; k++)
        e[k] = NAN;
    refuse(view, e, 1.35, "were measured");
    refuse(view, e, 0.05, "inside");
    ls_sphere_view_destroy(view);
    g_free(e);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/directions/by-shading-come-back-within-half-a-degree", test_shading);
    g_test_add_func("/directions/of-a-light-nobody-saw-are-refused", test_unseen);
    g_test_add_func("/directions/by-a-chrome-ball-agree", test_chrome);
    g_test_add_func("/directions/a-ball-without-a-highlight-is-refused", test_no_highlight);
    return g_test_run();
}
