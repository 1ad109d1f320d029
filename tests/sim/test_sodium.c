/* The opening example of LeGendre, Yu and Debevec: a blue-green patch under sodium light, by LEDs
 * and by three colours, each against its own theory. */
#include "tests/sim/measured_spectra.h"
#include "tests/sim/paper_models.h"

#include <math.h>
#include <string.h>

enum { PATCH = 0 };

/* a Lambertian facing the camera, reflectance @rho, under light i of spectrum @led, strength 1 */
static double lambertian(const struct stage *stage, int light, const struct ls_spectrum *led,
                         const struct ls_spectrum *rho, int c)
{
    return fmax(0, (double)stage->directions[light][2]) / M_PI *
           ls_spectrum_dot3(led, rho, &stage->sensitivity[c]);
}

/* what the environment's first lobe weighs in camera channel c, per radiance */
static double environment_reads(const struct stage *stage, int c)
{
    return 2 * stage->lobe[0].radiance *
           ls_spectrum_dot(&stage->lobe[0].spectrum, &stage->sensitivity[c]);
}

/* The patch in the place of the chart's first, the rest of the chart beside it, all matte and
 * facing the camera; behind either polariser half of the white. */
static void photograph(struct stage *stage, const struct ls_spectrum led[SPECTRA],
                       const struct ls_spectrum *rho)
{
    stage->field = g_new0(samples_of, LIGHTS);
    for (int i = 0; i < LIGHTS; i++)
        for (int s = 0; s < CHANNELS; s++)
            for (int p = 0; p < SAMPLES; p++)
                for (int c = 0; c < 3; c++) {
                    const struct ls_spectrum *shown =
                        p == PATCH || p >= CHART ? rho : &stage->reflectance[p];
                    double r = lambertian(stage, i, &led[s < SPECTRA ? s : 0], shown, c);
                    stage->field[i][s][p][c] = (float)(s < SPECTRA ? r : r / 2);
                }
}

/* Photographed in halves behind a Bayer mosaic by LEDs that spread; promoted by Eq. 1 from full
 * spheres; relit under constant sodium light by the strengths of the solve, and by three colours.
 */
static void relight_patch(struct stage *stage, const struct ls_spectrum led[SPECTRA],
                          const struct ls_spectrum *rho, double ours[3], double tristimulus[3])
{
    g_autofree double *alpha = stage_strengths(stage, SHARED);
    g_autofree double *w = g_new0(double, SPECTRA *LIGHTS), *rgb = g_new0(double, 3 * LIGHTS);
    double out[SAMPLES][3];
    photograph(stage, led, rho);
    struct paper_take *take = paper_take_new(stage, false);
    for (int i = 0; i < LIGHTS; i++) {
        double sr = (stage->cells[2 * i] + stage->cells[2 * i + 1]) / (2 * stage->lobe[0].radiance);
        for (int s = 0; s < SPECTRA; s++)
            w[s * LIGHTS + i] = alpha[i * SPECTRA + s];
        for (int c = 0; c < 3; c++)
            rgb[c * LIGHTS + i] = sr * environment_reads(stage, c);
    }
    paper_take_promote(take, SPHERE);
    paper_take_relight(take, w, out);
    memcpy(ours, out[PATCH], sizeof out[PATCH]);
    paper_take_tristimulus(take, rgb, out);
    memcpy(tristimulus, out[PATCH], sizeof out[PATCH]);
    paper_take_finish(take);
}

/* the strength of one LED alone that fits the chart after M: <L, P> / <L, L> */
static double lone_strength(const struct stage *stage, const struct ls_spectrum *led)
{
    double lp = 0, ll = 0;
    for (int p = 0; p < CHART; p++) {
        double l[3], n[3], raw_l[3], raw_n[3];
        for (int c = 0; c < 3; c++) {
            raw_l[c] = ls_spectrum_dot3(led, &stage->reflectance[p], &stage->sensitivity[c]);
            raw_n[c] = ls_spectrum_dot3(&stage->lobe[0].spectrum, &stage->reflectance[p],
                                        &stage->sensitivity[c]);
        }
        apply_m(stage->m, raw_l, l);
        apply_m(stage->m, raw_n, n);
        for (int c = 0; c < 3; c++)
            lp += l[c] * n[c], ll += l[c] * l[c];
    }
    return lp / ll;
}

/** What theory says of a patch under sodium, in camera RGB. */
struct sodium {
    double truth[3], product[3], amber[3], white;
};

/*
 * For constant radiance N(l) and a Lambertian rho(l) through a camera S_c(l):
 *   truth        integral N rho S_c, for a line at l0: rho(l0) S_c(l0), sodium's own colour
 *   tristimulus  integral N S_c x integral W rho S_c / integral W S_c: the patch's colour under
 *                white times sodium's
 *   ours         amber is the one LED near 590 nm, so no other is lit and its strength is the
 *                projection of the chart under N on the chart under A: a integral A rho S_c
 */
static struct sodium theory(const struct stage *stage, const struct ls_spectrum led[SPECTRA],
                            const struct ls_spectrum *rho)
{
    struct sodium t = {.white = 0};
    const struct ls_spectrum *n = &stage->lobe[0].spectrum;
    for (int c = 0; c < 3; c++) {
        const struct ls_spectrum *s = &stage->sensitivity[c];
        t.truth[c] = ls_spectrum_dot3(n, rho, s);
        t.product[c] =
            ls_spectrum_dot(n, s) * ls_spectrum_dot3(&led[0], rho, s) / ls_spectrum_dot(&led[0], s);
        t.amber[c] = lone_strength(stage, &led[2]) * ls_spectrum_dot3(&led[2], rho, s);
        t.white = fmax(t.white, ls_spectrum_dot(n, s));
    }
    return t;
}

static void check_sodium(const struct sodium *t, const double ours[3], const double tristimulus[3])
{
    double ours_off = 0, tristimulus_off = 0;
    g_test_message("camera RGB: truth %.4f %.4f %.4f, white square %.3f", t->truth[0], t->truth[1],
                   t->truth[2], t->white);
    g_test_message("ours %.4f %.4f %.4f, theory %.4f %.4f %.4f", ours[0], ours[1], ours[2],
                   t->amber[0], t->amber[1], t->amber[2]);
    g_test_message("tristimulus %.4f %.4f %.4f, theory %.4f %.4f %.4f", tristimulus[0],
                   tristimulus[1], tristimulus[2], t->product[0], t->product[1], t->product[2]);
    for (int c = 0; c < 3; c++) {
        /* 346 lights in the place of a constant: 1 %; halves and the demosaic: a permille */
        g_assert_cmpfloat_with_epsilon(ours[c], t->amber[c], 0.03 * t->amber[0]);
        g_assert_cmpfloat_with_epsilon(tristimulus[c], t->product[c], 0.03 * t->product[1]);
        ours_off = fmax(ours_off, fabs(ours[c] - t->truth[c]) / t->white);
        tristimulus_off = fmax(tristimulus_off, fabs(tristimulus[c] - t->truth[c]) / t->white);
    }
    g_test_message("off the truth, in %% of the white square: ours %.2f, tristimulus %.2f",
                   100 * ours_off, 100 * tristimulus_off);
    /* an LED of 17 nm is not a line: of a steep reflectance it sees the flank too */
    g_assert_cmpfloat(ours_off, <, 0.03);
    g_assert_cmpfloat(tristimulus_off, >, 0.03);
    /* sodium's own hue, which this camera sees as R > G >> B; and green */
    g_assert_true(ours[0] > ours[1] && ours[1] > ours[2]);
    g_assert_true(t->truth[0] > t->truth[1] && t->truth[1] > t->truth[2]);
    g_assert_true(tristimulus[1] > tristimulus[0] && tristimulus[1] > tristimulus[2]);
}

static void test_a_blue_green_patch_under_sodium_is_yellow(void)
{
    char *folder = measured_spectra_folder();
    struct ls_spectra *illuminants = measured_table("illuminants/nist_traditional.csv");
    struct ls_spectra *objects = measured_table("reflectances/vrhel_objects.csv");
    if (folder && illuminants && objects) {
        struct stage *stage = stage_new(folder);
        struct ls_spectrum led[SPECTRA];
        const struct ls_spectrum *rho = &objects->item[49].spectrum; /* the most blue-green */
        double ours[3], tristimulus[3];
        stage_light_up(stage, illuminants, "LPS", "LPS", 0);
        for (int s = 0; s < SPECTRA; s++)
            read_row(&stage->cal->channels[s].spectrum, 0, &led[s]);
        relight_patch(stage, led, rho, ours, tristimulus);
        struct sodium t = theory(stage, led, rho);
        check_sodium(&t, ours, tristimulus);
        stage_finish(stage);
    }
    ls_spectra_destroy(objects);
    ls_spectra_destroy(illuminants);
    measured_spectra_remove(folder);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/paper/a-blue-green-patch-under-sodium-is-yellow-and-tristimulus-green",
                    test_a_blue_green_patch_under_sodium_is_yellow);
    return g_test_run();
}
