/* models: what the daemon makes of a take by each model of promotion is what core makes of its
 * pictures, called directly on the whole of them. */
#include "core/linear.h"
#include "core/promote.h"
#include "core/relight.h"
#include "core/separated.h"
#include "daemon/separation.h"
#include "tests/daemon/model_room.h"

#include <math.h>

static bool of_head(int i, int q)
{
    return i < FULL_HEAD;
}

static bool of_segment(int i, int q)
{
    return i % FULL_SEGMENTS == q;
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
                                                .n_lights = FULL_LIGHTS,
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
    const struct ls_linear_part whole_part = {.width = FULL_W, .height = FULL_H, .out = m};
    g_assert_cmpint(ls_linear_fit(&pictures, &options, &whole_part, NULL), ==, LS_OK);
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
        if (take->calibration->n_polarised > 0) {
            const struct ls_calibration *cal = take->calibration;
            a = (struct ls_polarisation){(double)cal->a_v[i], (double)cal->a_h[i]};
        }
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

/* To the bit; half of the lights are a twentieth away from what would be assumed. */
static void the_calibration_s_polarisation_splits_the_lights(struct room *room, gconstpointer data)
{
    struct ls_separation found;
    struct ls_split split[FULL_LIGHTS];
    struct ls_diag diag = {0};
    int apart = 0;
    separated(room, split);
    g_assert_cmpint(ls_separation_init(&found, room->source, false, false, &diag), ==, LS_OK);
    g_assert_cmpmem(found.split, sizeof split, split, sizeof split);
    struct ls_calibration *cal = room->source->facts->calibration;
    ls_separation_finish(&found);
    cal->n_polarised = 0;
    g_assert_cmpint(ls_separation_init(&found, room->source, false, false, &diag), ==, LS_OK);
    for (int i = 0; i < FULL_LIGHTS; i++)
        apart += fabsf(found.split[i].s_v / split[i].s_v - 1) > 0.05f;
    ls_separation_finish(&found);
    g_test_message("%d of %d lights are apart", apart, FULL_LIGHTS);
    g_assert_cmpint(apart, >=, FULL_LIGHTS / 2);
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

#define TEST(name, options, function) \
    g_test_add("/models/" name, struct room, options, room_enter, function, room_leave)

int main(int argc, char **argv)
{
    static const struct full_take_options polarised = {.polarisation = true};
    g_test_init(&argc, &argv, NULL);
    TEST("sphere-is-core-s-ratio-of-the-full-sphere", NULL,
         sphere_is_core_s_ratio_of_the_full_sphere);
    TEST("headlight-is-core-s-ratio-of-the-head-light", NULL,
         headlight_is_core_s_ratio_of_the_head_light);
    TEST("paper-divides-by-the-photographed-white-sphere", NULL,
         paper_divides_by_the_photographed_white_sphere);
    TEST("measured-is-the-pictures-of-that-channel", NULL,
         measured_is_the_pictures_of_that_channel);
    TEST("linear-is-core-s-matrices-after-demosaicing", NULL,
         linear_is_core_s_matrices_after_demosaicing);
    TEST("the-calibration-s-polarisation-splits-the-lights", &polarised,
         the_calibration_s_polarisation_splits_the_lights);
    TEST("separated-goes-by-the-calibration-s-polarisation", &polarised,
         separated_is_core_s_sums_and_remainder);
    TEST("separated-is-core-s-sums-and-remainder", NULL, separated_is_core_s_sums_and_remainder);
    return g_test_run();
}
