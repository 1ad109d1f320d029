/* Photometric stereo on a simulated grey sphere: strengths, gains, directions, scales against what
 * the simulator drew. */
#include "core/calibration.h"
#include "tests/core/grey_bench.h"

#include <glib.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

struct verdict {
    double worst, rms, within, common, worst_sided, within_sided;
    uint32_t n, n_sided;
};

static double off_by(const struct grey_bench *b, uint32_t channel, const struct grey_measured *m,
                     uint32_t i)
{
    return m->gains.k[i] * sim_scene_gain(b->rig->scene, i, channel) - 1;
}

/* Mean error of the lights that are not flagged: what the normalisation is off by. */
static double common_error(const struct grey_bench *b, uint32_t channel,
                           const struct grey_measured *m)
{
    double sum = 0;
    uint32_t n = 0;
    for (uint32_t i = 0; i < b->rig->n_lights; i++)
        if (!m->gains.flags[i]) {
            sum += off_by(b, channel, m, i);
            n++;
        }
    return sum / n;
}

static struct verdict judge(const struct grey_bench *b, uint32_t channel,
                            const struct grey_measured *m)
{
    struct verdict v = {.common = common_error(b, channel, m)};
    for (uint32_t i = 0; i < b->rig->n_lights; i++) {
        double off = off_by(b, channel, m, i), sigma = m->gains.sigma_k[i] / m->gains.k[i];
        if (m->gains.flags[i]) {
            v.n_sided++;
            v.worst_sided = fmax(v.worst_sided, fabs(off));
            v.within_sided += fabs(off) < sigma;
            continue;
        }
        /* the part of the error that is every light's own */
        double own = sqrt(sigma * sigma - m->gains.sigma_mean * m->gains.sigma_mean);
        v.n++;
        v.worst = fmax(v.worst, fabs(off));
        v.rms += off * off;
        v.within += fabs(off - v.common) < own;
    }
    v.rms = sqrt(v.rms / v.n);
    g_test_message("%u lights: k worst %.4f %%, rms %.4f %%, common %.4f +- %.4f %%, %.1f %% "
                   "within 1 sigma; %u one-sided: worst %.2f %%, %.0f %% within; chi2 %.2f",
                   v.n, 100 * v.worst, 100 * v.rms, 100 * v.common, 100 * m->gains.sigma_mean,
                   100 * v.within / v.n, v.n_sided, 100 * v.worst_sided,
                   v.n_sided ? 100 * v.within_sided / v.n_sided : 0, m->gains.chi2);
    return v;
}

struct gains_case {
    uint32_t cameras;
    double spread, misplaced_deg;
    const char *cfa;
    uint64_t seed;
};

static void run_case(const struct gains_case *g, uint32_t *n, double *within)
{
    struct grey_rig_options o = {"grey", g->seed, g->spread, g->cameras, "W", 96, g->cfa, 1};
    struct grey_bench *b = grey_bench_new(&o);
    struct grey_measured m;
    b->misplaced_deg = g->misplaced_deg;
    grey_measure(b, 0, &m);
    struct verdict v = judge(b, 0, &m);
    for (uint32_t k = 0; k < 3 * b->rig->n_lights; k++) /* one in 150000 by chance */
        g_assert_true(strcmp(g->cfa, "mono") == 0 || m.gains.colour[k] == 1);
    g_assert_true(b->moved == (g->misplaced_deg > 0));
    g_assert_cmpfloat(v.worst, <, 0.005); /* the calibration's promise */
    /* lights that nobody sees are off by what they were drawn: 3.5 sigma is one in 2000 */
    g_assert_cmpfloat(v.worst_sided, <, 3.5 * g->spread);
    g_assert_cmpfloat(fabs(v.common), <, 3 * m.gains.sigma_mean);
    g_assert_true((v.n_sided == 0) == (g->cameras > 2)); /* two leave a gap behind them */
    *n += v.n;
    *within += v.within;
    grey_measured_finish(&m);
    grey_bench_free(b);
}

/* Within one sigma, 68 +- 7 % over lights and seeds. */
static void run_cases(const struct gains_case *cases, size_t n_cases)
{
    uint32_t n = 0;
    double within = 0;
    for (size_t k = 0; k < n_cases; k++)
        run_case(&cases[k], &n, &within);
    g_test_message("%.1f %% of %u within 1 sigma", 100 * within / n, n);
    g_assert_cmpfloat(fabs(within / n - 0.68), <, 0.07);
}

static void test_gains(void)
{
    static const struct gains_case few[] = {{1, 0.05, 0, "RG", 11}, {4, 0.10, 0, "mono", 53}};
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
static uint32_t judge_colours(const struct grey_bench *b, const struct grey_measured *m,
                              const double (*tint)[3], double worst[2])
{
    uint32_t n = 0, n_factors = 0;
    double common[3] = {0};
    worst[0] = worst[1] = 0;
    for (int pass = 0; pass < 2; pass++)
        for (uint32_t i = 0; i < b->rig->n_lights; i++) {
            double plain = 1 + off_by(b, 0, m, i);
            for (uint32_t c = 0; c < 3 && !m->gains.flags[i]; c++) {
                double factor = m->gains.colour[3 * i + c];
                common[c] += pass ? 0 : log(plain * factor * tint[i][c]);
                n += !pass && c == 0;
                n_factors += pass && factor != 1;
                double off = log(plain * tint[i][c]) - common[c] / n;
                worst[1] = fmax(worst[1], pass ? fabs(off) : 0);
                worst[0] = fmax(worst[0], pass ? fabs(off + log(factor)) : 0);
            }
        }
    g_test_message("%u lights: off by %.3f %% with %u factors, by %.3f %% without; chi2 %.2f", n,
                   100 * worst[0], n_factors, 100 * worst[1], m->gains.chi2);
    return n_factors;
}

static uint32_t measure_colours(uint32_t cameras, uint64_t seed, bool tinted, double worst[2])
{
    struct grey_rig_options o = {"grey", seed, 0.05, cameras, "W", 96, "RG", 1};
    struct grey_bench *b = grey_bench_new(&o);
    double(*tint)[3] = g_malloc0_n(b->rig->n_lights, sizeof *tint);
    struct grey_measured m;
    draw_tint(tint, b->rig->n_lights);
    for (uint32_t i = 0; i < b->rig->n_lights && !tinted; i++)
        tint[i][0] = tint[i][1] = tint[i][2] = 1;
    b->tint = (const double(*)[3])tint;
    grey_measure(b, 0, &m);
    uint32_t n = judge_colours(b, &m, b->tint, worst);
    grey_measured_finish(&m);
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
    g_test_add_func("/gains/of-a-simulated-rig-come-back-within-half-a-percent", test_gains);
    g_test_add_func("/gains/come-back-though-the-lights-stand-elsewhere", test_misplaced);
    g_test_add_func("/gains/of-lights-that-differ-in-colour-come-back-in-every-colour",
                    test_colours);
    g_test_add_func("/gains/of-lights-of-one-colour-have-no-factors", test_no_colours);
    g_test_add_func("/gains/of-twenty-rigs-come-back-with-honest-errors", test_many);
    return g_test_run();
}
