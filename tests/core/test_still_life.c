/*
 * Promotion models on the simulated still life: 346 lights of unequal strength (5 %), R A G C B
 * promoted from what is photographed per light, against the noise-free truth.
 *
 * Fast: 64 x 64 px. LS_TEST_FULL=1: 128 x 128, and every row of the table.
 *
 * Camera and errors are those of still_life.h and still_life_study.h, in percent. Two frames per
 * picture, 0.8 % noise on white: with one the highlight error at 64 px is 0.22 of Eq. 1's in place
 * of 0.17, and what is left of it is the noise of the picture that the sum must reproduce, which no
 * model can remove.
 *
 * The requirement is on promotion, at every pixel in RGB; and, with 32 frames per picture (0.2 %),
 * on field and highlights as served: served errors hold the noise of the white field as well.
 * Through a mosaic, pictures this small are ruled by highlights narrower than the filter's period
 * (26 % by Eq. 1 without any noise): no model can tell the colour of what one photosite alone has
 * seen. Those rows are printed, and only the estimate without truth is required of them.
 */
#include "tests/core/still_life_study.h"

#include <glib.h>
#include <math.h>

static const struct still_life_inputs white_alone = {1, {0}};

static void print(const char *name, uint32_t pictures, const struct still_life_row *r)
{
    const struct still_life_errors *p = &r->promotion, *s = &r->served;
    const struct ls_linear_error *e = &r->left_out;
    double raw = e->total > 0 ? 100 * sqrt(e->difference / e->total) : NAN;
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
    const struct ls_linear_error *e = &row->left_out;
    double estimate = 100 * sqrt(e->difference / e->total),
           truth = still_life_percent(&row->served.field);
    g_assert_cmpfloat(estimate, <=, 1.5 * truth);
    g_assert_cmpfloat(truth, <=, 1.5 * estimate);
}

/* The requirement on served errors, where noise does not hide them. Of light bounced 0.4 % of noise
 * of white is as much as Eq. 1 is off by: there it need only be better. */
static void test_less_is_left_as_served(void)
{
    enum { SEED = 8 };
    const struct still_life_camera camera = {true, false, g_rand_new_with_seed(SEED), 32};
    struct still_life w;
    struct still_life_study x;
    still_life_load(&w, full() ? 128 : 64, "RG");
    still_life_study_init_with(&x, &w, &camera, false);
    g_test_message("seed %d", SEED);
    print_head("RGB at every pixel, 0.2 % noise");
    struct still_life_row eq1 = judge_and_print(&x, STILL_LIFE_LINEAR, &white_alone, 1, "RGB");
    struct still_life_row linear = judge_and_print(&x, STILL_LIFE_LINEAR, &white_alone, 14, "RGB");
    const struct still_life_errors *a = &eq1.served, *b = &linear.served;
    still_life_study_finish(&x);
    assert_estimate(&linear);
    g_assert_cmpfloat(still_life_percent(&b->field), <=, 0.4 * still_life_percent(&a->field));
    g_assert_cmpfloat(still_life_percent(&b->highlight), <=,
                      0.2 * still_life_percent(&a->highlight));
    g_assert_cmpfloat(still_life_percent(&b->inter), <, still_life_percent(&a->inter));
    still_life_free(&w);
}

static void test_segments_leave_less_than_half(void)
{
    struct still_life w;
    still_life_load(&w, full() ? 128 : 64, "RG");
    static const struct {
        bool noise, mosaic;
        const char *name;
    } cameras[] = {{true, false, "RGB at every pixel, noise"},
                   {false, false, "RGB at every pixel, no noise"},
                   {true, true, "mosaic, noise"},
                   {false, true, "mosaic, no noise"}};
    for (size_t k = 0; k < (full() ? G_N_ELEMENTS(cameras) : 2); k++) {
        struct still_life_study x;
        still_life_study_init(&x, &w, cameras[k].noise, cameras[k].mosaic, false);
        print_head(cameras[k].name);
        struct still_life_row eq1 = judge_and_print(&x, STILL_LIFE_LINEAR, &white_alone, 1, "RGB");
        static const uint32_t others[] = {6, 26};
        for (size_t j = 0; full() && j < G_N_ELEMENTS(others); j++)
            judge_and_print(&x, STILL_LIFE_LINEAR, &white_alone, others[j], "RGB");
        struct still_life_row linear =
            judge_and_print(&x, STILL_LIFE_LINEAR, &white_alone, 14, "RGB");
        still_life_study_finish(&x);
        assert_estimate(&linear);
        if (cameras[k].mosaic)
            continue;
        const struct still_life_errors *a = &eq1.promotion, *b = &linear.promotion;
        g_assert_cmpfloat(still_life_percent(&b->field), <=, 0.4 * still_life_percent(&a->field));
        g_assert_cmpfloat(still_life_percent(&b->inter), <=, 0.5 * still_life_percent(&a->inter));
        g_assert_cmpfloat(still_life_percent(&b->highlight), <=,
                          0.2 * still_life_percent(&a->highlight));
        if (!cameras[k].noise) /* noise alone is 5 % in shadows this deep */
            g_assert_cmpfloat(shadow(b), <=, 0.5 * shadow(a));
    }
    still_life_free(&w);
}

static void test_mono_blends_and_fits(void)
{
    static const struct still_life_inputs two = {2, {0, 3}}, three = {3, {0, 1, 5}};
    struct still_life w;
    struct still_life_study x;
    still_life_load(&w, full() ? 128 : 64, "mono");
    still_life_study_init(&x, &w, true, false, true);
    print_head("mono, noise");
    struct still_life_row eq1 = judge_and_print(&x, STILL_LIFE_BLEND, &white_alone, 1, "mono W");
    if (full())
        judge_and_print(&x, STILL_LIFE_BLEND, &white_alone, 6, "mono W");
    struct still_life_row blend = judge_and_print(&x, STILL_LIFE_BLEND, &white_alone, 14, "mono W");
    if (full())
        judge_and_print(&x, STILL_LIFE_BLEND, &white_alone, 26, "mono W");
    struct still_life_row linear = judge_and_print(&x, STILL_LIFE_LINEAR, &two, 14, "mono W G");
    struct still_life_row third = judge_and_print(&x, STILL_LIFE_LINEAR, &three, 14, "mono W R B");
    g_assert_cmpfloat(still_life_percent(&blend.promotion.field), <,
                      still_life_percent(&eq1.promotion.field));
    g_assert_cmpfloat(still_life_percent(&linear.promotion.field), <,
                      still_life_percent(&eq1.promotion.field));
    g_assert_cmpfloat(still_life_percent(&third.promotion.field), <,
                      still_life_percent(&linear.promotion.field));
    still_life_study_finish(&x);
    still_life_free(&w);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/still-life/fourteen-segments-leave-less-than-half-of-eq-1s-error",
                    test_segments_leave_less_than_half);
    g_test_add_func("/still-life/fourteen-segments-leave-less-as-served-too",
                    test_less_is_left_as_served);
    g_test_add_func("/still-life/mono-blends-ratios-and-fits-spectra", test_mono_blends_and_fits);
    return g_test_run();
}
