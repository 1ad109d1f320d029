/* promotion_report: what the daemon says of a spectrum is told on, in files and in JSON. */
#include "clients/promotion_report.h"

#include <glib.h>

/* A as a matrix made it, B as a blend did. */
static struct ls_promotion_report two_fitted(void)
{
    static const struct lightstage_spectrum matrix = {.channel = "A",
                                                      .model = LIGHTSTAGE_LINEAR,
                                                      .segments = 14},
                                            blend = {.channel = "B",
                                                     .model = LIGHTSTAGE_LINEAR,
                                                     .segments = 14,
                                                     .blended = 1};
    static const struct lightstage_spectrum *const both[] = {&matrix, &blend};
    struct ls_promotion_report report;
    ls_promotion_report_keep(&report, both, 2);
    return report;
}

static void a_blend_is_named_in_json(void)
{
    const struct ls_promotion_report report = two_fitted();
    json_t *json = ls_promotion_report_json(&report);
    g_assert_true(json_is_false(json_object_get(json_array_get(json, 0), "blended")));
    g_assert_true(json_is_true(json_object_get(json_array_get(json, 1), "blended")));
    json_decref(json);
}

static void a_blend_is_named_in_the_files(void)
{
    struct ls_promotion_report report = two_fitted();
    struct ls_exr_attrs attrs = {0};
    ls_promotion_report_attrs(&report, false, &attrs);
    const struct ls_exr_attr *attr = ls_exr_attrs_find(&attrs, "lightstage/blended");
    g_assert_nonnull(attr);
    g_assert_cmpstr(attr->text, ==, "B");
    ls_exr_attrs_finish(&attrs);
    report.n = 1;
    ls_promotion_report_attrs(&report, false, &attrs);
    g_assert_null(ls_exr_attrs_find(&attrs, "lightstage/blended"));
    ls_exr_attrs_finish(&attrs);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/promotion-report/a-blend-is-named-in-json", a_blend_is_named_in_json);
    g_test_add_func("/promotion-report/a-blend-is-named-in-the-files",
                    a_blend_is_named_in_the_files);
    return g_test_run();
}
