/* What runs of a take add to take.json about darks and clocks. */
#include "daemon/findings.h"

#include <glib.h>
#include <jansson.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

static struct ls_findings first_run(void)
{
    struct ls_findings f = {.n_cameras = 2, .n_exposures = 2};
    f.darks[0][0] = (struct ls_dark_finding){true, 64.25, 1.5, 0.001, 3};
    f.darks[1][1] = (struct ls_dark_finding){true, 32, 1, 0, 0};
    f.controller = (struct ls_clock_finding){.pairs = 70,
                                             .tick_ns = 1000,
                                             .ticks = 3600000000000,
                                             .host_ns = 5e9,
                                             .drift_ppm = 35,
                                             .residual_rms_us = 2,
                                             .residual_max_us = 7};
    return f;
}

static json_t *put(const struct ls_findings *f, const char *document, char **text)
{
    struct ls_diag diag = {{0}};
    g_assert_cmpint(ls_findings_put(f, document, text, &diag), ==, LS_OK);
    json_t *doc = json_loads(*text, JSON_REJECT_DUPLICATES, NULL);
    g_assert_nonnull(doc);
    return doc;
}

static double number_of(const json_t *doc, const char *list, size_t index, const char *key)
{
    const json_t *item = json_array_get(json_object_get(doc, list), index);
    g_assert_true(json_is_number(json_object_get(item, key)));
    return json_number_value(json_object_get(item, key));
}

static void test_stated(void)
{
    const struct ls_findings f = first_run();
    char *text;
    json_t *doc = put(&f, "{\"plan\": 7}", &text);
    g_assert_cmpint(json_integer_value(json_object_get(doc, "plan")), ==, 7);
    g_assert_cmpuint(json_array_size(json_object_get(doc, "darks")), ==, 2);
    g_assert_cmpfloat(number_of(doc, "darks", 0, "mean_dn"), ==, 64.25);
    g_assert_cmpfloat(number_of(doc, "darks", 0, "defects"), ==, 3);
    g_assert_cmpfloat(number_of(doc, "darks", 1, "camera"), ==, 1);
    g_assert_cmpfloat(number_of(doc, "darks", 1, "exposure"), ==, 1);
    g_assert_cmpuint(json_array_size(json_object_get(doc, "clocks")), ==, 1);
    g_assert_cmpfloat(number_of(doc, "clocks", 0, "offset_ns"), ==, 5e9 - 3600000000000e3);
    json_decref(doc);
    free(text);
}

static void test_second_run(void)
{
    struct ls_findings f = first_run();
    char *one, *two;
    json_decref(put(&f, "{}", &one));
    f.darks[0][0] = (struct ls_dark_finding){true, 64.25, NAN, NAN, 2}; /* adopted */
    f.darks[0][1] = (struct ls_dark_finding){true, 65, NAN, NAN, 2};
    f.darks[1][1].mean_dn = 33; /* shot again */
    json_t *doc = put(&f, one, &two);
    g_assert_cmpuint(json_array_size(json_object_get(doc, "darks")), ==, 3);
    g_assert_cmpfloat(number_of(doc, "darks", 0, "read_noise_dn"), ==, 1.5);
    g_assert_cmpfloat(number_of(doc, "darks", 0, "defects"), ==, 3);
    const json_t *adopted = json_array_get(json_object_get(doc, "darks"), 2);
    g_assert_true(json_is_null(json_object_get(adopted, "read_noise_dn")));
    g_assert_cmpfloat(number_of(doc, "darks", 1, "mean_dn"), ==, 33);
    g_assert_cmpuint(json_array_size(json_object_get(doc, "clocks")), ==, 2);
    json_decref(doc);
    free(one);
    free(two);
}

static void test_refused(void)
{
    const struct ls_findings f = first_run();
    struct ls_diag diag = {{0}};
    char *text;
    g_assert_cmpint(ls_findings_put(&f, "[]", &text, &diag), ==, LS_ERR_INVALID);
    g_assert_cmpint(ls_findings_put(&f, "{", &text, &diag), ==, LS_ERR_INVALID);
    g_assert_nonnull(strstr(diag.text, "take.json:1"));
}

/* A camera's line to the host goes through the controller's. */
static void test_composed(void)
{
    struct ls_clock controller, camera;
    const struct ls_camera_residuals residuals = {.max_us = 4, .sum_squares_us2 = 40, .n = 10};
    ls_clock_init(&controller, 1e6, 1);
    ls_clock_init(&camera, 1e9, 1);
    /* the controller 50 ppm fast, the camera 30 ppm slow, both against the host */
    for (uint64_t s = 1; s <= 20; s++) {
        uint64_t host_ns = s * 1000000000, us = 500000000 + s * 1000050;
        g_assert_cmpint(ls_clock_add(&controller, us, host_ns, host_ns), ==, LS_OK);
        g_assert_cmpint(ls_clock_add(&camera, 7 + s * 999970000, us * 1000, us * 1000), ==, LS_OK);
    }
    struct ls_clock_finding c = ls_find_camera(&camera, &controller, &residuals);
    /* the fits are exact but for their prior of 200 ppm and a floor of 1 ns over 20 s */
    g_assert_cmpfloat(fabs(c.drift_ppm - 30), <, 0.01);
    g_assert_cmpfloat(fabs(c.host_ns - 20e9), <, 20);
    g_assert_cmpuint(c.ticks, ==, 7 + 20 * 999970000ull);
    g_assert_cmpfloat(c.residual_rms_us, ==, 2);
    g_assert_cmpfloat(c.residual_max_us, ==, 4);
    g_assert_cmpfloat(fabs(ls_find_controller(&controller).drift_ppm + 50), <, 0.01);
    ls_clock_init(&camera, 1e9, 1);
    g_assert_cmpuint(ls_find_camera(&camera, &controller, &residuals).pairs, ==, 0);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/findings/darks-and-clocks-are-stated", test_stated);
    g_test_add_func("/findings/a-second-run-adds-clocks-and-forgets-no-dark", test_second_run);
    g_test_add_func("/findings/what-is-no-object-is-refused", test_refused);
    g_test_add_func("/findings/a-camera-is-placed-through-the-controller", test_composed);
    return g_test_run();
}
