/* coloured: lights that differ in colour come back right in every colour of the camera, and cost
 * nothing where they do not differ. */
#include "daemon/light_set.h"
#include "tests/daemon/model_room.h"

#include <math.h>
#include <string.h>

static const struct full_take_options coloured = {.coloured = true};

/* Of channel @channel under w[c] for colour c of the picture; @n 1: under w[0] for all. */
static float *lit_by(struct room *room, Lightstage__Model model, uint32_t channel,
                     double w[3][FULL_LIGHTS], uint32_t n, bool mosaic, bool k_alone)
{
    struct ls_render_term terms[3];
    for (int32_t c = 0; c < 3; c++)
        terms[c] =
            (struct ls_render_term){.channel = channel, .weights = w[c], .target = n > 1 ? c : -1};
    const struct ls_render_job job = {.promotion = {.model = model},
                                      .terms = terms,
                                      .n_terms = n,
                                      .n_pictures = 1,
                                      .region = whole,
                                      .mosaic = mosaic,
                                      .k_alone = k_alone};
    return rendered(room, &job);
}

/* ---- photographed ---- */

/* Largest error of a picture where the camera has that colour itself, so that no demosaic is
 * between, relative to the sum of all lights' magnitudes. */
static double off_by(const struct room *room, const struct full_take_options *options, int channel,
                     const double *w, const float *got)
{
    double worst = 0;
    for (int p = 0; p < FULL_PIXELS; p++) {
        double sum = 0, size = 0;
        for (int i = 0; i < FULL_LIGHTS; i++) {
            double one = w[i] * full_take_reflected(options, channel, i, p);
            sum += one;
            size += fabs(one);
        }
        double value = (double)got[3 * p + full_take_colour_at(p, options->mono)];
        worst = fmax(worst, fabs(value / room->take->scale - sum) / size);
    }
    return worst;
}

/* Stored as halves: 4.9e-4 of each light at most. */
static const double of_halves = 5e-4;

static void assert_truth(struct room *room, const struct full_take_options *options,
                         uint32_t channel, double tolerance)
{
    double w[3][FULL_LIGHTS];
    fill_weights(w[0]);
    memcpy(w[1], w[0], sizeof w[0]);
    memcpy(w[2], w[0], sizeof w[0]);
    for (uint32_t n = 1; n <= 3; n += 2) {
        float *got = lit_by(room, LIGHTSTAGE__MODEL__MEASURED, channel, w, n, false, false);
        double off = off_by(room, options, (int)channel, w[0], got);
        g_test_message("%u terms: off by %.2g", n, off);
        g_assert_cmpfloat(off, <, tolerance);
        g_free(got);
    }
    float *got = lit_by(room, LIGHTSTAGE__MODEL__MEASURED, channel, w, 1, true, false);
    g_assert_cmpfloat(off_by(room, options, (int)channel, w[0], got), <, tolerance);
    g_free(got);
}

static void lights_of_every_colour_relight_to_the_truth(struct room *room, gconstpointer data)
{
    assert_truth(room, data, FULL_CW, of_halves);
    assert_truth(room, data, FULL_CV, of_halves);
    assert_truth(room, data, FULL_CH, of_halves);
}

/* A row is rounded to halves of what nine lights give; a light is a tenth of the sum of them all,
 * so that one light's error is that of about two lights, of random sign: 2e-3 holds. */
static void multiplexed_lights_relight_to_the_truth(struct room *room, gconstpointer data)
{
    assert_truth(room, data, FULL_CW, 2e-3);
}

/* Eighteen lights, each off by up to 3 %: the sum by 3 %/sqrt 18/sqrt 3 = 0.4 % at random, and some
 * pixel by far more. */
static void k_alone_is_off(struct room *room, gconstpointer data)
{
    double w[3][FULL_LIGHTS];
    fill_weights(w[0]);
    float *got = lit_by(room, LIGHTSTAGE__MODEL__MEASURED, FULL_CW, w, 1, false, true);
    double off = off_by(room, data, FULL_CW, w[0], got);
    g_test_message("k alone: off by %.2g", off);
    g_assert_cmpfloat(off, >, 4 * of_halves);
    g_free(got);
}

/* ---- promoted ---- */

/* Under the strengths of the photographed lights in each colour, a picture is the photograph. */
static double off_photograph(struct room *room, Lightstage__Model model, int n_lights,
                             const float *picture, const char *pattern, bool k_alone)
{
    const struct full_take *take = room->take;
    double w[3][FULL_LIGHTS] = {{0}}, worst = 0;
    for (int c = 0; c < 3; c++)
        for (int i = 0; i < n_lights; i++)
            w[c][i] = 1 / (take->k[FULL_CR][i] * take->colour[FULL_CR][i][c]);
    float *f = scaled(room, picture, pattern);
    float *got = lit_by(room, model, FULL_CR, w, 3, false, k_alone);
    for (int p = 0; p < FULL_PIXELS; p++) {
        double brightest = fmax((double)f[3 * p], fmax((double)f[3 * p + 1], (double)f[3 * p + 2]));
        for (int j = 3 * p; j < 3 * p + 3; j++)
            worst = fmax(worst, fabs((double)got[j] / take->scale - (double)f[j]) / brightest);
    }
    g_test_message("model %d%s: off by %.2g", (int)model, k_alone ? ", k alone" : "", worst);
    g_free(f);
    g_free(got);
    return worst;
}

/* What divides by V is multiplied by it: roundings of sums of eighteen floats. */
static void ratios_have_v_of_every_colour(struct room *room, gconstpointer data)
{
    const struct full_take *take = room->take;
    const float *sphere = take->sphere[FULL_CR];
    g_assert_cmpfloat(
        off_photograph(room, LIGHTSTAGE__MODEL__SPHERE, FULL_LIGHTS, sphere, "sphere", false), <,
        1e-6);
    g_assert_cmpfloat(
        off_photograph(room, LIGHTSTAGE__MODEL__SPHERE, FULL_LIGHTS, sphere, "sphere", true), >,
        1e-3);
    g_assert_cmpfloat(off_photograph(room, LIGHTSTAGE__MODEL__HEADLIGHT, FULL_HEAD, take->head,
                                     "headlight", false),
                      <, 1e-6);
}

/* The segments were rounded to halves on their own, as the sphere was: by 4.9e-4 each. */
static void matrices_have_inputs_of_every_colour(struct room *room, gconstpointer data)
{
    const float *sphere = room->take->sphere[FULL_CR];
    g_assert_cmpfloat(
        off_photograph(room, LIGHTSTAGE__MODEL__LINEAR, FULL_LIGHTS, sphere, "sphere", false), <,
        1e-3);
}

/* A matrix makes a colour of R of all of white's, each under R's strengths in its own: what is off
 * the diagonal goes by strengths of another colour, here up to 6 % apart and 1.7 % at random. It
 * is a part of a picture, and an error of a mean of eighteen: half a percent was found. */
static void matrices_of_a_coloured_spectrum_are_near(struct room *room, gconstpointer data)
{
    const float *sphere = room->take->sphere[FULL_CR];
    g_assert_cmpfloat(
        off_photograph(room, LIGHTSTAGE__MODEL__LINEAR, FULL_LIGHTS, sphere, "sphere", false), <,
        0.01);
}

/* ---- without ---- */

static void factors_of_one_change_no_bit(struct room *room, gconstpointer data)
{
    static const struct full_take_options ones = {.ones = true};
    double w[3][FULL_LIGHTS];
    struct room other;
    fill_weights(w[0]);
    room_enter(&other, &ones);
    g_assert_nonnull(other.source->facts->calibration->k_colour);
    for (int m = 0; m < MODELS; m++) {
        float *a = red_by(room, models[m], w[0]), *b = red_by(&other, models[m], w[0]);
        g_assert_cmpmem(a, VALUES * sizeof *a, b, VALUES * sizeof *b);
        g_free(a);
        g_free(b);
    }
    for (uint32_t c = 0; c < FULL_CHANNELS; c++)
        g_assert_false(ls_light_set_is_coloured(&other.source->set[c]));
    room_leave(&other, &ones);
}

#define TEST(name, options, function) \
    g_test_add("/coloured/" name, struct room, options, room_enter, function, room_leave)

int main(int argc, char **argv)
{
    static const struct full_take_options mono = {.coloured = true, .mono = true};
    static const struct full_take_options white = {.white_coloured = true};
    static const struct full_take_options rows = {.coloured = true, .multiplexed = true};
    g_test_init(&argc, &argv, NULL);
    TEST("lights-relight-to-the-truth", &coloured, lights_of_every_colour_relight_to_the_truth);
    TEST("lights-of-a-mono-camera-relight-to-the-truth", &mono,
         lights_of_every_colour_relight_to_the_truth);
    TEST("multiplexed-lights-relight-to-the-truth", &rows, multiplexed_lights_relight_to_the_truth);
    TEST("k-alone-is-off", &coloured, k_alone_is_off);
    TEST("ratios-have-v-of-every-colour", &coloured, ratios_have_v_of_every_colour);
    TEST("ratios-of-multiplexed-lights-have-v-of-every-colour", &rows,
         ratios_have_v_of_every_colour);
    TEST("matrices-have-inputs-of-every-colour", &white, matrices_have_inputs_of_every_colour);
    TEST("matrices-of-a-coloured-spectrum-are-near", &coloured,
         matrices_of_a_coloured_spectrum_are_near);
    TEST("factors-of-one-change-no-bit", NULL, factors_of_one_change_no_bit);
    return g_test_run();
}
