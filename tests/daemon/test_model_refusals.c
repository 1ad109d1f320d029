/* refusals: what a take lacks, what nothing could serve, and room that is not there. */
#include "daemon/map_file.h"
#include "tests/daemon/model_room.h"

#include <string.h>

static void a_cancelled_request_makes_no_more_maps(struct room *room, gconstpointer data)
{
    double w[FULL_LIGHTS] = {1};
    struct ls_job asker = {.cancelled = 1};
    struct ls_render *render = NULL;
    struct ls_diag diag = {0};
    const struct ls_render_term term = {.channel = FULL_CR, .weights = w, .target = -1};
    const struct ls_render_job job = {.promotion = {.model = LIGHTSTAGE__MODEL__LINEAR},
                                      .terms = &term,
                                      .n_terms = 1,
                                      .n_pictures = 1,
                                      .region = whole,
                                      .asker = &asker};
    g_assert_cmpint(ls_render_open(room->source, &job, &render, &diag), ==, LS_ERR_ABORTED);
    g_assert_null(render);
}

static char *refusal(struct room *room, Lightstage__Model model, uint32_t channel, enum ls_err want)
{
    const struct ls_promotion promotion = {.model = model};
    struct ls_diag diag = {0};
    struct ls_way way;
    g_assert_cmpint(ls_promotion_find(room->source, &promotion, channel, NULL, &way, &diag), ==,
                    want);
    g_test_message("%s", diag.text);
    return g_strdup(diag.text);
}

static void assert_says(char *text, const char *words)
{
    if (!strstr(text, words))
        g_error("\"%s\" does not say \"%s\"", text, words);
    g_free(text);
}

static void a_pattern_nobody_calibrated_is_refused(struct room *room, gconstpointer data)
{
    assert_says(refusal(room, LIGHTSTAGE__MODEL__LINEAR, FULL_CR, LS_ERR_STATE),
                "uncalibrated for segment-R-00");
    assert_says(refusal(room, LIGHTSTAGE__MODEL__HEADLIGHT, FULL_CR, LS_ERR_STATE),
                "for R it offers model sphere, model separated");
}

static void a_refusal_names_the_plan_kind_and_what_is_offered(struct room *room, gconstpointer data)
{
    assert_says(refusal(room, LIGHTSTAGE__MODEL__MEASURED, FULL_CR, LS_ERR_NOT_FOUND),
                "kind \"each\" makes them); for R it offers model sphere, model headlight, model "
                "separated, model linear");
    assert_says(refusal(room, LIGHTSTAGE__MODEL__SPHERE, FULL_CG, LS_ERR_NOT_FOUND),
                "kind \"sphere\"");
    for (size_t m = 0; m < MODELS; m++)
        assert_says(refusal(room, models[m], FULL_CV, LS_ERR_UNSUPPORTED),
                    "is a polariser: it is photographed, never promoted; for V it offers model "
                    "measured");
}

static void a_map_that_finds_no_room_is_an_error(void)
{
    struct ls_map_file map = {0};
    struct ls_diag diag = {0};
    g_assert_cmpint(ls_map_file_create(&map, g_get_tmp_dir(), (size_t)1 << 60, 0, &diag), ==,
                    LS_ERR_FULL);
    g_assert_nonnull(strstr(diag.text, "no room"));
    g_assert_null(map.base);
    g_assert_cmpint(ls_map_file_create(&map, g_get_tmp_dir(), 10000, UINT64_C(1) << 60, &diag), ==,
                    LS_ERR_FULL);
    g_assert_nonnull(strstr(diag.text, "stay reserved"));
    g_assert_null(map.base);
    g_assert_cmpint(ls_map_file_create(&map, g_get_tmp_dir(), 10000, 0, &diag), ==, LS_OK);
    ((char *)map.base)[9999] = 1;
    ls_map_file_finish(&map);
}

#define TEST(name, options, function) \
    g_test_add("/models/" name, struct room, options, room_enter, function, room_leave)

int main(int argc, char **argv)
{
    static const struct full_take_options spheres = {.sphere_factors_only = true};
    g_test_init(&argc, &argv, NULL);
    TEST("a-cancelled-request-makes-no-more-maps", NULL, a_cancelled_request_makes_no_more_maps);
    TEST("a-pattern-nobody-calibrated-is-refused", &spheres,
         a_pattern_nobody_calibrated_is_refused);
    TEST("a-refusal-names-the-plan-kind-and-what-is-offered", NULL,
         a_refusal_names_the_plan_kind_and_what_is_offered);
    g_test_add_func("/models/a-map-that-finds-no-room-is-an-error",
                    a_map_that_finds_no_room_is_an_error);
    return g_test_run();
}
