/* Where lights stand by the highlight on a chrome ball, and where no camera can say. */
#include "core/calibration.h"
#include "core/chrome_ball.h"
#include "core/vec3.h"
#include "core/shading.h"
#include "tests/core/grey_rig.h"

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
    g_test_add_func("/directions/of-a-light-nobody-saw-are-refused", test_unseen);
    g_test_add_func("/directions/by-a-chrome-ball-agree", test_chrome);
    g_test_add_func("/directions/a-ball-without-a-highlight-is-refused", test_no_highlight);
    return g_test_run();
}
