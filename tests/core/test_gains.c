/* Photometric stereo on a simulated grey sphere: gains, directions and factors against what the
 * simulator drew. */
#include "core/vec3.h"
#include "tests/core/grey_bench.h"

#include <glib.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

static double off_by(const struct grey_bench *b, const struct ls_grey *m, uint32_t i)
{
    return m->gains[0].k[i] * sim_scene_gain(b->rig->scene, i, 0) - 1;
}

/* Mean error of the lights that are not flagged: what the normalisation is off by. */
static double common_error(const struct grey_bench *b, const struct ls_grey *m)
{
    double sum = 0;
    uint32_t n = 0;
    for (uint32_t i = 0; i < m->n_lights; i++)
        if (!m->flags[i]) {
            sum += off_by(b, m, i);
            n++;
        }
    return sum / n;
}

struct gains_case {
    uint32_t cameras;
    double spread, misplaced_deg;
    const char *cfa;
    uint64_t seed;
};

/* Returns how many of the *n lights without a flag are within their own sigma. */
static double check_gains(const struct grey_bench *b, const struct ls_grey *m,
                          const struct gains_case *g, uint32_t *n)
{
    const struct ls_gains *gains = &m->gains[0];
    double common = common_error(b, m), worst = 0, worst_sided = 0, square = 0, within = 0;
    *n = 0;
    for (uint32_t i = 0; i < m->n_lights; i++) {
        double off = off_by(b, m, i), sigma = gains->sigma_k[i] / gains->k[i];
        if (m->flags[i]) {
            worst_sided = fmax(worst_sided, fabs(off));
            continue;
        }
        ++*n;
        worst = fmax(worst, fabs(off));
        square += off * off;
        /* the part of the error that is every light's own */
        within += fabs(off - common) < sqrt(sigma * sigma - gains->sigma_mean * gains->sigma_mean);
    }
    g_test_message("%u lights: k worst %.4f %%, rms %.4f %%, common %.4f +- %.4f %%, %.1f %% "
                   "within 1 sigma; %u one-sided: worst %.2f %%; chi2 %.2f",
                   *n, 100 * worst, 100 * sqrt(square / *n), 100 * common, 100 * gains->sigma_mean,
                   100 * within / *n, m->n_lights - *n, 100 * worst_sided, gains->chi2);
    /* what core/gains.h says of these rigs; 0.5 % is the calibration's promise */
    static const double stated[] = {0.0048, 0.0027, 0.0017, 0.0014};
    g_assert_cmpfloat(worst, <, stated[g->cameras - 1]);
    /* lights that nobody sees are off by what they were drawn: 3.5 sigma is one in 2000 */
    g_assert_cmpfloat(worst_sided, <, 3.5 * g->spread);
    g_assert_cmpfloat(fabs(common), <, 3 * gains->sigma_mean);
    g_assert_true((*n == m->n_lights) == (g->cameras > 2));   /* two leave a gap behind them */
    for (uint32_t k = 0; k < m->n_lights * m->n_colours; k++) /* one in 150000 by chance */
        g_assert_true(gains->colour[k] == 1);
    return within;
}

static void check_directions(const struct grey_bench *b, const struct ls_grey *m)
{
    double worst = 0, square = 0, z2 = 0;
    uint32_t n = 0;
    for (uint32_t i = 0; i < m->n_lights; i++) {
        double truth[3], off[3], sigma = m->sigma_direction_deg[i];
        if (m->flags[i])
            continue;
        grey_rig_position(b->rig, i, truth);
        ls_unit3(truth);
        ls_along3(m->direction[i], truth, -1, off);
        double deg = 2 * asin(0.5 * ls_length3(off)) * 180 / M_PI;
        g_assert_cmpfloat(sigma, >, 0);
        worst = fmax(worst, deg);
        square += deg * deg;
        z2 += deg * deg / (2 * sigma * sigma);
        n++;
    }
    g_test_message("%u directions: worst %.3f, rms %.3f degrees, error over sigma %.2f", n, worst,
                   sqrt(square / n), sqrt(z2 / n));
    g_assert_cmpfloat(worst, <, 0.1); /* core/grey_sphere.h; 0.5 is the calibration's promise */
    /* honest: the rms of n > 200 pairs over sigma lies within 15 % of 1, plus what the sphere's own
     * place may add */
    g_assert_cmpfloat(sqrt(z2 / n), <, 1.3);
    g_assert_cmpfloat(sqrt(z2 / n), >, 0.7);
}

static void check_factors(const struct grey_bench *b, const struct ls_grey *m)
{
    const double truth[2] = {grey_bench_sphere_factor(b, 0), grey_bench_group_factor(b, 0)};
    g_assert_cmpuint(m->n_factors, ==, 2);
    for (uint32_t k = 0; k < 2; k++) {
        const struct ls_grey_factor *f = &m->factors[k];
        bool full = strcmp(f->pattern, "sphere") == 0;
        double t = truth[!full];
        g_test_message("%s: %.5f +- %.5f, truth %.5f, of %u pictures", f->pattern, f->value.factor,
                       f->value.sigma, t, f->pictures);
        g_assert_cmpuint(f->pictures, ==, m->n_cameras * (full ? 1 : GREY_GROUPS));
        /* core/grey_sphere.h; 0.5 % is the promise */
        g_assert_cmpfloat(fabs(f->value.factor / t - 1), <, full ? 0.001 : 0.0002);
        /* 4.5 sigma is one in 150000; merged pictures may be off by 0.01 % of a sum, at the edges
         * of the exposures' ranges, and two of those are compared */
        g_assert_cmpfloat(fabs(f->value.factor - t), <, 4.5 * f->value.sigma + 2e-4 * t);
    }
}

/* Within one sigma, 68 +- 7 % over lights and seeds. */
static void run_cases(const struct gains_case *cases, size_t n_cases)
{
    uint32_t n = 0, all = 0;
    double within = 0;
    for (const struct gains_case *g = cases; g < cases + n_cases; g++) {
        struct grey_rig_options o = {"grey", g->seed, g->spread, g->cameras, "W", 96, g->cfa, 1};
        struct grey_bench *b = grey_bench_new(&o);
        b->misplaced_deg = g->misplaced_deg;
        struct ls_grey *m = grey_bench_measure(b);
        g_test_message("%u cameras, %s, spread %g %%, lights %g degrees off", g->cameras, g->cfa,
                       100 * g->spread, g->misplaced_deg);
        g_assert_true(m->settled.moved == (g->misplaced_deg > 0));
        within += check_gains(b, m, g, &n);
        all += n;
        check_directions(b, m);
        check_factors(b, m);
        ls_grey_destroy(m);
        grey_bench_free(b);
    }
    g_test_message("%.1f %% of %u within 1 sigma", 100 * within / all, all);
    g_assert_cmpfloat(fabs(within / all - 0.68), <, 0.07);
}

/* One rig of each kind: another one takes no other way through the code. */
static bool brief(void)
{
    return g_getenv("LS_TEST_BRIEF") != NULL;
}

static void test_one_camera(void)
{
    static const struct gains_case few[] = {{1, 0.05, 0, "RG", 11}, {1, 0.10, 0, "RG", 12}};
    run_cases(few, brief() ? 1 : G_N_ELEMENTS(few));
}

static void test_four_cameras(void)
{
    if (brief()) {
        g_test_skip("tinted lights are seen by three cameras: unset LS_TEST_BRIEF");
        return;
    }
    static const struct gains_case few[] = {{4, 0.05, 0, "RG", 52}, {4, 0.10, 0, "mono", 53}};
    run_cases(few, G_N_ELEMENTS(few));
}

static void test_misplaced(void)
{
    static const struct gains_case few[] = {{1, 0.05, 0.5, "RG", 14}};
    run_cases(few, G_N_ELEMENTS(few));
}

static void test_many(void)
{
    if (!g_getenv("LS_TEST_FULL")) {
        g_test_skip("twenty rigs: set LS_TEST_FULL=1");
        return;
    }
    struct gains_case cases[20];
    for (uint64_t k = 0; k < 4; k++) {
        cases[5 * k] = (struct gains_case){1, 0.10, 0, "mono", 20 + k};
        cases[5 * k + 1] = (struct gains_case){2, 0.05, 0, "RG", 30 + k};
        cases[5 * k + 2] = (struct gains_case){3, 0.10, 0.3, "RG", 40 + k};
        cases[5 * k + 3] = (struct gains_case){4, 0.05, 0, "RG", 50 + k};
        cases[5 * k + 4] = (struct gains_case){1, 0.05, 0.9, "RG", 60 + k};
    }
    run_cases(cases, G_N_ELEMENTS(cases));
}

/* ---- colours ---- */

/* Every fourth light is 2 % off in one colour, up or down. */
static void draw_tint(double (*tint)[3], uint32_t n)
{
    for (uint32_t i = 0; i < n; i++)
        for (uint32_t c = 0; c < 3; c++) {
            bool off = i % 4 == 0 && i / 4 % 3 == c;
            tint[i][c] = off ? (i / 12 % 2 ? 1.02 : 0.98) : 1;
        }
}

/* Largest errors of what calibrated lights are in each colour, with the factors and without; what
 * is common to a colour belongs to p(s,c). Returns how many factors there are. */
static uint32_t judge_colours(const struct grey_bench *b, const struct ls_grey *m,
                              const double (*tint)[3], double worst[2])
{
    uint32_t n = 0, n_factors = 0;
    double common[3] = {0};
    worst[0] = worst[1] = 0;
    for (int pass = 0; pass < 2; pass++)
        for (uint32_t i = 0; i < b->rig->n_lights; i++) {
            double plain = 1 + off_by(b, m, i);
            for (uint32_t c = 0; c < 3 && !m->flags[i]; c++) {
                double factor = m->gains[0].colour[3 * i + c];
                common[c] += pass ? 0 : log(plain * factor * tint[i][c]);
                n += !pass && c == 0;
                n_factors += pass && factor != 1;
                double off = log(plain * tint[i][c]) - common[c] / n;
                worst[1] = fmax(worst[1], pass ? fabs(off) : 0);
                worst[0] = fmax(worst[0], pass ? fabs(off + log(factor)) : 0);
            }
        }
    g_test_message("%u lights: off by %.3f %% with %u factors, by %.3f %% without; chi2 %.2f", n,
                   100 * worst[0], n_factors, 100 * worst[1], m->gains[0].chi2);
    return n_factors;
}

static uint32_t measure_colours(uint32_t cameras, uint64_t seed, bool tinted, double worst[2])
{
    struct grey_rig_options o = {"grey", seed, 0.05, cameras, "W", 96, "RG", 1};
    struct grey_bench *b = grey_bench_new(&o);
    double(*tint)[3] = g_malloc0_n(b->rig->n_lights, sizeof *tint);
    draw_tint(tint, b->rig->n_lights);
    for (uint32_t i = 0; i < b->rig->n_lights && !tinted; i++)
        tint[i][0] = tint[i][1] = tint[i][2] = 1;
    b->tint = (const double(*)[3])tint;
    struct ls_grey *m = grey_bench_measure(b);
    uint32_t n = judge_colours(b, m, b->tint, worst);
    ls_grey_destroy(m);
    grey_bench_free(b);
    g_free(tint);
    return n;
}

static void test_colours(void)
{
    double worst[2];
    g_assert_cmpuint(measure_colours(3, 71, true, worst), >, 0);
    g_assert_cmpfloat(worst[0], <, 0.005); /* the calibration's promise */
    g_assert_cmpfloat(worst[1], >, 0.012); /* two thirds of 2 %: k takes one */
}

/* One in 150000 is 4.5 errors off by chance: of a thousand, none. */
static void test_no_colours(void)
{
    double worst[2];
    g_assert_cmpuint(measure_colours(2, 82, false, worst), ==, 0);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/gains/directions-and-factors-come-back-with-one-camera", test_one_camera);
    g_test_add_func("/gains/directions-and-factors-come-back-with-four-cameras", test_four_cameras);
    g_test_add_func("/gains/come-back-though-the-lights-stand-elsewhere", test_misplaced);
    g_test_add_func("/gains/of-lights-that-differ-in-colour-come-back-in-every-colour",
                    test_colours);
    g_test_add_func("/gains/of-lights-of-one-colour-have-no-factors", test_no_colours);
    g_test_add_func("/gains/of-twenty-rigs-come-back-with-honest-errors", test_many);
    return g_test_run();
}
