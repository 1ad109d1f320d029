/* models: what the daemon makes of a take by each model of promotion is what core makes of its
 * pictures, called directly on the whole of them. */
#include "core/half.h"
#include "core/linear.h"
#include "core/promote.h"
#include "core/relight.h"
#include "core/separated.h"
#include "daemon/crew.h"
#include "daemon/map_file.h"
#include "daemon/render.h"
#include "proto/models.h"
#include "tests/daemon/full_take.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static const struct ls_demosaic_region whole = {0, 0, FULL_W, FULL_H};
enum { VALUES = 3 * FULL_PIXELS };

struct room {
    struct full_take *take;
    struct ls_field_source *source;
};

static void enter(struct room *room, gconstpointer data)
{
    static const struct full_take_options plain;
    struct ls_diag diag = {0};
    room->take = make_full_take(data ? data : &plain);
    enum ls_err err =
        ls_field_source_open(room->take->root, room->take->id, 0, &room->source, &diag);
    g_assert_cmpstr(diag.text, ==, "");
    g_assert_cmpint(err, ==, LS_OK);
}

static void leave(struct room *room, gconstpointer data)
{
    ls_field_source_close(room->source);
    full_take_free(room->take);
}

static const Lightstage__Model models[] = {LIGHTSTAGE__MODEL__SPHERE, LIGHTSTAGE__MODEL__HEADLIGHT,
                                           LIGHTSTAGE__MODEL__SEPARATED, LIGHTSTAGE__MODEL__LINEAR};

/* ---- asking ---- */

static void fill_weights(double w[FULL_LIGHTS])
{
    for (int i = 0; i < FULL_LIGHTS; i++)
        w[i] = g_test_rand_double_range(-0.5, 2);
}

/* [pictures][rows][columns][3] of a region; bands are put together. */
static float *rendered(struct room *room, const struct ls_render_job *job)
{
    struct ls_render *render = NULL;
    struct ls_diag diag = {0};
    struct ls_demosaic_region band;
    size_t n = (size_t)job->region.width * job->region.height * 3;
    float *out = g_new0(float, n * job->n_pictures), *pixels = NULL;
    enum ls_err err = ls_render_open(room->source, job, &render, &diag);
    g_assert_cmpstr(diag.text, ==, "");
    g_assert_cmpint(err, ==, LS_OK);
    for (bool done = false; !done; free(pixels)) {
        g_assert_cmpint(ls_render_step(render, &band, &pixels, &done, &diag), ==, LS_OK);
        size_t some = (size_t)band.width * band.height * 3;
        for (uint32_t k = 0; k < job->n_pictures; k++)
            memcpy(out + n * k + (size_t)(band.y - job->region.y) * band.width * 3,
                   pixels + some * k, some * sizeof *out);
    }
    ls_render_close(render);
    return out;
}

static float *red_by(struct room *room, Lightstage__Model model, const double *w)
{
    const struct ls_render_term term = {.channel = FULL_CR, .weights = w, .target = -1};
    const struct ls_render_job job = {.promotion = {.model = model},
                                      .terms = &term,
                                      .n_terms = 1,
                                      .n_pictures = 1,
                                      .region = whole};
    return rendered(room, &job);
}

/* ---- expected, from the fixture's own numbers ---- */

/* Sum over lights of w k E of a channel, [pixels] of the mosaic. */
static void add_lights(const struct full_take *take, int channel, const double *w, float *mosaic)
{
    for (int p = 0; p < FULL_PIXELS; p++) {
        double sum = (double)mosaic[p];
        for (int i = 0; i < FULL_LIGHTS; i++)
            sum += w[i] * take->k[channel][i] * (double)take->light[channel][i][p];
        mosaic[p] = (float)sum;
    }
}

static float *demosaiced(const struct room *room, const float *mosaic)
{
    float *rgb = g_new0(float, VALUES);
    g_assert_cmpint(ls_relight_demosaic(&room->source->field, mosaic, whole, whole, rgb), ==,
                    LS_OK);
    return rgb;
}

static float *summed(const struct room *room, int channel, const double *w)
{
    float *mosaic = g_new0(float, FULL_PIXELS);
    add_lights(room->take, channel, w, mosaic);
    float *rgb = demosaiced(room, mosaic);
    g_free(mosaic);
    return rgb;
}

static float *scaled(const struct room *room, const float *picture, const char *pattern)
{
    float *mosaic = g_new(float, FULL_PIXELS);
    for (int p = 0; p < FULL_PIXELS; p++)
        mosaic[p] = (float)((double)picture[p] * full_take_factor(pattern));
    float *rgb = demosaiced(room, mosaic);
    g_free(mosaic);
    return rgb;
}

/* g(i,R) for the lights of which @of says so, else 0. */
static void strengths(const struct full_take *take, bool (*of)(int i, int q), int q,
                      double g[FULL_LIGHTS])
{
    for (int i = 0; i < FULL_LIGHTS; i++)
        g[i] = of(i, q) ? 1 / take->k[FULL_CR][i] : 0;
}

static bool every(int i, int q)
{
    return true;
}

static bool of_head(int i, int q)
{
    return i < FULL_HEAD;
}

static bool of_segment(int i, int q)
{
    return i % FULL_SEGMENTS == q;
}

static void row_of(const struct full_take *take, const double *g, float row[FULL_LIGHTS])
{
    for (int i = 0; i < FULL_LIGHTS; i++)
        row[i] = (float)(g[i] * take->k[FULL_CW][i]);
}

/* The stable ratio of core, over the whole picture; @f is used up. */
static float *ratio_of(const struct room *room, float *f, float *v, const float *row, size_t n_row)
{
    const struct ls_field *field = &room->source->field;
    float *sigma = g_new(float, VALUES), *ratio = g_new(float, VALUES);
    double neutral[3];
    for (int c = 0; c < 3; c++)
        neutral[c] = field->p[3 + c] / field->p[c]; /* R is spectrum 1 */
    ls_promote_sigma(field, row, n_row, v, VALUES, sigma);
    ls_promote_add_contrast(v, FULL_W, FULL_H, 3, sigma);
    g_assert_cmpint(ls_promote_ratio(f, v, sigma, FULL_W, FULL_H, 3, neutral, ratio, NULL), ==,
                    LS_OK);
    g_free(sigma);
    g_free(f);
    return ratio;
}

/* Sums of twelve values of at most about 1, in float here and there: 1e-6 of each; ratios and
 * matrices are below 3. */
static void assert_close(const struct room *room, const float *got, const float *expected)
{
    double most = 0;
    for (int j = 0; j < VALUES; j++)
        most = fmax(most, fabs((double)expected[j]));
    for (int j = 0; j < VALUES; j++)
        if (!(fabs((double)got[j] - (double)expected[j]) <= 1e-4 * most))
            g_error("value %d (row %d) is %g, expected %g", j, j / (3 * FULL_W), (double)got[j],
                    (double)expected[j]);
}

/* @white[p] x @ratio[p] x scale. */
static void assert_white_times(const struct room *room, const float *got, const double *w,
                               float *ratio)
{
    float *expected = summed(room, FULL_CW, w);
    for (int j = 0; j < VALUES; j++)
        expected[j] = (float)(room->take->scale * (double)expected[j] * (double)ratio[j]);
    assert_close(room, got, expected);
    g_free(expected);
    g_free(ratio);
}

/* ---- one model after the other ---- */

static void sphere_is_core_s_ratio_of_the_full_sphere(struct room *room, gconstpointer data)
{
    double w[FULL_LIGHTS], g[FULL_LIGHTS];
    float row[FULL_LIGHTS];
    fill_weights(w);
    strengths(room->take, every, 0, g);
    row_of(room->take, g, row);
    float *v = summed(room, FULL_CW, g), *got = red_by(room, LIGHTSTAGE__MODEL__SPHERE, w);
    assert_white_times(
        room, got, w,
        ratio_of(room, scaled(room, room->take->sphere[FULL_CR], "sphere"), v, row, FULL_LIGHTS));
    g_free(v);
    g_free(got);
}

static void headlight_is_core_s_ratio_of_the_head_light(struct room *room, gconstpointer data)
{
    double w[FULL_LIGHTS], g[FULL_LIGHTS];
    float row[FULL_LIGHTS];
    fill_weights(w);
    strengths(room->take, of_head, 0, g);
    row_of(room->take, g, row);
    float *v = summed(room, FULL_CW, g), *got = red_by(room, LIGHTSTAGE__MODEL__HEADLIGHT, w);
    assert_white_times(
        room, got, w,
        ratio_of(room, scaled(room, room->take->head, "headlight"), v, row, FULL_LIGHTS));
    g_free(v);
    g_free(got);
}

static void paper_divides_by_the_photographed_white_sphere(struct room *room, gconstpointer data)
{
    double w[FULL_LIGHTS];
    const float row = (float)full_take_factor("sphere");
    fill_weights(w);
    float *v = scaled(room, room->take->sphere[FULL_CW], "sphere");
    const struct ls_render_term term = {.channel = FULL_CR, .weights = w, .target = -1};
    const struct ls_render_job job = {.promotion = {.model = LIGHTSTAGE__MODEL__SPHERE,
                                                    .reference = LIGHTSTAGE__REFERENCE__PAPER},
                                      .terms = &term,
                                      .n_terms = 1,
                                      .n_pictures = 1,
                                      .region = whole};
    float *got = rendered(room, &job);
    assert_white_times(
        room, got, w,
        ratio_of(room, scaled(room, room->take->sphere[FULL_CR], "sphere"), v, &row, 1));
    g_free(v);
    g_free(got);
}

static void measured_is_the_pictures_of_that_channel(struct room *room, gconstpointer data)
{
    double w[FULL_LIGHTS];
    fill_weights(w);
    const struct ls_render_term term = {.channel = FULL_CV, .weights = w, .target = -1};
    const struct ls_render_job job = {
        .terms = &term, .n_terms = 1, .n_pictures = 1, .region = whole};
    float *got = rendered(room, &job), *expected = summed(room, FULL_CV, w);
    for (int j = 0; j < VALUES; j++)
        expected[j] = (float)(room->take->scale * (double)expected[j]);
    assert_close(room, got, expected);
    g_free(got);
    g_free(expected);
}

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

static struct ls_linear_noise noise_of(const struct ls_field_noise *noise, const float *row,
                                       size_t n)
{
    double squares = 0, sum = 0, most = 0;
    for (size_t i = 0; i < n; i++) {
        squares += (double)row[i] * (double)row[i];
        sum += (double)row[i];
        most = fmax(most, (double)row[i]);
    }
    return (struct ls_linear_noise){
        noise->read_variance * squares + noise->dark_variance * sum * sum, noise->shot * most};
}

static float *matrices(const struct room *room)
{
    const struct ls_field *field = &room->source->field;
    float *v[FULL_SEGMENTS], *f[FULL_SEGMENTS], row[FULL_LIGHTS];
    float *m = g_new(float, 3 * VALUES);
    struct ls_linear_noise v_noise[FULL_SEGMENTS], f_noise[FULL_SEGMENTS];
    const float factor = (float)full_take_factor("segments-3");
    double g[FULL_LIGHTS];
    for (int q = 0; q < FULL_SEGMENTS; q++) {
        strengths(room->take, of_segment, q, g);
        row_of(room->take, g, row);
        v_noise[q] = noise_of(&field->noise, row, FULL_LIGHTS);
        f_noise[q] = noise_of(&field->noise, &factor, 1);
        v[q] = summed(room, FULL_CW, g);
        f[q] = scaled(room, room->take->segment[q], "segments-3");
    }
    strengths(room->take, every, 0, g);
    row_of(room->take, g, row);
    const struct ls_linear_pictures pictures = {.width = FULL_W,
                                                .height = FULL_H,
                                                .n_segments = FULL_SEGMENTS,
                                                .n_in = 3,
                                                .n_out = 3,
                                                .v = (const float *const *)v,
                                                .f = (const float *const *)f,
                                                .v_noise = v_noise,
                                                .f_noise = f_noise,
                                                .total_noise =
                                                    noise_of(&field->noise, row, FULL_LIGHTS),
                                                .p_in = field->p,
                                                .p_out = field->p + 3,
                                                .inputs = {0, 1, 2},
                                                .demosaiced = true};
    struct ls_linear_options options;
    ls_linear_options_default(&options);
    g_assert_cmpint(ls_linear_fit(&pictures, &options, 0, FULL_H, m, NULL), ==, LS_OK);
    for (int q = 0; q < FULL_SEGMENTS; q++) {
        g_free(v[q]);
        g_free(f[q]);
    }
    return m;
}

static void linear_is_core_s_matrices_after_demosaicing(struct room *room, gconstpointer data)
{
    double w[FULL_LIGHTS];
    fill_weights(w);
    float *m = matrices(room), *v = summed(room, FULL_CW, w), *expected = g_new(float, VALUES);
    float *got = red_by(room, LIGHTSTAGE__MODEL__LINEAR, w);
    ls_linear_apply(m, v, FULL_PIXELS, 3, 3, expected);
    for (int j = 0; j < VALUES; j++)
        expected[j] = (float)(room->take->scale * (double)expected[j]);
    assert_close(room, got, expected);
    g_free(m);
    g_free(v);
    g_free(expected);
    g_free(got);
}

/* Core's separated field, made of the source's pictures and the fixture's numbers. */
static struct ls_separated_field separated(const struct room *room,
                                           struct ls_split split[FULL_LIGHTS])
{
    const struct ls_field *field = &room->source->field;
    const struct full_take *take = room->take;
    double white[3];
    for (int i = 0; i < FULL_LIGHTS; i++) {
        struct ls_polarisation a;
        struct ls_polarisation_path path = {.camera = {0.1f, 0.05f, 3}, .camera_up = {0, 1, 0}};
        for (int x = 0; x < 3; x++)
            path.light[x] = (double)take->calibration->position_m[i][x];
        g_assert_cmpint(ls_polarisation_assume(&path, &a, NULL), ==, LS_OK);
        g_assert_cmpint(ls_split_make(a, take->k[FULL_CV][i], take->k[FULL_CH][i], &split[i], NULL),
                        ==, LS_OK);
    }
    struct ls_separated_field out = {.n_lights = FULL_LIGHTS,
                                     .n_channels = 3,
                                     .width = FULL_W,
                                     .height = FULL_H,
                                     .cfa = field->cfa,
                                     .v = room->source->set[FULL_CV].pictures,
                                     .h = room->source->set[FULL_CH].pictures,
                                     .split = split,
                                     .noise = field->noise};
    for (int c = 0; c < 3; c++)
        white[c] =
            (double)take->calibration->p[FULL_CV][c] + (double)take->calibration->p[FULL_CH][c];
    g_assert_cmpint(ls_conductor_make(white, LS_CONDUCTOR_THRESHOLD, false, &out.conductor, NULL),
                    ==, LS_OK);
    return out;
}

static void separated_is_core_s_sums_and_remainder(struct room *room, gconstpointer data)
{
    double w[FULL_LIGHTS], g[FULL_LIGHTS], tint[3];
    float rows[2][FULL_LIGHTS], noise[2 * FULL_LIGHTS];
    struct ls_split split[FULL_LIGHTS];
    const struct ls_separated_field field = separated(room, split);
    float *d = g_new(float, 2 * VALUES), *s = g_new(float, 2 * VALUES);
    float *c = g_new(float, 2 * VALUES), *expected = g_new0(float, VALUES);
    fill_weights(w);
    strengths(room->take, every, 0, g);
    for (int i = 0; i < FULL_LIGHTS; i++) {
        rows[0][i] = (float)w[i];
        rows[1][i] = (float)g[i];
        noise[i] = (float)g[i] * split[i].d_v;
        noise[FULL_LIGHTS + i] = (float)g[i] * split[i].d_h;
    }
    for (int t = 0; t < 3; t++)
        tint[t] = room->source->field.p[3 + t] / ((double)room->take->calibration->p[FULL_CV][t] +
                                                  (double)room->take->calibration->p[FULL_CH][t]);
    const struct ls_separated_job job = {&field, 2, rows[0], whole, LS_DEMOSAIC_GRADIENT};
    g_assert_cmpint(ls_separated_accumulate(&job, d, s, c, NULL, NULL), ==, LS_OK);
    float *f = scaled(room, room->take->sphere[FULL_CR], "sphere");
    ls_separate_remainder(f, d + VALUES, s + VALUES, c + VALUES, tint, FULL_PIXELS, 3, f,
                          d + VALUES);
    float *ratio = ratio_of(room, f, d + VALUES, noise, 2 * FULL_LIGHTS);
    ls_separated_finish(d, s, c, ratio, tint, room->take->scale, FULL_PIXELS, 3, expected);
    float *got = red_by(room, LIGHTSTAGE__MODEL__SEPARATED, w);
    assert_close(room, got, expected);
    g_free(d);
    g_free(s);
    g_free(c);
    g_free(ratio);
    g_free(expected);
    g_free(got);
}

/* ---- of every model ---- */

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

static void all_lights_of_a_colour_camera_make_the_sphere(struct room *room, gconstpointer data)
{
    /* of the pixel's brightest channel: halves of the sphere, of segments and of single lights,
     * rounded to 5e-4 each, which demosaicing carries into the other channels */
    all_lights_make_the_photographed_sphere(room, LIGHTSTAGE__MODEL__SPHERE, 2e-3);
    all_lights_make_the_photographed_sphere(room, LIGHTSTAGE__MODEL__SEPARATED, 2e-3);
    all_lights_make_the_photographed_sphere(room, LIGHTSTAGE__MODEL__LINEAR, 2e-3);
}

static void all_lights_of_a_mono_camera_make_the_sphere(struct room *room, gconstpointer data)
{
    const struct full_take_options *options = data;
    const struct ls_promotion linear = {.model = LIGHTSTAGE__MODEL__LINEAR};
    struct ls_way way;
    g_assert_cmpint(ls_promotion_find(room->source, &linear, FULL_CR, NULL, &way, NULL), ==, LS_OK);
    g_assert_cmpint(way.kind, ==, options->mono_two ? LS_WAY_MATRIX : LS_WAY_BLEND);
    g_assert_cmpuint(way.map->depth, ==, options->mono_two ? 2 : FULL_SEGMENTS);
    all_lights_make_the_photographed_sphere(room, LIGHTSTAGE__MODEL__SPHERE, 2e-3);
    all_lights_make_the_photographed_sphere(room, LIGHTSTAGE__MODEL__SEPARATED, 2e-3);
    all_lights_make_the_photographed_sphere(room, LIGHTSTAGE__MODEL__LINEAR, 2e-3);
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
    for (size_t m = 0; m < G_N_ELEMENTS(models); m++) {
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

/* Two pictures at once, in every number of threads: the same bits. */
static void threads_do_not_show_by_any_model(struct room *room, gconstpointer data)
{
    struct ls_render_term terms[4];
    double w[4][FULL_LIGHTS];
    fill_terms(terms, w);
    for (size_t m = 0; m < G_N_ELEMENTS(models); m++) {
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
    for (size_t m = 0; m < G_N_ELEMENTS(models); m++) {
        float *a = red_by(room, models[m], w);
        g_free(red_by(&again, models[G_N_ELEMENTS(models) - 1 - m], w));
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
    enum { ASKERS = 2 * G_N_ELEMENTS(models) };
    struct room fresh = {.take = room->take};
    struct asker askers[ASKERS];
    GThread *threads[ASKERS];
    double w[FULL_LIGHTS];
    fill_weights(w);
    g_assert_cmpint(ls_field_source_open(room->take->root, room->take->id, 0, &fresh.source, NULL),
                    ==, LS_OK);
    for (int t = 0; t < ASKERS; t++) {
        askers[t] = (struct asker){&fresh, models[(size_t)t % G_N_ELEMENTS(models)], w};
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
    float *picture[G_N_ELEMENTS(models)];
    w[7] = 1;
    for (size_t m = 0; m < G_N_ELEMENTS(models); m++)
        picture[m] = red_by(room, models[m], w);
    for (size_t a = 0; a < G_N_ELEMENTS(models); a++)
        for (size_t b = 0; b < a; b++) {
            double square = 0, total = 0;
            for (int j = 0; j < VALUES; j++) {
                square += pow((double)picture[a][j] - (double)picture[b][j], 2);
                total += pow((double)picture[a][j], 2);
            }
            g_assert_cmpfloat(square, >, 1e-6 * total); /* a thousandth apart */
        }
    for (size_t m = 0; m < G_N_ELEMENTS(models); m++)
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
    all_lights_make_the_photographed_sphere(room, LIGHTSTAGE__MODEL__SEPARATED, 2e-3);
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

/* ---- refusals ---- */

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
    for (size_t m = 0; m < G_N_ELEMENTS(models); m++)
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
    g_assert_cmpint(ls_map_file_create(&map, g_get_tmp_dir(), 10000, 0, &diag), ==, LS_OK);
    ((char *)map.base)[9999] = 1;
    ls_map_file_finish(&map);
}

#define TEST(name, options, function) \
    g_test_add("/models/" name, struct room, options, enter, function, leave)

int main(int argc, char **argv)
{
    static const struct full_take_options mono = {.mono = true},
                                          polarised = {.polarised_only = true};
    static const struct full_take_options two = {.mono = true, .mono_two = true};
    static const struct full_take_options spheres = {.sphere_factors_only = true};
    static const struct full_take_options some = {.some_red = true};
    g_test_init(&argc, &argv, NULL);
    TEST("sphere-is-core-s-ratio-of-the-full-sphere", NULL,
         sphere_is_core_s_ratio_of_the_full_sphere);
    TEST("headlight-is-core-s-ratio-of-the-head-light", NULL,
         headlight_is_core_s_ratio_of_the_head_light);
    TEST("paper-divides-by-the-photographed-white-sphere", NULL,
         paper_divides_by_the_photographed_white_sphere);
    TEST("measured-is-the-pictures-of-that-channel", NULL,
         measured_is_the_pictures_of_that_channel);
    TEST("a-cancelled-request-makes-no-more-maps", NULL, a_cancelled_request_makes_no_more_maps);
    TEST("linear-is-core-s-matrices-after-demosaicing", NULL,
         linear_is_core_s_matrices_after_demosaicing);
    TEST("separated-is-core-s-sums-and-remainder", NULL, separated_is_core_s_sums_and_remainder);
    TEST("all-lights-of-a-colour-camera-make-the-sphere", NULL,
         all_lights_of_a_colour_camera_make_the_sphere);
    TEST("all-lights-of-a-mono-camera-make-the-sphere", &mono,
         all_lights_of_a_mono_camera_make_the_sphere);
    TEST("all-lights-of-a-mono-camera-with-two-spectra-make-the-sphere", &two,
         all_lights_of_a_mono_camera_make_the_sphere);
    TEST("a-region-is-the-crop-of-the-whole-by-every-model", NULL,
         a_region_is_the_crop_of_the_whole_by_every_model);
    TEST("a-region-of-a-mono-camera-is-the-crop-of-the-whole-by-every-model", &mono,
         a_region_is_the_crop_of_the_whole_by_every_model);
    TEST("a-region-of-a-mono-camera-with-two-spectra-is-the-crop-of-the-whole", &two,
         a_region_is_the_crop_of_the_whole_by_every_model);
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
    TEST("a-pattern-nobody-calibrated-is-refused", &spheres,
         a_pattern_nobody_calibrated_is_refused);
    TEST("a-refusal-names-the-plan-kind-and-what-is-offered", NULL,
         a_refusal_names_the_plan_kind_and_what_is_offered);
    g_test_add_func("/models/a-map-that-finds-no-room-is-an-error",
                    a_map_that_finds_no_room_is_an_error);
    return g_test_run();
}
