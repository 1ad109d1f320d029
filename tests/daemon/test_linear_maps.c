/* linear maps: fitted by any number of threads, given up when nobody wants them, held against
 * single lights. */
#include "core/mono_blend.h"
#include "core/relight.h"
#include "core/segments.h"
#include "daemon/fetch_job.h"
#include "daemon/field_cache.h"
#include "daemon/field_segments.h"
#include "daemon/linear_maps.h"
#include "daemon/map_file.h"
#include "daemon/promotion.h"
#include "tests/daemon/full_take.h"

#include <math.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>

static const struct ls_demosaic_region whole = {0, 0, FULL_W, FULL_H};
static const struct ls_promotion linear = {.model = LIGHTSTAGE__MODEL__LINEAR};

struct room {
    struct full_take *take;
    struct ls_field_source *source;
};

static void enter(struct room *room, gconstpointer data)
{
    struct ls_diag diag = {0};
    room->take = make_full_take(data);
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

static struct ls_way way_to_red(const struct room *room)
{
    struct ls_way way;
    struct ls_diag diag = {0};
    enum ls_err err = ls_promotion_find(room->source, &linear, FULL_CR, NULL, &way, &diag);
    g_assert_cmpstr(diag.text, ==, "");
    g_assert_cmpint(err, ==, LS_OK);
    return way;
}

/* ---- checks ---- */

/* sum over lights of w k E of a channel, demosaiced */
static float *lit(const struct room *room, int channel, const double w[FULL_LIGHTS])
{
    float *mosaic = g_new0(float, FULL_PIXELS), *out = g_new(float, 3 * FULL_PIXELS);
    for (int i = 0; i < FULL_LIGHTS; i++)
        for (int p = 0; p < FULL_PIXELS; p++)
            mosaic[p] += (float)(w[i] * room->take->k[channel][i] *
                                 (double)room->take->light[channel][i][p]);
    g_assert_cmpint(ls_relight_demosaic(&room->source->field, mosaic, whole, whole, out), ==,
                    LS_OK);
    g_free(mosaic);
    return out;
}

static float *one_light(const struct room *room, int channel, int light)
{
    double w[FULL_LIGHTS] = {0};
    w[light] = 1;
    return lit(room, channel, w);
}

/* What the map, [pixels][3 or segments], makes of white's picture of light @i. */
static double predict(const struct ls_field_map *map, const float *v, size_t p, int c, int i)
{
    double sum = 0;
    for (uint32_t a = 0; a < 3 && !map->phi; a++)
        sum += (double)map->values[p * 9 + (size_t)c * 3 + a] * (double)v[p * 3 + a];
    for (uint32_t g = 0; g < map->n_segments && map->phi; g++)
        sum += map->phi[(uint32_t)i * map->n_segments + g] *
               (double)map->values[p * map->n_segments + g] * (double)v[p];
    return sum;
}

static void a_few_single_lights_check_the_fit(struct room *room, gconstpointer data)
{
    const struct full_take_options *options = data;
    int colours = options->mono ? 1 : 3, n = options->red_lights;
    struct ls_way way = way_to_red(room);
    double square[2] = {0}, total[2] = {0}, g[FULL_LIGHTS], pixels[2] = {0};
    g_assert_cmpint(way.kind, ==, options->mono ? LS_WAY_BLEND : LS_WAY_MATRIX);
    g_assert_cmpuint(way.map->n_checked, ==, n);
    for (int i = 0; i < FULL_LIGHTS; i++)
        g[i] = 1 / room->take->k[FULL_CR][i];
    float *sphere = lit(room, FULL_CW, g);
    for (int k = 0; k < n; k++) {
        int i = 2 * k + 1;
        float *v = one_light(room, FULL_CW, i), *f = one_light(room, FULL_CR, i);
        for (size_t p = 0; p < FULL_PIXELS; p++) {
            double share = 0, all = 0;
            for (int c = 0; c < colours; c++) {
                share += g[i] * (double)v[p * (size_t)colours + (size_t)c];
                all += (double)sphere[p * (size_t)colours + (size_t)c];
            }
            bool highlight = share > 16.0 / FULL_LIGHTS * all;
            for (int c = 0; c < colours; c++) {
                double truth = (double)f[p * (size_t)colours + (size_t)c];
                double d = predict(way.map, v, p, c, i) - truth;
                for (int h = 0; h <= (int)highlight; h++) {
                    square[h] += d * d;
                    total[h] += truth * truth;
                }
            }
            pixels[highlight]++;
        }
        g_free(v);
        g_free(f);
    }
    g_free(sphere);
    double expected = sqrt(square[0] / total[0]);
    g_test_message("off by %.3f %%, highlights on %.0f px", 100 * expected, pixels[1]);
    /* sums in float, and rows in another order */
    g_assert_cmpfloat_with_epsilon(way.map->checked_error / expected, 1, 1e-3);
    g_assert_cmpfloat(expected, >, 1e-3);
    g_assert_cmpfloat(way.map->highlight_share, ==, pixels[1] / ((double)FULL_PIXELS * n));
    g_assert_cmpint(pixels[1] > 0, ==, options->glint);
    if (pixels[1] > 0) {
        double of_highlights = sqrt(square[1] / total[1]);
        g_test_message("on highlights by %.3f %%", 100 * of_highlights);
        g_assert_cmpfloat_with_epsilon(way.map->highlight_error / of_highlights, 1, 1e-3);
    }
}

/* Relative RMS error of every light's picture in red, of a mono camera. */
static double mono_error(const struct room *room, const struct ls_field_map *map)
{
    const int channel[2] = {FULL_CW, FULL_CG};
    double square = 0, total = 0;
    for (int i = 0; i < FULL_LIGHTS; i++) {
        float *v[2], *f = one_light(room, FULL_CR, i);
        for (int a = 0; a < 2; a++)
            v[a] = one_light(room, channel[a], i);
        for (size_t p = 0; p < FULL_PIXELS; p++) {
            double made = map->phi ? predict(map, v[0], p, 0, i) : 0;
            for (uint32_t a = 0; a < map->n_inputs; a++)
                made += (double)map->values[p * map->n_inputs + a] * (double)v[a][p];
            square += pow(made - (double)f[p], 2);
            total += pow((double)f[p], 2);
        }
        g_free(f);
        g_free(v[0]);
        g_free(v[1]);
    }
    return sqrt(square / total);
}

/* The take's segments are scattered over the dome, so that neither estimate is near its error; but
 * what is kept is the one with the smaller. */
static void a_second_spectrum_of_a_mono_camera_does_no_harm(struct room *room, gconstpointer data)
{
    static const struct full_take_options one_spectrum = {.mono = true};
    struct room other;
    enter(&other, &one_spectrum);
    struct ls_way two = way_to_red(room), one = way_to_red(&other);
    double with = mono_error(room, two.map), without = mono_error(&other, one.map);
    g_test_message("W alone: %.4f, estimated %.4f; W and G, %s: %.4f, estimated %.4f", without,
                   one.map->left_out_error, two.map->phi ? "a blend" : "matrices", with,
                   two.map->left_out_error);
    g_assert_cmpint(one.kind, ==, LS_WAY_BLEND);
    g_assert_cmpfloat(one.map->left_out_share, >, 0);
    g_assert_cmpfloat(two.map->left_out_error, <=, one.map->left_out_error);
    g_assert_cmpfloat(with, <=, without);
    leave(&other, NULL);
}

/* What is estimated of red by white's blend, or by the matrices of white and green. */
static double estimate_by(const struct room *room, bool blend)
{
    const struct ls_field_source *source = room->source;
    const struct ls_field *field = &source->field;
    struct ls_field_segments *segments = g_new(struct ls_field_segments, 1);
    double phi[FULL_LIGHTS * FULL_SEGMENTS], others[FULL_SEGMENTS * FULL_SEGMENTS];
    g_assert_cmpint(ls_field_segments_find(source, FULL_CR, segments, NULL), ==, LS_OK);
    g_autofree float *map = g_new0(float, (size_t)FULL_SEGMENTS *FULL_PIXELS);
    struct ls_linear_target target = {.s = (uint32_t)ls_field_source_spectrum(source, FULL_CR),
                                      .f = segments->pictures,
                                      .factor = segments->factor,
                                      .map = map,
                                      .photographed = &source->set[FULL_CR]};
    int green = ls_field_source_spectrum(source, FULL_CG);
    struct ls_linear_job job = {.field = field,
                                .n_rows = 1,
                                .n_segments = segments->n,
                                .segment = segments->segment,
                                .n_sets = blend ? 1 : 2,
                                .set = {&source->white, &source->set[FULL_CG]},
                                .p_in = {field->p[0], field->p[green]},
                                .phi = blend ? phi : NULL,
                                .others = blend ? others : NULL,
                                .n_targets = 1,
                                .targets = &target,
                                .crew = {1, NULL}};
    g_assert_cmpint(ls_mono_blend_weights(field->directions, FULL_LIGHTS, segments->segment,
                                          FULL_SEGMENTS, phi, NULL),
                    ==, LS_OK);
    ls_mono_blend_others(phi, FULL_LIGHTS, segments->segment, FULL_SEGMENTS, others);
    g_assert_cmpint(ls_linear_maps_make(&job, NULL), ==, LS_OK);
    g_free(segments);
    return ls_linear_estimate(&target.left_out);
}

static void of_two_spectra_the_way_estimated_better_is_served(struct room *room, gconstpointer data)
{
    struct ls_way way = way_to_red(room);
    double blend = estimate_by(room, true), matrix = estimate_by(room, false);
    g_test_message("a blend: estimated %.4f, matrices: %.4f", blend, matrix);
    g_assert_cmpfloat(blend, >, 0);
    g_assert_cmpfloat(matrix, >, 0);
    g_assert_cmpint(way.kind, ==, blend < matrix ? LS_WAY_BLEND : LS_WAY_MATRIX);
    g_assert_cmpfloat(way.map->left_out_error, ==, fmin(blend, matrix));
    Lightstage__SpectrumReport report;
    ls_promotion_report(room->source, &linear, &way, &report);
    g_assert_cmpint(report.blended, ==, blend < matrix);
    g_assert_cmpfloat(report.left_out_error, ==, fmin(blend, matrix));
}

/* No file may be larger than the matrices: white's and green's two floats a pixel, of which the
 * blend takes three. */
static void a_blend_that_has_no_room_leaves_the_matrices(struct room *room, gconstpointer data)
{
    const size_t pixel = FULL_PIXELS * sizeof(float);
    struct rlimit usual;
    struct ls_map_file larger = {0};
    g_assert_cmpint(getrlimit(RLIMIT_FSIZE, &usual), ==, 0);
    const struct rlimit small = {2 * pixel, usual.rlim_max};
    signal(SIGXFSZ, SIG_IGN);
    g_assert_cmpint(setrlimit(RLIMIT_FSIZE, &small), ==, 0);
    enum ls_err full = ls_map_file_create(&larger, room->source->storage, 3 * pixel, 0, NULL);
    struct ls_way way = way_to_red(room);
    g_assert_cmpint(setrlimit(RLIMIT_FSIZE, &usual), ==, 0);
    g_assert_cmpint(full, ==, LS_ERR_FULL);
    g_assert_cmpint(way.kind, ==, LS_WAY_MATRIX);
    g_assert_cmpfloat(way.map->left_out_error, ==, estimate_by(room, false));
}

static void the_report_says_what_was_checked(struct room *room, gconstpointer data)
{
    struct ls_way way = way_to_red(room);
    Lightstage__SpectrumReport report;
    ls_promotion_report(room->source, &linear, &way, &report);
    g_assert_cmpuint(report.checked_lights, ==, 3);
    g_assert_cmpfloat(report.checked_error, ==, way.map->checked_error);
    g_assert_cmpfloat(report.highlight_share, ==, way.map->highlight_share);
    g_assert_cmpfloat(report.highlight_error, ==, way.map->highlight_error);
    g_assert_cmpuint(report.segments, ==, FULL_SEGMENTS);
    g_assert_false(report.blended);
    g_assert_cmpfloat(report.left_out_error, >, 0);
    /* every fifth pixel of every fifth row */
    g_assert_cmpfloat(report.left_out_share, ==, 30.0 * 28.0 / FULL_PIXELS);
}

static void a_spectrum_under_all_lights_is_not_fitted(struct room *room, gconstpointer data)
{
    struct ls_way way = way_to_red(room);
    g_assert_cmpint(way.kind, ==, LS_WAY_PHOTOGRAPHED);
    g_assert_true(way.set == &room->source->set[FULL_CR]);
}

/* ---- threads ---- */

static float *map_by(const struct room *room, unsigned n_threads, struct ls_linear_target *target)
{
    const struct ls_field_source *source = room->source;
    struct ls_field_segments *segments = g_new(struct ls_field_segments, 1);
    g_assert_cmpint(ls_field_segments_find(source, FULL_CR, segments, NULL), ==, LS_OK);
    float *map = g_new0(float, 9 * FULL_PIXELS);
    *target = (struct ls_linear_target){.s = 1,
                                        .f = segments->pictures,
                                        .factor = segments->factor,
                                        .map = map,
                                        .photographed = &source->set[FULL_CR],
                                        .n_checks = 2,
                                        .checks = {1, 3}};
    struct ls_linear_job job = {.field = &source->field,
                                .n_rows = 1,
                                .n_segments = segments->n,
                                .segment = segments->segment,
                                .n_sets = 1,
                                .set = {&source->white},
                                .n_targets = 1,
                                .targets = target,
                                .crew = {n_threads, NULL}};
    for (int c = 0; c < 3; c++)
        job.p_in[c] = source->field.p[c];
    g_assert_cmpint(ls_linear_maps_make(&job, NULL), ==, LS_OK);
    g_free(segments);
    return map;
}

static void any_number_of_threads_gives_the_same_bits(struct room *room, gconstpointer data)
{
    struct ls_linear_target one, many;
    float *alone = map_by(room, 1, &one);
    for (unsigned n = 2; n <= 5; n++) {
        float *map = map_by(room, n, &many);
        g_assert_cmpmem(map, sizeof *map * 9 * FULL_PIXELS, alone, sizeof *map * 9 * FULL_PIXELS);
        g_assert_cmpmem(&one.left_out, sizeof one.left_out, &many.left_out, sizeof one.left_out);
        g_assert_cmpmem(&one.checked, sizeof one.checked, &many.checked, sizeof one.checked);
        g_free(map);
    }
    g_assert_cmpuint(one.checked.pixels, ==, 2 * FULL_PIXELS);
    g_free(alone);
}

/* ---- cancel ---- */

/* Any kind of map; afterwards it can be made as if nobody had asked. */
static void a_cancelled_asker_leaves_no_map(struct room *room, gconstpointer data)
{
    static const enum ls_field_map_kind kinds[] = {LS_MAP_LINEAR, LS_MAP_SPHERE, LS_MAP_SEPARATED};
    const struct ls_job asker = {.cancelled = 1};
    for (size_t k = 0; k < G_N_ELEMENTS(kinds); k++) {
        const struct ls_field_map *map;
        g_assert_cmpint(ls_field_maps_get(room->source, kinds[k], 1, &asker, &map, NULL), ==,
                        LS_ERR_ABORTED);
        g_assert_null(map->values);
        g_assert_cmpint(ls_field_maps_get(room->source, kinds[k], 1, NULL, &map, NULL), ==, LS_OK);
        g_assert_nonnull(map->values);
    }
}

static void a_cancelled_fetch_makes_no_map(struct room *room, gconstpointer data)
{
    struct ls_field_cache *cache = ls_field_cache_create(room->take->root, 1, 0);
    Lightstage__Fetch fetch = LIGHTSTAGE__FETCH__INIT;
    struct ls_job *job = NULL;
    struct ls_tiles rows = {0};
    struct ls_chunk chunk = {0};
    bool last = false;
    fetch.take = room->take->id;
    fetch.channel = (char *)"R";
    fetch.layout = LIGHTSTAGE__LAYOUT__RGB;
    fetch.model = LIGHTSTAGE__MODEL__LINEAR;
    g_assert_cmpint(ls_fetch_job_create(1, cache, &fetch, &rows, &job, NULL), ==, LS_OK);
    ls_job_cancel(job);
    g_assert_cmpint(job->ops->step(job, &chunk, &last, NULL), ==, LS_ERR_ABORTED);
    job->ops->destroy(job);
    ls_field_cache_destroy(cache);
}

#define TEST(name, options, function) \
    g_test_add("/linear-maps/" name, struct room, options, enter, function, leave)

int main(int argc, char **argv)
{
    static const struct full_take_options few = {.red_lights = 3},
                                          all = {.red_lights = FULL_LIGHTS};
    static const struct full_take_options glint = {.glint = true, .red_lights = 3};
    static const struct full_take_options mono = {.mono = true, .red_lights = 2};
    static const struct full_take_options two = {.mono = true, .mono_two = true};
    static const struct full_take_options telling = {
        .mono = true, .mono_two = true, .green_like_red = true};
    g_test_init(&argc, &argv, NULL);
    TEST("a-few-single-lights-check-the-fit", &few, a_few_single_lights_check_the_fit);
    TEST("a-highlight-has-an-error-of-its-own", &glint, a_few_single_lights_check_the_fit);
    TEST("a-few-single-lights-check-a-blend", &mono, a_few_single_lights_check_the_fit);
    TEST("a-second-spectrum-of-a-mono-camera-does-no-harm", &two,
         a_second_spectrum_of_a_mono_camera_does_no_harm);
    TEST("of-two-spectra-the-way-estimated-better-is-served", &two,
         of_two_spectra_the_way_estimated_better_is_served);
    TEST("of-two-telling-spectra-the-way-estimated-better-is-served", &telling,
         of_two_spectra_the_way_estimated_better_is_served);
    TEST("a-blend-that-has-no-room-leaves-the-matrices", &two,
         a_blend_that_has_no_room_leaves_the_matrices);
    TEST("the-report-says-what-was-checked", &glint, the_report_says_what_was_checked);
    TEST("a-spectrum-under-all-lights-is-not-fitted", &all,
         a_spectrum_under_all_lights_is_not_fitted);
    TEST("any-number-of-threads-gives-the-same-bits", &few,
         any_number_of_threads_gives_the_same_bits);
    TEST("a-cancelled-asker-leaves-no-map", &few, a_cancelled_asker_leaves_no_map);
    TEST("a-cancelled-fetch-makes-no-map", &few, a_cancelled_fetch_makes_no_map);
    return g_test_run();
}
