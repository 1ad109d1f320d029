/* every model: all lights make the photographed sphere; regions, sources and threads make no
 * difference; lights and pictures that are not there are made up for. */
#include "daemon/crew.h"
#include "proto/models.h"
#include "tests/daemon/model_room.h"

#include <math.h>
#include <string.h>

/* Whatever the model, all lights at R's own strengths are what was photographed of R: as a sphere,
 * or in segments. The stable ratio is plain here but near the coat's edges, where V's contrast
 * counts as noise. */
static void all_lights_make_the_photographed_sphere(struct room *room, Lightstage__Model model,
                                                    double tolerance)
{
    double g[FULL_LIGHTS];
    bool mono = room->source->field.n_channels == 1;
    strengths(room->take, every, 0, g);
    float *f = scaled(room, room->take->sphere[FULL_CR], "sphere");
    float *got = red_by(room, model, g);
    double worst = 0;
    for (int j = 0; j < VALUES; j++) {
        const float *pixel = mono ? &f[j / 3] : &f[j / 3 * 3];
        double brightest = mono ? (double)pixel[0]
                                : fmax((double)pixel[0], fmax((double)pixel[1], (double)pixel[2]));
        double expected = room->take->scale * (double)pixel[mono ? 0 : j % 3];
        worst = fmax(worst, fabs((double)got[j] - expected) / (room->take->scale * brightest));
    }
    g_test_message("%s: off by at most %.2g", ls_model_name(model), worst);
    g_assert_cmpfloat(worst, <, tolerance);
    g_free(f);
    g_free(got);
}

/* Of the pixel's brightest channel. What divides by V is multiplied by it again: a few roundings of
 * sums of eighteen floats. The segments were rounded to halves on their own, as the sphere was: by
 * 4.9e-4 each. */
static const double of_sums = 1e-6, of_halves = 1e-3;

static void all_lights_make_the_sphere_by_every_model(struct room *room)
{
    all_lights_make_the_photographed_sphere(room, LIGHTSTAGE__MODEL__SPHERE, of_sums);
    all_lights_make_the_photographed_sphere(room, LIGHTSTAGE__MODEL__SEPARATED, of_sums);
    all_lights_make_the_photographed_sphere(room, LIGHTSTAGE__MODEL__LINEAR, of_halves);
}

static void all_lights_of_a_colour_camera_make_the_sphere(struct room *room, gconstpointer data)
{
    all_lights_make_the_sphere_by_every_model(room);
}

/* What the two spectra tell decides which way is taken; what holds does not depend on it. */
static void all_lights_of_a_mono_camera_make_the_sphere(struct room *room, gconstpointer data)
{
    const struct full_take_options *options = data;
    const struct ls_promotion linear = {.model = LIGHTSTAGE__MODEL__LINEAR};
    struct ls_way way;
    g_assert_cmpint(ls_promotion_find(room->source, &linear, FULL_CR, NULL, &way, NULL), ==, LS_OK);
    g_assert_cmpint(way.kind, ==, options->green_like_red ? LS_WAY_MATRIX : LS_WAY_BLEND);
    g_assert_cmpuint(way.map->depth, ==, way.kind == LS_WAY_MATRIX ? 2 : FULL_SEGMENTS);
    all_lights_make_the_sphere_by_every_model(room);
}

/* Shared weights, weights of one channel, and two pictures at once, in one request. */
static void fill_terms(struct ls_render_term terms[4], double w[4][FULL_LIGHTS])
{
    for (int t = 0; t < 4; t++) {
        fill_weights(w[t]);
        terms[t] = (struct ls_render_term){.channel = t == 1 ? FULL_CW : FULL_CR,
                                           .weights = w[t],
                                           .target = t == 3 ? 2 : -1,
                                           .picture = t == 2};
    }
}

static void a_region_is_the_crop_of_the_whole_by_every_model(struct room *room, gconstpointer data)
{
    static const struct ls_demosaic_region regions[] = {
        {0, 0, 1, 1}, {149, 139, 1, 1}, {63, 62, 3, 70}, {0, 64, 150, 64}, {37, 11, 50, 129}};
    struct ls_render_term terms[4];
    double w[4][FULL_LIGHTS];
    fill_terms(terms, w);
    for (size_t m = 0; m < MODELS; m++) {
        struct ls_render_job job = {.promotion = {.model = models[m]},
                                    .terms = terms,
                                    .n_terms = 4,
                                    .n_pictures = 2,
                                    .region = whole};
        float *all = rendered(room, &job);
        for (size_t k = 0; k < G_N_ELEMENTS(regions); k++) {
            const struct ls_demosaic_region *r = &job.region;
            job.region = regions[k];
            float *part = rendered(room, &job);
            for (uint32_t y = 0; y < 2 * r->height; y++) {
                uint32_t picture = y / r->height, row = r->y + y % r->height;
                g_assert_cmpmem(
                    part + (size_t)y * r->width * 3, r->width * 12,
                    all + ((size_t)picture * FULL_PIXELS + (size_t)row * FULL_W + r->x) * 3,
                    r->width * 12);
            }
            g_free(part);
        }
        g_free(all);
    }
}

/* The largest difference, over what is promoted by the most: ratios and tints stay below 3. */
static double off_by(const float *a, const float *b)
{
    double most = 0;
    for (int j = 0; j < VALUES; j++)
        most = fmax(most, fabs((double)a[j] - (double)b[j]));
    return most / 3;
}

/* Lights of a thousandth of the others' weight are left out under a hundredth of the picture. */
static void lights_that_cannot_matter_are_left_out_by_every_model(struct room *room,
                                                                  gconstpointer data)
{
    double w[FULL_LIGHTS];
    for (int i = 0; i < FULL_LIGHTS; i++)
        w[i] = i % 3 ? 1 : 1e-3;
    const struct ls_render_term term = {.channel = FULL_CR, .weights = w, .target = -1};
    for (size_t m = 0; m < MODELS; m++) {
        struct ls_render_report report;
        struct ls_render_job job = {.promotion = {.model = models[m]},
                                    .terms = &term,
                                    .n_terms = 1,
                                    .n_pictures = 1,
                                    .region = whole,
                                    .max_error = 0.1 * room->take->scale};
        float *some = rendered_with_report(room, &job, &report);
        float *all = red_by(room, models[m], w);
        g_test_message("%s: %u tiles skipped, bound %.3g of %.3g, off by %.3g",
                       ls_model_name(models[m]), (unsigned)report.tiles_skipped, report.error_bound,
                       job.max_error, off_by(some, all));
        g_assert_cmpuint(report.tiles_skipped, >=, 9); /* a light, the whole picture */
        g_assert_cmpfloat(report.error_bound, <=, job.max_error);
        g_assert_cmpfloat(report.error_bound, >, 0);
        g_assert_cmpfloat(off_by(some, all), <=, report.error_bound);
        g_free(some);
        g_free(all);
    }
}

/* Two pictures at once, in every number of threads: the same bits. */
static void threads_do_not_show_by_any_model(struct room *room, gconstpointer data)
{
    struct ls_render_term terms[4];
    double w[4][FULL_LIGHTS];
    fill_terms(terms, w);
    for (size_t m = 0; m < MODELS; m++) {
        struct ls_render_job job = {.promotion = {.model = models[m]},
                                    .terms = terms,
                                    .n_terms = 4,
                                    .n_pictures = 2,
                                    .region = {1, 3, FULL_W - 1, FULL_H - 5}};
        size_t bytes = 2 * 3 * sizeof(float) * job.region.width * job.region.height;
        float *alone = rendered(room, &job);
        for (job.n_threads = 1; job.n_threads <= LS_CREW_MAX_THREADS; job.n_threads++) {
            float *together = rendered(room, &job);
            g_assert_cmpmem(together, bytes, alone, bytes);
            g_free(together);
        }
        g_free(alone);
    }
}

/* Maps made anew, in another order, by another source: the same bits. */
static void a_source_opened_anew_gives_the_same_bits(struct room *room, gconstpointer data)
{
    double w[FULL_LIGHTS];
    struct room again = {.take = room->take};
    fill_weights(w);
    g_assert_cmpint(ls_field_source_open(room->take->root, room->take->id, 0, &again.source, NULL),
                    ==, LS_OK);
    for (size_t m = 0; m < MODELS; m++) {
        float *a = red_by(room, models[m], w);
        g_free(red_by(&again, models[MODELS - 1 - m], w));
        float *b = red_by(&again, models[m], w);
        g_assert_cmpmem(a, VALUES * sizeof *a, b, VALUES * sizeof *b);
        g_free(a);
        g_free(b);
    }
    ls_field_source_close(again.source);
}

struct asker {
    struct room *room;
    Lightstage__Model model;
    const double *w;
};

static gpointer ask(gpointer data)
{
    const struct asker *asker = data;
    return red_by(asker->room, asker->model, asker->w);
}

/* All want maps that are not there yet; each model is asked for twice. */
static void threads_that_ask_at_once_get_the_same_bits(struct room *room, gconstpointer data)
{
    enum { ASKERS = 2 * MODELS };
    struct room fresh = {.take = room->take};
    struct asker askers[ASKERS];
    GThread *threads[ASKERS];
    double w[FULL_LIGHTS];
    fill_weights(w);
    g_assert_cmpint(ls_field_source_open(room->take->root, room->take->id, 0, &fresh.source, NULL),
                    ==, LS_OK);
    for (int t = 0; t < ASKERS; t++) {
        askers[t] = (struct asker){&fresh, models[(size_t)t % MODELS], w};
        threads[t] = g_thread_new("ask", ask, &askers[t]);
    }
    for (int t = 0; t < ASKERS; t++) {
        float *got = g_thread_join(threads[t]), *alone = red_by(room, askers[t].model, w);
        g_assert_cmpmem(got, VALUES * sizeof *got, alone, VALUES * sizeof *alone);
        g_free(got);
        g_free(alone);
    }
    ls_field_source_close(fresh.source);
}

static void models_differ_where_light_depends_on_its_direction(struct room *room,
                                                               gconstpointer data)
{
    double w[FULL_LIGHTS] = {0};
    float *picture[MODELS];
    w[7] = 1;
    for (size_t m = 0; m < MODELS; m++)
        picture[m] = red_by(room, models[m], w);
    for (size_t a = 0; a < MODELS; a++)
        for (size_t b = 0; b < a; b++) {
            double square = 0, total = 0;
            for (int j = 0; j < VALUES; j++) {
                square += pow((double)picture[a][j] - (double)picture[b][j], 2);
                total += pow((double)picture[a][j], 2);
            }
            g_assert_cmpfloat(square, >, 1e-6 * total); /* a thousandth apart */
        }
    for (size_t m = 0; m < MODELS; m++)
        g_free(picture[m]);
}

static void lights_photographed_polarised_only_make_white(struct room *room, gconstpointer data)
{
    double w[FULL_LIGHTS];
    fill_weights(w);
    g_assert_true(room->source->white_is_polarised);
    const struct ls_render_term term = {.channel = FULL_CW, .weights = w, .target = -1};
    const struct ls_render_job job = {.promotion = {.model = LIGHTSTAGE__MODEL__SPHERE},
                                      .terms = &term,
                                      .n_terms = 1,
                                      .n_pictures = 1,
                                      .region = whole};
    float *got = rendered(room, &job), *mosaic = g_new0(float, FULL_PIXELS);
    add_lights(room->take, FULL_CV, w, mosaic);
    add_lights(room->take, FULL_CH, w, mosaic);
    float *expected = demosaiced(room, mosaic);
    for (int j = 0; j < VALUES; j++)
        expected[j] = (float)(room->take->scale * (double)expected[j]);
    assert_close(room, got, expected);
    all_lights_make_the_photographed_sphere(room, LIGHTSTAGE__MODEL__SEPARATED, of_sums);
    g_free(got);
    g_free(mosaic);
    g_free(expected);
}

/* Three lights of R were photographed; its segments show all. */
static void segments_serve_the_lights_of_which_there_is_no_picture(struct room *room,
                                                                   gconstpointer data)
{
    const struct ls_promotion linear = {.model = LIGHTSTAGE__MODEL__LINEAR};
    struct ls_diag diag = {0};
    struct ls_way way;
    double w[FULL_LIGHTS] = {0};
    w[FULL_LIGHTS - 1] = 1;
    enum ls_err err = ls_promotion_find(room->source, &linear, FULL_CR, NULL, &way, &diag);
    g_assert_cmpstr(diag.text, ==, "");
    g_assert_cmpint(err, ==, LS_OK);
    g_assert_cmpint(way.kind, ==, LS_WAY_MATRIX);
    g_free(red_by(room, LIGHTSTAGE__MODEL__LINEAR, w));
}

#define TEST(name, options, function) \
    g_test_add("/models/" name, struct room, options, room_enter, function, room_leave)

int main(int argc, char **argv)
{
    static const struct full_take_options mono = {.mono = true},
                                          polarised = {.polarised_only = true};
    static const struct full_take_options two = {.mono = true, .mono_two = true};
    static const struct full_take_options telling = {
        .mono = true, .mono_two = true, .green_like_red = true};
    static const struct full_take_options some = {.some_red = true};
    g_test_init(&argc, &argv, NULL);
    TEST("all-lights-of-a-colour-camera-make-the-sphere", NULL,
         all_lights_of_a_colour_camera_make_the_sphere);
    TEST("all-lights-of-a-mono-camera-make-the-sphere", &mono,
         all_lights_of_a_mono_camera_make_the_sphere);
    TEST("all-lights-of-a-mono-camera-with-two-spectra-make-the-sphere", &two,
         all_lights_of_a_mono_camera_make_the_sphere);
    TEST("all-lights-of-a-mono-camera-with-two-telling-spectra-make-the-sphere", &telling,
         all_lights_of_a_mono_camera_make_the_sphere);
    TEST("a-region-is-the-crop-of-the-whole-by-every-model", NULL,
         a_region_is_the_crop_of_the_whole_by_every_model);
    TEST("a-region-of-a-mono-camera-is-the-crop-of-the-whole-by-every-model", &mono,
         a_region_is_the_crop_of_the_whole_by_every_model);
    TEST("a-region-of-a-mono-camera-with-two-spectra-is-the-crop-of-the-whole", &two,
         a_region_is_the_crop_of_the_whole_by_every_model);
    TEST("a-region-of-a-mono-camera-with-two-telling-spectra-is-the-crop-of-the-whole", &telling,
         a_region_is_the_crop_of_the_whole_by_every_model);
    TEST("lights-that-cannot-matter-are-left-out-by-every-model", NULL,
         lights_that_cannot_matter_are_left_out_by_every_model);
    TEST("threads-do-not-show-by-any-model", NULL, threads_do_not_show_by_any_model);
    TEST("threads-of-a-mono-camera-do-not-show", &mono, threads_do_not_show_by_any_model);
    TEST("a-source-opened-anew-gives-the-same-bits", NULL,
         a_source_opened_anew_gives_the_same_bits);
    TEST("threads-that-ask-at-once-get-the-same-bits", NULL,
         threads_that_ask_at_once_get_the_same_bits);
    TEST("models-differ-where-light-depends-on-its-direction", NULL,
         models_differ_where_light_depends_on_its_direction);
    TEST("lights-photographed-polarised-only-make-white", &polarised,
         lights_photographed_polarised_only_make_white);
    TEST("segments-serve-the-lights-of-which-there-is-no-picture", &some,
         segments_serve_the_lights_of_which_there_is_no_picture);
    return g_test_run();
}
