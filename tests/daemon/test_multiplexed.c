/* multiplexed: a take whose lights were photographed many at a time serves each of them, relights
 * and promotes as one photographed light by light does. */
#include "core/multiplex.h"
#include "daemon/light_set.h"
#include "daemon/render.h"
#include "tests/daemon/full_take.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static const struct ls_demosaic_region whole = {0, 0, FULL_W, FULL_H};
enum { VALUES = 3 * FULL_PIXELS };

struct room {
    struct full_take *single_take, *take;
    struct ls_field_source *single, *source;
};

static struct ls_field_source *open_source(const struct full_take *take)
{
    struct ls_field_source *source = NULL;
    struct ls_diag diag = {0};
    enum ls_err err = ls_field_source_open(take->root, take->id, 0, &source, &diag);
    g_assert_cmpstr(diag.text, ==, "");
    g_assert_cmpint(err, ==, LS_OK);
    return source;
}

static void enter(struct room *room, gconstpointer data)
{
    struct full_take_options options = {.multiplexed = true};
    if (data)
        options = *(const struct full_take_options *)data;
    room->take = make_full_take(&options);
    room->source = open_source(room->take);
    options.multiplexed = false;
    room->single_take = make_full_take(&options);
    room->single = open_source(room->single_take);
}

static void leave(struct room *room, gconstpointer data)
{
    ls_field_source_close(room->source);
    ls_field_source_close(room->single);
    full_take_free(room->take);
    full_take_free(room->single_take);
}

static float *rendered(struct ls_field_source *source, uint32_t channel, Lightstage__Model model,
                       const double *w, double max_error, bool mosaic,
                       struct ls_render_report *report)
{
    const struct ls_render_term term = {.channel = channel, .weights = w, .target = -1};
    const struct ls_render_job job = {.promotion = {.model = model},
                                      .terms = &term,
                                      .n_terms = 1,
                                      .n_pictures = 1,
                                      .region = whole,
                                      .mosaic = mosaic,
                                      .max_error = max_error};
    struct ls_render *render = NULL;
    struct ls_diag diag = {0};
    struct ls_demosaic_region band;
    float *out = g_new0(float, VALUES), *pixels = NULL;
    enum ls_err err = ls_render_open(source, &job, &render, &diag);
    g_assert_cmpstr(diag.text, ==, "");
    g_assert_cmpint(err, ==, LS_OK);
    for (bool done = false; !done; free(pixels)) {
        g_assert_cmpint(ls_render_step(render, &band, &pixels, &done, &diag), ==, LS_OK);
        memcpy(out + (size_t)band.y * band.width * 3, pixels,
               (size_t)band.width * band.height * 3 * sizeof *out);
    }
    if (report)
        ls_render_report(render, report);
    ls_render_close(render);
    return out;
}

static double largest(const float *v)
{
    double most = 0;
    for (int j = 0; j < VALUES; j++)
        most = fmax(most, fabs((double)v[j]));
    return most;
}

/* Root mean square and worst difference, of the largest value. */
static void compare(const float *a, const float *b, double *rms, double *worst)
{
    double most = largest(b);
    *rms = *worst = 0;
    for (int j = 0; j < VALUES; j++) {
        double d = fabs((double)a[j] - (double)b[j]) / most;
        *rms += d * d / VALUES;
        *worst = fmax(*worst, d);
    }
    *rms = sqrt(*rms);
}

/*
 * Stored rows are halves: each is off by up to 2^-11 of itself, 1.6e-4 as root mean square. A light
 * decoded weighs 19 rows by 1/10 of its own, of half the light of eighteen lights each: 1.6e-4 x
 * 0.1 x sqrt(19) x 9.5 lights = 6.6e-4 of a light, which demosaicing may raise by half. Wrong rows,
 * or the factor of the mean for all of them, are off by more than 1 %.
 */
static void assert_same(const char *what, float *got, float *expected, double rms_most,
                        double worst_most)
{
    double rms, worst;
    compare(got, expected, &rms, &worst);
    g_test_message("%s: %.2g rms, %.2g at worst", what, rms, worst);
    g_assert_cmpfloat(rms, <, rms_most);
    g_assert_cmpfloat(worst, <, worst_most);
    g_free(got);
    g_free(expected);
}

static void every_light_is_the_one_photographed_alone(struct room *room, gconstpointer data)
{
    for (int i = 0; i < FULL_LIGHTS; i += 3) {
        double w[FULL_LIGHTS] = {0};
        w[i] = 1;
        for (int mosaic = 0; mosaic < 2; mosaic++)
            assert_same(
                mosaic ? "mosaic" : "rgb",
                rendered(room->source, FULL_CW, LIGHTSTAGE__MODEL__MEASURED, w, 0, mosaic, NULL),
                rendered(room->single, FULL_CW, LIGHTSTAGE__MODEL__MEASURED, w, 0, mosaic, NULL),
                7e-4, 5e-3);
    }
}

static void relighting_is_that_of_lights_photographed_alone(struct room *room, gconstpointer data)
{
    double w[FULL_LIGHTS];
    for (int i = 0; i < FULL_LIGHTS; i++)
        w[i] = g_test_rand_double_range(0, 2);
    assert_same("white",
                rendered(room->source, FULL_CW, LIGHTSTAGE__MODEL__MEASURED, w, 0, false, NULL),
                rendered(room->single, FULL_CW, LIGHTSTAGE__MODEL__MEASURED, w, 0, false, NULL),
                4e-4, 3e-3);
    /* red too, by its sphere, its head light and its segments over white */
    static const Lightstage__Model models[] = {
        LIGHTSTAGE__MODEL__SPHERE, LIGHTSTAGE__MODEL__HEADLIGHT, LIGHTSTAGE__MODEL__LINEAR};
    for (size_t m = 0; m < G_N_ELEMENTS(models); m++)
        assert_same("red", rendered(room->source, FULL_CR, models[m], w, 0, false, NULL),
                    rendered(room->single, FULL_CR, models[m], w, 0, false, NULL), 8e-4, 0.01);
}

static void a_bound_holds_for_what_is_left_out(struct room *room, gconstpointer data)
{
    double w[FULL_LIGHTS] = {[5] = 1};
    struct ls_render_report report;
    float *exact =
        rendered(room->source, FULL_CW, LIGHTSTAGE__MODEL__MEASURED, w, 0, false, &report);
    g_assert_cmpuint(report.tiles_skipped, ==, 0); /* one light is every picture */
    double allowed = largest(exact);
    float *bounded =
        rendered(room->source, FULL_CW, LIGHTSTAGE__MODEL__MEASURED, w, allowed, false, &report);
    double rms, worst;
    compare(bounded, exact, &rms, &worst);
    g_test_message("%u tiles left out, bound %.3g of %.3g, worst %.3g",
                   (unsigned)report.tiles_skipped, report.error_bound, allowed,
                   worst * largest(exact));
    g_assert_cmpuint(report.tiles_skipped, >, 0);
    g_assert_cmpfloat(report.error_bound, <=, allowed);
    g_assert_cmpfloat(worst * largest(exact), <=, report.error_bound * (1 + 1e-5));
    g_free(exact);
    g_free(bounded);
}

static void a_spare_column_that_is_dark_is_no_alarm(struct room *room, gconstpointer data)
{
    const struct ls_multiplex_spare *spare = room->source->set[FULL_CW].group[0].spare;
    struct ls_render_report report;
    double w[FULL_LIGHTS] = {1};
    g_free(rendered(room->source, FULL_CW, LIGHTSTAGE__MODEL__MEASURED, w, 0, false, &report));
    g_assert_nonnull(spare);
    g_test_message("the spare column reads %.2g +- %.2g", spare->mean, spare->sigma);
    g_assert_false(spare->alarm);
    g_assert_cmpuint(report.spectra[0].multiplexed, ==, FULL_ORDER);
    g_assert_false(report.spectra[0].spare_alarm);
}

static void light_that_came_after_the_darks_is_an_alarm(struct room *room, gconstpointer data)
{
    struct ls_render_report report;
    double w[FULL_LIGHTS] = {1};
    g_free(rendered(room->source, FULL_CR, LIGHTSTAGE__MODEL__SPHERE, w, 0, false, &report));
    g_test_message("%.1f sigma", report.spectra[0].spare_deviation);
    g_assert_true(report.spectra[0].spare_alarm);
    g_assert_cmpfloat(report.spectra[0].spare_deviation, >, 5);
}

/* Weights of both signs: V itself says little of the noise in it. Shot noise with every light alike
 * against the sum over pictures, for all lights and for three. */
static void shot_noise_is_that_of_the_pictures(struct room *room, gconstpointer data)
{
    const struct ls_light_set *set = &room->source->white;
    float row[FULL_ORDER];
    for (int some = 0; some < 2; some++) {
        double w[FULL_LIGHTS] = {0}, v = 0, variance = 0;
        for (int i = 0; i < (some ? 3 : FULL_LIGHTS); i++)
            w[i] = 1;
        g_assert_cmpint(ls_light_set_row(set, w, FULL_LIGHTS, -1, row, NULL), ==, LS_OK);
        for (int j = 0; j < FULL_ORDER; j++)
            for (int p = 0; p < FULL_PIXELS; p += 97) {
                double m = (double)room->take->row[j][p];
                v += (double)row[j] * m;
                variance += (double)row[j] * (double)row[j] * m;
            }
        double c = ls_light_set_shot(set, w, FULL_LIGHTS, row);
        g_test_message("%s: %.3g, pictures %.3g", some ? "three" : "all", c, variance / v);
        /* lights differ by a quarter from their mean over the picture */
        g_assert_cmpfloat(fabs(c / (variance / v) - 1), <, 0.25);
    }
}

/* ---- refusals ---- */

static char *refusal(struct ls_field_source *source, Lightstage__Model model, uint32_t channel,
                     enum ls_err want)
{
    const struct ls_promotion promotion = {.model = model};
    struct ls_diag diag = {0};
    struct ls_way way;
    g_assert_cmpint(ls_promotion_find(source, &promotion, channel, NULL, &way, &diag), ==, want);
    g_test_message("%s", diag.text);
    return g_strdup(diag.text);
}

static void assert_says(char *text, const char *words)
{
    if (!strstr(text, words))
        g_error("\"%s\" does not say \"%s\"", text, words);
    g_free(text);
}

static void rows_nobody_calibrated_are_refused(struct room *room, gconstpointer data)
{
    assert_says(refusal(room->source, LIGHTSTAGE__MODEL__MEASURED, FULL_CW, LS_ERR_STATE),
                "uncalibrated for the multiplexed pictures of W");
    assert_says(refusal(room->source, LIGHTSTAGE__MODEL__SPHERE, FULL_CR, LS_ERR_STATE),
                "pattern multiplex");
}

static void a_row_that_is_missing_is_refused(struct room *room, gconstpointer data)
{
    struct ls_picture *row = &room->source->white.pictures[7];
    row->tiles = room->source->no_tiles;
    assert_says(refusal(room->source, LIGHTSTAGE__MODEL__MEASURED, FULL_CW, LS_ERR_STATE),
                "has 18 of 19 multiplexed pictures of W");
    assert_says(refusal(room->source, LIGHTSTAGE__MODEL__SPHERE, FULL_CR, LS_ERR_STATE),
                "resume the take");
    g_assert_false(ls_light_set_has(room->source, &room->source->white, 3));
}

#define TEST(name, options, function) \
    g_test_add("/multiplexed/" name, struct room, options, enter, function, leave)

int main(int argc, char **argv)
{
    static const struct full_take_options mono = {.multiplexed = true, .mono = true};
    static const struct full_take_options lit = {.multiplexed = true, .ambient = 0.02f};
    static const struct full_take_options spheres = {.multiplexed = true,
                                                     .sphere_factors_only = true};
    g_test_init(&argc, &argv, NULL);
    TEST("every-light-is-the-one-photographed-alone", NULL,
         every_light_is_the_one_photographed_alone);
    TEST("every-light-of-a-mono-camera-is-the-one-photographed-alone", &mono,
         every_light_is_the_one_photographed_alone);
    TEST("relighting-is-that-of-lights-photographed-alone", NULL,
         relighting_is_that_of_lights_photographed_alone);
    TEST("relighting-of-a-mono-camera-is-that-of-lights-photographed-alone", &mono,
         relighting_is_that_of_lights_photographed_alone);
    TEST("a-bound-holds-for-what-is-left-out", NULL, a_bound_holds_for_what_is_left_out);
    TEST("a-spare-column-that-is-dark-is-no-alarm", NULL, a_spare_column_that_is_dark_is_no_alarm);
    TEST("light-that-came-after-the-darks-is-an-alarm", &lit,
         light_that_came_after_the_darks_is_an_alarm);
    TEST("shot-noise-is-that-of-the-pictures", NULL, shot_noise_is_that_of_the_pictures);
    TEST("rows-nobody-calibrated-are-refused", &spheres, rows_nobody_calibrated_are_refused);
    TEST("a-row-that-is-missing-is-refused", NULL, a_row_that_is_missing_is_refused);
    return g_test_run();
}
