/* Pictures of many lights at once, of the simulated still life, back to what they stand for. */
#include "core/bases.h"
#include "core/multiplex.h"
#include "sim/truth.h"
#include "tests/core/noise.h"

#include <glib.h>
#include <math.h>
#include <string.h>

enum { LIGHTS = 346, ORDER = 347, SIDE = 20, PIXELS = SIDE * SIDE };

static const double WHITE_E = 10500; /* electrons of the simulator's sensor at full scale */

/* Truth: what each light alone reads in green, e[light][pixel]. */
struct world {
    float (*directions)[3];
    float *e;
};

static void world_up(struct world *w)
{
    struct sim_scene_config config;
    struct sim_scene *scene = NULL;
    struct ls_diag diag = {{0}};
    sim_scene_config_default(&config);
    sim_view_config_default(&config.views[0], 64, 64);
    config.threads = 1;
    g_assert_cmpint(sim_scene_create(&config, &scene, &diag), ==, LS_OK);
    const struct sim_geometry *geometry = sim_scene_geometry(scene);
    const struct sim_region region = {0, 20, 24, SIDE, SIDE};
    float *field = g_new(float, SIM_MAX_CHANNELS *PIXELS * 3);
    w->directions = g_malloc(sizeof *w->directions * LIGHTS);
    w->e = g_new(float, LIGHTS *PIXELS);
    for (uint32_t i = 0; i < LIGHTS; i++) {
        memcpy(w->directions[i], geometry->direction[i], sizeof w->directions[i]);
        g_assert_cmpint(sim_truth_field(scene, &region, i, field, &diag), ==, LS_OK);
        for (int j = 0; j < PIXELS; j++)
            w->e[i * PIXELS + j] = field[3 * j + 1];
    }
    g_free(field);
    sim_scene_destroy(scene);
}

static void world_down(struct world *w)
{
    g_free(w->directions);
    g_free(w->e);
}

static double mean_of(const float *v, size_t n)
{
    double sum = 0;
    for (size_t j = 0; j < n; j++)
        sum += v[j];
    return sum / (double)n;
}

/* What a sensor reads of x: Gaussian read noise, Gaussian for shot noise too. */
static float sensed(struct noise *noise, double x, double read_variance, double shot)
{
    return (float)(x + sqrt(read_variance + shot * fmax(x, 0)) * noise_normal(noise));
}

/* The pictures of all rows; @steady light is in each and not in the dark. */
static float **photograph(const struct world *w, struct noise *noise, double read_variance,
                          double shot, double steady)
{
    float **rows = g_new(float *, ORDER);
    uint8_t on[ORDER];
    for (uint32_t j = 0; j < ORDER; j++) {
        ls_multiplex_row(ORDER, j, on);
        rows[j] = g_new(float, PIXELS);
        for (int p = 0; p < PIXELS; p++) {
            double x = steady;
            for (uint32_t i = 0; i < LIGHTS; i++)
                x += on[i] ? w->e[i * PIXELS + p] : 0;
            rows[j][p] = sensed(noise, x, read_variance, shot);
        }
    }
    return rows;
}

static void rows_free(float **rows)
{
    for (uint32_t j = 0; j < ORDER; j++)
        g_free(rows[j]);
    g_free(rows);
}

/* RMS over lights and pixels of decoded minus true. */
static double decoded_rms(const struct world *w, float **rows)
{
    double *weights = g_new0(double, LIGHTS), row[ORDER], sum = 0;
    for (uint32_t i = 0; i < LIGHTS; i++) {
        weights[i] = 1;
        g_assert_cmpint(ls_multiplex_weights(ORDER, LIGHTS, 1, weights, row, NULL), ==, LS_OK);
        weights[i] = 0;
        for (int p = 0; p < PIXELS; p++) {
            double e = 0;
            for (uint32_t j = 0; j < ORDER; j++)
                e += row[j] * rows[j][p];
            sum += (e - w->e[i * PIXELS + p]) * (e - w->e[i * PIXELS + p]);
        }
    }
    g_free(weights);
    return sqrt(sum / (LIGHTS * PIXELS));
}

static struct noise seeded(void)
{
    struct noise noise = {.state = g_test_rand_int()};
    g_test_message("seed %" G_GUINT64_FORMAT, noise.state);
    return noise;
}

static void test_exact(gconstpointer world)
{
    const struct world *w = world;
    struct noise noise = seeded();
    float **rows = photograph(w, &noise, 0, 0, 0);
    /* rows are floats: 6e-8 of a row each, 347 of them at random, times 2 / 348 */
    double row = mean_of(rows[0], PIXELS), bound = 6e-8 * row * sqrt(ORDER) * 2 / (ORDER + 1) * 4;
    double rms = decoded_rms(w, rows);
    g_test_message("rms %.3g of a mean of %.3g", rms, mean_of(w->e, LIGHTS * PIXELS));
    g_assert_cmpfloat(rms, <, bound);
    rows_free(rows);
}

/* A sum over lights needs no decoding. */
static void test_sums(gconstpointer world)
{
    const struct world *w = world;
    struct noise noise = seeded();
    float **rows = photograph(w, &noise, 0, 0, 0);
    double weights[LIGHTS], row[ORDER];
    for (int i = 0; i < LIGHTS; i++)
        weights[i] = noise_normal(&noise);
    g_assert_cmpint(ls_multiplex_weights(ORDER, LIGHTS, 45 * 1.2, weights, row, NULL), ==, LS_OK);
    for (int p = 0; p < PIXELS; p++) {
        double want = 0, got = 0, size = 0;
        for (int i = 0; i < LIGHTS; i++)
            want += weights[i] * w->e[i * PIXELS + p];
        for (int j = 0; j < ORDER; j++) { /* shown at duty 1 / 45, sagged by 1.2 */
            got += row[j] * (double)rows[j][p] / (45 * 1.2);
            size += fabs(row[j] * rows[j][p] / (45 * 1.2));
        }
        g_assert_cmpfloat(fabs(got - want), <=, 6e-8 * size); /* rows are floats */
    }
    rows_free(rows);
}

/* Read noise alone: what theory leaves of it; shot noise alone: what theory adds. */
static void test_noise(gconstpointer world)
{
    const struct world *w = world;
    struct noise noise = seeded();
    double mean = mean_of(w->e, LIGHTS * PIXELS);
    static const double cases[][2] = {{25 / (10500. * 10500.), 0}, {0, 1 / 10500.}};
    for (int k = 0; k < 2; k++) {
        struct ls_multiplex_noise theory;
        g_assert_cmpint(
            ls_multiplex_noise(ORDER, LIGHTS, 1, mean, cases[k][0], cases[k][1], &theory, NULL), ==,
            LS_OK);
        float **rows = photograph(w, &noise, cases[k][0], cases[k][1], 0);
        double rms = decoded_rms(w, rows);
        g_test_message("%s noise: gain %.3f, theory %.3f", k ? "shot" : "read",
                       theory.single_sigma / rms, theory.gain);
        /* 138,400 values, those of a pixel independent: 0.19 % is one sigma of a root mean square
         */
        g_assert_cmpfloat(fabs(rms / theory.multiplexed_sigma - 1), <, 0.01);
        rows_free(rows);
    }
    struct ls_multiplex_noise n;
    g_assert_cmpint(ls_multiplex_noise(347, 346, 1, 1, 1, 0, &n, NULL), ==, LS_OK);
    g_assert_cmpfloat(fabs(n.gain - 348 / (2 * sqrt(347))), <, 1e-12);
    g_assert_true(isinf(n.break_even));
    g_assert_cmpint(ls_multiplex_noise(347, 346, 1, 1, 0, 1, &n, NULL), ==, LS_OK);
    g_assert_cmpfloat(fabs(n.gain - sqrt(348 / (2.0 * 346))), <, 1e-12);
    g_assert_cmpfloat(n.break_even, ==, 0);
    /* at the break-even both are alike */
    g_assert_cmpint(ls_multiplex_noise(347, 346, 1.1, 0.1, 3, 0.2, &n, NULL), ==, LS_OK);
    g_assert_cmpint(ls_multiplex_noise(347, 346, 1.1, n.break_even, 3, 0.2, &n, NULL), ==, LS_OK);
    g_assert_cmpfloat(fabs(n.gain - 1), <, 1e-12);
}

static void test_spare(gconstpointer world)
{
    const struct world *w = world;
    struct noise noise = seeded();
    const double read = 25 / (WHITE_E * WHITE_E), shot = 1 / WHITE_E;
    struct ls_multiplex_spare spare;
    float **rows = photograph(w, &noise, read, shot, 0);
    g_assert_cmpint(ls_multiplex_spare(ORDER, LIGHTS, 1, (const float *const *)rows, PIXELS, read,
                                       0, shot, &spare, NULL),
                    ==, LS_OK);
    g_test_message("quiet: %.2f sigma", spare.mean / spare.sigma);
    g_assert_false(spare.alarm); /* 5 sigma: one run in 1.7 million */
    double sigma = spare.sigma;
    rows_free(rows);
    /* steady light that the dark does not have: 2 / (p + 1) of it shows, 20 sigma here */
    double steady = 20 * sigma * (ORDER + 1) / 2;
    rows = photograph(w, &noise, read, shot, steady);
    g_assert_cmpint(ls_multiplex_spare(ORDER, LIGHTS, 1, (const float *const *)rows, PIXELS, read,
                                       0, shot, &spare, NULL),
                    ==, LS_OK);
    g_test_message("steady light: %.2f sigma", spare.mean / spare.sigma);
    g_assert_true(spare.alarm);
    rows_free(rows);
    /* a sensor that bends by three tenths at its brightest */
    rows = photograph(w, &noise, read, shot, 0);
    float peak = 0;
    for (int j = 0; j < ORDER; j++)
        for (int p = 0; p < PIXELS; p++)
            peak = fmaxf(peak, rows[j][p]);
    for (int j = 0; j < ORDER; j++)
        for (int p = 0; p < PIXELS; p++)
            rows[j][p] *= 1 - 0.3f * rows[j][p] / peak;
    g_assert_cmpint(ls_multiplex_spare(ORDER, LIGHTS, 1, (const float *const *)rows, PIXELS, read,
                                       0, shot, &spare, NULL),
                    ==, LS_OK);
    g_test_message("bent by three tenths: %.2f sigma", spare.mean / spare.sigma);
    g_assert_true(spare.alarm);
    rows[3][7] = NAN;
    struct ls_diag diag = {{0}};
    g_assert_cmpint(ls_multiplex_spare(ORDER, LIGHTS, 1, (const float *const *)rows, PIXELS, read,
                                       0, shot, &spare, &diag),
                    ==, LS_ERR_INVALID);
    g_assert_nonnull(strstr(diag.text, "sample 7 of row 3"));
    rows_free(rows);
}

/* The error is of the noise that is told: rows without any put the spare where it is asked to be.
 */
static void test_five_sigma(gconstpointer world)
{
    static const double sigmas[] = {-5.05, -4.95, 4.95, 5.05};
    const double read = 25 / (WHITE_E * WHITE_E), one = 2.0 / (ORDER + 1);
    const double sigma = one * sqrt(ORDER * read / PIXELS);
    struct noise noise = {.state = 1};
    for (size_t k = 0; k < G_N_ELEMENTS(sigmas); k++) {
        struct ls_multiplex_spare spare;
        float **rows = photograph(world, &noise, 0, 0, sigmas[k] * sigma / one);
        g_assert_cmpint(ls_multiplex_spare(ORDER, LIGHTS, 1, (const float *const *)rows, PIXELS,
                                           read, 0, 0, &spare, NULL),
                        ==, LS_OK);
        /* rows are floats: 6e-8 of a row each, against a thousandth of one */
        g_assert_cmpfloat_with_epsilon(spare.mean / spare.sigma, sigmas[k], 0.04);
        g_assert_true(spare.alarm == (fabs(sigmas[k]) > 5));
        rows_free(rows);
    }
}

static void test_refusals(void)
{
    double weights[11] = {0}, row[23];
    struct ls_diag diag = {{0}};
    g_assert_cmpint(ls_multiplex_weights(13, 11, 1, weights, row, &diag), ==, LS_ERR_INVALID);
    g_assert_cmpint(ls_multiplex_weights(11, 11, 1, weights, row, &diag), ==, LS_ERR_INVALID);
    g_assert_cmpint(ls_multiplex_weights(23, 11, 0, weights, row, &diag), ==, LS_ERR_INVALID);
    g_assert_cmpint(ls_multiplex_weights(23, 11, 1, weights, row, &diag), ==, LS_OK);
    weights[4] = INFINITY;
    g_assert_cmpint(ls_multiplex_weights(23, 11, 1, weights, row, &diag), ==, LS_ERR_INVALID);
    g_assert_nonnull(strstr(diag.text, "light 4"));
    struct ls_multiplex_noise n;
    g_assert_cmpint(ls_multiplex_noise(23, 11, 1, -1, 1, 1, &n, &diag), ==, LS_ERR_INVALID);
}

/* sum_i weight_i e_i, as a picture of these weights shows it. */
static void show(const struct world *w, const double *weights, float *out)
{
    for (int p = 0; p < PIXELS; p++) {
        double x = 0;
        for (int i = 0; i < LIGHTS; i++)
            x += weights[i] * w->e[i * PIXELS + p];
        out[p] = (float)x;
    }
}

/* Coefficients against the projection of the truth, both forms, degrees 0 to 4. */
static void test_harmonics(gconstpointer world)
{
    const struct world *w = world;
    const float(*d)[3] = (const float(*)[3])w->directions;
    double weights[LIGHTS], flat[LIGHTS];
    float all[PIXELS], shown[PIXELS], other[PIXELS], a[PIXELS], b[PIXELS];
    for (int i = 0; i < LIGHTS; i++)
        flat[i] = 1;
    show(w, flat, all);
    for (uint32_t index = 0; index < 25; index++) {
        double peak = ls_harmonic_weights(index, LS_BASIS_BIASED, d, LIGHTS, weights);
        show(w, weights, shown);
        ls_harmonic_coefficient(LS_BASIS_BIASED, peak, LIGHTS, shown, all, PIXELS, a);
        ls_harmonic_weights(index, LS_BASIS_POSITIVE, d, LIGHTS, weights);
        show(w, weights, shown);
        ls_harmonic_weights(index, LS_BASIS_NEGATIVE, d, LIGHTS, weights);
        show(w, weights, other);
        ls_harmonic_coefficient(LS_BASIS_POSITIVE, peak, LIGHTS, shown, other, PIXELS, b);
        for (int p = 0; p < PIXELS; p++) {
            double truth = 0;
            for (int i = 0; i < LIGHTS; i++)
                truth += 4 * M_PI / LIGHTS * ls_harmonic(index, d[i]) * w->e[i * PIXELS + p];
            /* pictures are floats, 6e-8 of all lights together times the peak, four roundings */
            double bound = 4 * 6e-8 * 4 * M_PI / LIGHTS * peak * all[p] + 1e-12;
            g_assert_cmpfloat(fabs(a[p] - truth), <, bound);
            g_assert_cmpfloat(fabs(b[p] - truth), <, bound);
        }
    }
}

/* On a Lambertian sphere the gradients give the normal: (2 F_x / F - 1) = 2/3 n_x for a smooth full
 * sphere (Ma et al. 2007), here with 346 lights; normals that the hole below does not touch. */
static void test_gradients(gconstpointer world)
{
    const struct world *w = world;
    const float(*d)[3] = (const float(*)[3])w->directions;
    static const float normals[][3] = {
        {0, 0, 1}, {0.6f, 0, 0.8f}, {0, 0.8f, 0.6f}, {0.48f, 0.6f, 0.64f}};
    double weights[LIGHTS];
    for (size_t k = 0; k < G_N_ELEMENTS(normals); k++)
        for (unsigned axis = 0; axis < 3; axis++) {
            double shown = 0, all = 0;
            ls_gradient_weights(axis, d, LIGHTS, weights);
            for (int i = 0; i < LIGHTS; i++) {
                double length = sqrt(d[i][0] * d[i][0] + d[i][1] * d[i][1] + d[i][2] * d[i][2]);
                double n =
                    (d[i][0] * normals[k][0] + d[i][1] * normals[k][1] + d[i][2] * normals[k][2]) /
                    length;
                shown += fmax(n, 0) * weights[i];
                all += fmax(n, 0);
            }
            /* 346 points for an integral whose integrand has a kink: about 1 / N of it */
            g_assert_cmpfloat(fabs(2 * shown / all - 1 - 2.0 / 3 * normals[k][axis]), <, 0.01);
        }
}

int main(int argc, char **argv)
{
    struct world world; /* one for all: to render it takes as long as every test together */
    g_test_init(&argc, &argv, NULL);
    world_up(&world);
#define WORLD(path, f) g_test_add_data_func(path, &world, f)
    WORLD("/multiplex/without-noise-every-light-comes-back", test_exact);
    WORLD("/multiplex/a-sum-of-lights-needs-no-decoding", test_sums);
    WORLD("/multiplex/read-noise-falls-and-shot-noise-rises-as-theory-says", test_noise);
    WORLD("/multiplex/the-spare-column-tells-of-steady-light", test_spare);
    g_test_add_data_func("/multiplex/the-spare-column-alarms-at-five-sigma", &world,
                         test_five_sigma);
    g_test_add_func("/multiplex/what-does-not-fit-is-refused", test_refusals);
    WORLD("/bases/coefficients-are-the-projection-of-the-truth", test_harmonics);
    WORLD("/bases/gradients-of-a-lambertian-tell-its-normal", test_gradients);
    int failed = g_test_run();
    world_down(&world);
    return failed;
}
