/* cell_lighting and the chart's solve on hostile charts, cells and lights. */
#include "core/cell_lighting.h"
#include "tests/core/lighting_once.h"

#include <glib.h>
#include <math.h>
#include <string.h>

enum { PATCHES = 12, SPECTRA = 6, ROWS = 3 * PATCHES, CELLS = 9, OUTPUTS = 3 * SPECTRA };

struct chart {
    struct ls_spectrum reflectance[PATCHES], functionals[3], led[SPECTRA];
    double l[ROWS * SPECTRA];
    struct ls_lighting lighting;
    struct ls_spectral_chart reader;
};

static double bell(int i, double centre, double width)
{
    return exp(-0.5 * pow((i - centre) / width, 2));
}

static struct chart *a_chart(size_t n_channels)
{
    struct chart *chart = g_new0(struct chart, 1);
    ls_rec709_functionals(chart->functionals);
    for (int i = 0; i < LS_SPECTRUM_N; i++) {
        for (int p = 0; p < PATCHES; p++)
            chart->reflectance[p].v[i] = 0.05 + 0.8 * bell(i, 7 * p, 6 + p % 3 * 6);
        for (int s = 0; s < SPECTRA; s++)
            chart->led[s].v[i] = s == 0 ? 0.5 + bell(i, 14, 4) : bell(i, 10.0 + 11 * s, 3);
    }
    for (int s = 0; s < SPECTRA; s++) {
        double p[ROWS];
        chart_reads(chart->reflectance, PATCHES, chart->functionals, n_channels, &chart->led[s], p);
        for (size_t r = 0; r < PATCHES * n_channels; r++)
            chart->l[r * SPECTRA + (size_t)s] = p[r];
    }
    chart->lighting = (struct ls_lighting){
        .n_patches = PATCHES, .n_channels = n_channels, .n_spectra = SPECTRA, .chart = chart->l};
    ls_lighting_defaults(&chart->lighting);
    chart->reader = (struct ls_spectral_chart){.reflectance = chart->reflectance,
                                               .n_patches = PATCHES,
                                               .reader = chart->functionals,
                                               .n_readers = 3};
    return chart;
}

static struct ls_lighting_solver *factor(struct chart *chart)
{
    struct ls_lighting_solver *solver;
    g_assert_cmpint(ls_lighting_solver_create(&chart->lighting, 3, &solver, NULL), ==, LS_OK);
    chart->reader.solver = solver;
    return solver;
}

static const double cells[CELLS * 3] = {1,   1,   1,   0,     0,     0,     3,    2,    0.5,
                                        0.1, 0.2, 0.9, 1e-30, 1e-30, 1e-30, 1e30, 5e29, 5e29,
                                        -1,  -1,  -1,  0,     0,     1e-6,  1e6,  9e5,  8e5};

static void test_every_mode_is_finite_and_homogeneous(void)
{
    for (int k = 0; k < 8; k++) {
        struct chart *chart = a_chart(k & 4 ? 1 : 3);
        double alpha[CELLS * OUTPUTS], twice[CELLS * OUTPUTS], doubled[CELLS * 3];
        struct ls_cell_lighting found;
        chart->lighting.mode = k & 1 || k & 4 ? LS_SOLVE_PER_TARGET : LS_SOLVE_SHARED;
        chart->lighting.method = k & 2 ? LS_SOLVE_LEAST_SQUARES : LS_SOLVE_NNLS;
        chart->lighting.tikhonov = k & 2 ? 1e-3 : 0;
        struct ls_lighting_solver *solver = factor(chart);
        size_t n = CELLS * ls_lighting_solver_outputs(solver);
        g_assert_cmpint(ls_cell_lighting_map(&chart->reader, chart->functionals, cells, CELLS,
                                             alpha, &found, NULL),
                        ==, LS_OK);
        for (int i = 0; i < CELLS * 3; i++)
            doubled[i] = 2 * cells[i];
        g_assert_cmpint(ls_cell_lighting_map(&chart->reader, chart->functionals, doubled, CELLS,
                                             twice, NULL, NULL),
                        ==, LS_OK);
        for (size_t i = 0; i < n; i++) {
            g_assert_true(isfinite(alpha[i]));
            /* the smoothest spectrum ends its rounds at 1e-10 of the RGB */
            g_assert_cmpfloat(fabs(twice[i] - 2 * alpha[i]), <=,
                              1e-7 * fabs(twice[i]) + 1e-9 * 2e30);
        }
        for (size_t i = n / CELLS; i < 2 * n / CELLS; i++)
            g_assert_cmpfloat(alpha[i], ==, 0); /* a dark cell */
        g_assert_cmpfloat(found.energy, >, 1e30);
        g_assert_cmpfloat(found.missed, >, 0); /* (-1, -1, -1) is no light */
        g_assert_true(isfinite(found.residual));
        ls_lighting_solver_destroy(solver);
        g_free(chart);
    }
}

static void test_cells_are_what_each_would_be_alone(void)
{
    struct chart *chart = a_chart(3);
    struct ls_lobe lobe[2] = {{.sharpness = 1, .radiance = 1}, {.sharpness = 2, .radiance = 1}};
    const struct ls_lobes lobes = {.n = 2, .item = lobe};
    const double mixed[4 * 2] = {1, 0, 0, 1, 0.3, 0.7, 0, 0};
    double alpha[4 * SPECTRA];
    struct ls_cell_lighting found;
    struct ls_lighting_solver *solver = factor(chart);
    lobe[0].spectrum = chart->led[2];
    for (int i = 0; i < LS_SPECTRUM_N; i++)
        lobe[1].spectrum.v[i] = bell(i, 40, 15);
    g_assert_cmpint(ls_cell_lighting_lobes(&chart->reader, &lobes, mixed, 4, alpha, &found, NULL),
                    ==, LS_OK);
    for (int k = 0; k < 4; k++) {
        struct ls_spectrum light;
        double p[ROWS], alone[SPECTRA];
        for (int i = 0; i < LS_SPECTRUM_N; i++)
            light.v[i] =
                mixed[2 * k] * lobe[0].spectrum.v[i] + mixed[2 * k + 1] * lobe[1].spectrum.v[i];
        chart_reads(chart->reflectance, PATCHES, chart->functionals, 3, &light, p);
        g_assert_cmpint(lighting_once(&chart->lighting, p, 0, alone, NULL), ==, LS_OK);
        for (int s = 0; s < SPECTRA; s++) /* other order of sums, condition below 1e3 */
            g_assert_cmpfloat_with_epsilon(alpha[k * SPECTRA + s], alone[s], 1e-11);
    }
    for (int s = 0; s < SPECTRA; s++) /* an LED's own light */
        g_assert_cmpfloat_with_epsilon(alpha[s], s == 2, 1e-11);
    g_assert_cmpint(found.worst.space, ==, LS_SOLVE_CAMERA_RAW);
    ls_lighting_solver_destroy(solver);
    g_free(chart);
}

static void test_charts_that_tell_nothing_apart_still_end(void)
{
    for (int k = 0; k < 12; k++) {
        struct chart *chart = a_chart(3);
        double alpha[CELLS * OUTPUTS], weight[ROWS];
        struct ls_cell_lighting found;
        chart->lighting.mode = k & 1 ? LS_SOLVE_PER_TARGET : LS_SOLVE_SHARED;
        chart->lighting.method = k & 2 ? LS_SOLVE_LEAST_SQUARES : LS_SOLVE_NNLS;
        for (int r = 0; r < ROWS; r++) {
            weight[r] = r % 2 ? 1e4 : 1e-4;
            for (int s = 0; s < SPECTRA; s++) {
                double *l = &chart->l[r * SPECTRA + s];
                *l = k < 4 ? chart->l[r * SPECTRA] * (s + 1) : k < 8 ? 0 : *l; /* rank 1, black */
            }
        }
        if (k >= 8)
            chart->lighting.row_weight = weight;
        struct ls_lighting_solver *solver = factor(chart);
        g_assert_cmpint(
            ls_cell_lighting_map(&chart->reader, chart->functionals, cells, 4, alpha, &found, NULL),
            ==, LS_OK);
        for (size_t i = 0; i < 4 * ls_lighting_solver_outputs(solver); i++)
            g_assert_true(isfinite(alpha[i]));
        if (k < 4)
            g_assert_cmpuint(found.worst.worst.rank, ==, 1);
        if (k >= 4 && k < 8)
            g_assert_cmpuint(found.worst.worst.rank, ==, 0);
        ls_lighting_solver_destroy(solver);
        g_free(chart);
    }
}

static void test_what_is_not_finite_is_refused(void)
{
    struct chart *chart = a_chart(3);
    struct ls_lighting_solver *solver = factor(chart), *none;
    const double bad[3] = {1, NAN, 1}, huge[3] = {1, INFINITY, 1};
    double alpha[SPECTRA];
    g_assert_cmpint(
        ls_cell_lighting_map(&chart->reader, chart->functionals, bad, 1, alpha, NULL, NULL), ==,
        LS_ERR_INVALID);
    g_assert_cmpint(
        ls_cell_lighting_map(&chart->reader, chart->functionals, huge, 1, alpha, NULL, NULL), ==,
        LS_ERR_INVALID);
    g_assert_cmpint(
        ls_cell_lighting_map(&chart->reader, chart->functionals, cells, 0, alpha, NULL, NULL), ==,
        LS_OK);
    ls_lighting_solver_destroy(solver);
    chart->l[7] = INFINITY;
    g_assert_cmpint(ls_lighting_solver_create(&chart->lighting, 3, &none, NULL), ==,
                    LS_ERR_INVALID);
    g_assert_null(none);
    g_free(chart);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/cell-lighting/every-mode-is-finite-and-homogeneous",
                    test_every_mode_is_finite_and_homogeneous);
    g_test_add_func("/cell-lighting/cells-are-what-each-would-be-alone",
                    test_cells_are_what_each_would_be_alone);
    g_test_add_func("/cell-lighting/charts-that-tell-nothing-apart-still-end",
                    test_charts_that_tell_nothing_apart_still_end);
    g_test_add_func("/cell-lighting/what-is-not-finite-is-refused",
                    test_what_is_not_finite_is_refused);
    return g_test_run();
}
