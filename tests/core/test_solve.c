#include "tests/core/lighting_once.h"

#include <glib.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { COLS = 6, ROWS_MAX = 24 };

/** A random system, and how it was made degenerate. */
struct random_system {
    double a[ROWS_MAX * COLS], b[ROWS_MAX], w[ROWS_MAX];
    struct ls_system system;
};

static void make(struct random_system *r, GRand *rand, int kind)
{
    size_t rows = kind == 3 ? 3 : (size_t)g_rand_int_range(rand, COLS, ROWS_MAX + 1);
    double direction[ROWS_MAX];
    for (size_t i = 0; i < rows; i++) {
        direction[i] = g_rand_double_range(rand, -1, 1);
        r->b[i] = g_rand_double_range(rand, -1, 1);
        r->w[i] = g_rand_double_range(rand, 0.1, 3);
        for (size_t j = 0; j < COLS; j++)
            r->a[i * COLS + j] = g_rand_double_range(rand, kind == 4 ? 0 : -1, 1);
    }
    for (size_t i = 0; i < rows; i++) {
        double *row = r->a + i * COLS;
        if (kind == 1) /* duplicated columns, one scaled by 1e6 */
            row[2] = row[1], row[4] = 1e6 * row[1];
        if (kind == 2) /* rank 1 */
            for (size_t j = 0; j < COLS; j++)
                row[j] = direction[i] * (double)(j + 1);
        if (kind == 5) /* a zero column and an exact fit */
            row[3] = 0, r->b[i] = row[0] + 2 * row[5];
        if (kind == 6) /* ill scaled */
            row[0] *= 1e-8, row[1] *= 1e8;
    }
    r->system = (struct ls_system){.rows = rows,
                                   .cols = COLS,
                                   .a = r->a,
                                   .b = r->b,
                                   .row_weight = kind % 2 ? r->w : NULL,
                                   .tikhonov = kind == 7 ? 1e-3 : 0};
}

static void test_least_squares_residual_is_orthogonal_to_the_columns(void)
{
    guint32 seed = (guint32)g_test_rand_int();
    g_autoptr(GRand) rand = g_rand_new_with_seed(seed);
    g_test_message("seed %u", seed);
    for (int k = 0; k < 200; k++) {
        struct random_system r;
        double x[COLS];
        make(&r, rand, (k % 3) * 2); /* plain, rank 1, positive */
        r.system.row_weight = r.w;
        g_assert_cmpint(ls_solve(&r.system, LS_SOLVE_LEAST_SQUARES, x, NULL, NULL), ==, LS_OK);
        for (size_t j = 0; j < COLS; j++) {
            long double sum = 0;
            for (size_t i = 0; i < r.system.rows; i++) {
                long double e = -r.b[i];
                for (size_t m = 0; m < COLS; m++)
                    e += (long double)r.a[i * COLS + m] * x[m];
                sum += e * r.w[i] * r.w[i] * r.a[i * COLS + j];
            }
            /* 24 terms of size 10, condition below 1e3 */
            g_assert_cmpfloat(fabsl(sum), <, 1e-10L);
        }
    }
}

static void test_rank_deficient_least_squares_has_minimum_norm(void)
{
    const double a[] = {1, 1, 0, 2, 2, 0, 0, 0, 3}, b[] = {2, 4, 3};
    struct ls_system system = {.rows = 3, .cols = 3, .a = a, .b = b};
    struct ls_solution out;
    double x[3];
    g_assert_cmpint(ls_solve(&system, LS_SOLVE_LEAST_SQUARES, x, &out, NULL), ==, LS_OK);
    g_assert_cmpfloat_with_epsilon(x[0], 1, 1e-12); /* (2, 0) and (0, 2) fit as well */
    g_assert_cmpfloat_with_epsilon(x[1], 1, 1e-12);
    g_assert_cmpfloat_with_epsilon(x[2], 1, 1e-12);
    g_assert_cmpuint(out.rank, ==, 2);
    g_assert_true(isinf(out.condition));
    g_assert_cmpfloat(out.relative, <, 1e-12);
}

static void test_condition_is_that_of_a_known_matrix(void)
{
    const double a[] = {3, 0, 0, 0.5, 0, 0}, b[] = {1, 1, 0};
    struct ls_system system = {.rows = 3, .cols = 2, .a = a, .b = b};
    struct ls_solution out;
    double x[2];
    g_assert_cmpint(ls_solve(&system, LS_SOLVE_NNLS, x, &out, NULL), ==, LS_OK);
    g_assert_cmpfloat_with_epsilon(out.condition, 6, 1e-12);
    g_assert_cmpuint(out.rank, ==, 2);
}

static void test_tikhonov_is_relative_to_the_mean_diagonal(void)
{
    const double a[] = {2, 0, 0, 4}, b[] = {2, 4}; /* mean diagonal (4 + 16) / 2 = 10 */
    struct ls_system system = {.rows = 2, .cols = 2, .a = a, .b = b, .tikhonov = 0.1};
    double x[2];
    g_assert_cmpint(ls_solve(&system, LS_SOLVE_LEAST_SQUARES, x, NULL, NULL), ==, LS_OK);
    g_assert_cmpfloat_with_epsilon(x[0], 4.0 / 5, 1e-12);
    g_assert_cmpfloat_with_epsilon(x[1], 16.0 / 17, 1e-12);
    g_assert_cmpint(ls_solve(&system, LS_SOLVE_NNLS, x, NULL, NULL), ==, LS_OK);
    g_assert_cmpfloat_with_epsilon(x[0], 4.0 / 5, 1e-12);
}

static void test_bad_systems_are_refused(void)
{
    double a[] = {1, 2}, b[] = {1}, x[2], w[] = {-1};
    struct ls_system good = {.rows = 1, .cols = 2, .a = a, .b = b}, bad = good;
    bad.rows = 0;
    g_assert_cmpint(ls_solve(&bad, LS_SOLVE_NNLS, x, NULL, NULL), ==, LS_ERR_INVALID);
    bad = good;
    bad.cols = LS_SOLVE_MAX_COLS + 1;
    g_assert_cmpint(ls_solve(&bad, LS_SOLVE_NNLS, x, NULL, NULL), ==, LS_ERR_INVALID);
    bad = good;
    bad.row_weight = w;
    g_assert_cmpint(ls_solve(&bad, LS_SOLVE_LEAST_SQUARES, x, NULL, NULL), ==, LS_ERR_INVALID);
    bad = good;
    bad.tikhonov = NAN;
    g_assert_cmpint(ls_solve(&bad, LS_SOLVE_LEAST_SQUARES, x, NULL, NULL), ==, LS_ERR_INVALID);
    a[1] = INFINITY;
    g_assert_cmpint(ls_solve(&good, LS_SOLVE_NNLS, x, NULL, NULL), ==, LS_ERR_INVALID);
    a[0] = a[1] = b[0] = 0;
    g_assert_cmpint(ls_solve(&good, LS_SOLVE_NNLS, x, NULL, NULL), ==, LS_OK);
    g_assert_cmpfloat(x[0] + x[1], ==, 0);
}

/* --- lighting --- */

enum { PATCHES = 24, SPECTRA = 6 };

static void chart(double *l, size_t n_channels, GRand *rand)
{
    for (size_t k = 0; k < PATCHES * n_channels * SPECTRA; k++)
        l[k] = g_rand_double_range(rand, 0.05, 1);
}

static const double m[9] = {1.768, -0.187, -0.329, -0.461, 1.780, -0.525, -0.139, -0.845, 2.882};

static void test_the_stage_s_own_light_is_solved_exactly(void)
{
    const guint32 seed = 7;
    g_autoptr(GRand) rand = g_rand_new_with_seed(seed);
    g_test_message("seed %u", seed);
    const double truth[SPECTRA] = {0.5, 0, 0.2, 1.5, 0, 0.1};
    double l[PATCHES * 3 * SPECTRA], p[PATCHES * 3], alpha[SPECTRA];
    chart(l, 3, rand);
    for (size_t r = 0; r < PATCHES * 3; r++) {
        p[r] = 0;
        for (size_t s = 0; s < SPECTRA; s++)
            p[r] += l[r * SPECTRA + s] * truth[s];
    }
    struct ls_lighting lighting = {
        .n_patches = PATCHES, .n_channels = 3, .n_spectra = SPECTRA, .chart = l};
    for (int with_m = 0; with_m < 2; with_m++) {
        struct ls_lighting_solution out;
        lighting.m = with_m ? m : NULL;
        ls_lighting_defaults(&lighting);
        g_assert_cmpint(ls_lighting_space(&lighting), ==,
                        with_m ? LS_SOLVE_AFTER_M : LS_SOLVE_CAMERA_RAW);
        g_assert_cmpint(lighting_once(&lighting, p, 0, alpha, &out), ==, LS_OK);
        for (size_t s = 0; s < SPECTRA; s++)
            /* condition below 100 */
            g_assert_cmpfloat_with_epsilon(alpha[s], truth[s], 1e-12);
        g_assert_cmpfloat(out.worst.relative, <, 1e-12);
        g_assert_cmpuint(out.worst.rank, ==, SPECTRA);
    }
}

/* Eq. 5: the error is measured after M, on both sides */
static void test_m_is_applied_to_both_sides(void)
{
    const guint32 seed = 8;
    g_autoptr(GRand) rand = g_rand_new_with_seed(seed);
    g_test_message("seed %u", seed);
    double l[PATCHES * 3 * SPECTRA], p[PATCHES * 3], a[PATCHES * 3 * SPECTRA], b[PATCHES * 3];
    double alpha[SPECTRA], expected[SPECTRA];
    chart(l, 3, rand);
    for (size_t r = 0; r < PATCHES * 3; r++)
        p[r] = g_rand_double_range(rand, 0.05, 1);
    for (size_t k = 0; k < PATCHES; k++)
        for (size_t c = 0; c < 3; c++) {
            b[3 * k + c] = 0;
            for (size_t d = 0; d < 3; d++)
                b[3 * k + c] += m[3 * c + d] * p[3 * k + d];
            for (size_t s = 0; s < SPECTRA; s++) {
                double *to = &a[(3 * k + c) * SPECTRA + s];
                *to = 0;
                for (size_t d = 0; d < 3; d++)
                    *to += m[3 * c + d] * l[(3 * k + d) * SPECTRA + s];
            }
        }
    struct ls_system system = {.rows = PATCHES * 3, .cols = SPECTRA, .a = a, .b = b};
    struct ls_lighting lighting = {
        .n_patches = PATCHES, .n_channels = 3, .n_spectra = SPECTRA, .chart = l, .m = m};
    ls_lighting_defaults(&lighting);
    g_assert_cmpint(ls_solve(&system, LS_SOLVE_NNLS, expected, NULL, NULL), ==, LS_OK);
    g_assert_cmpint(lighting_once(&lighting, p, 0, alpha, NULL), ==, LS_OK);
    for (size_t s = 0; s < SPECTRA; s++)
        g_assert_cmpfloat_with_epsilon(alpha[s], expected[s], 1e-12);
}

static void test_mono_solves_each_output_channel_alone(void)
{
    const guint32 seed = 9;
    g_autoptr(GRand) rand = g_rand_new_with_seed(seed);
    g_test_message("seed %u", seed);
    double l[PATCHES * SPECTRA], p[PATCHES * 3], alpha[3 * SPECTRA];
    double truth[3][SPECTRA];
    chart(l, 1, rand);
    for (size_t t = 0; t < 3; t++)
        for (size_t s = 0; s < SPECTRA; s++)
            truth[t][s] = g_rand_double_range(rand, -1, 1);
    for (size_t k = 0; k < PATCHES; k++)
        for (size_t t = 0; t < 3; t++) {
            p[3 * k + t] = 0;
            for (size_t s = 0; s < SPECTRA; s++)
                p[3 * k + t] += l[k * SPECTRA + s] * truth[t][s];
        }
    struct ls_lighting lighting = {
        .n_patches = PATCHES, .n_channels = 1, .n_spectra = SPECTRA, .chart = l};
    ls_lighting_defaults(&lighting);
    g_assert_cmpfloat(lighting.tikhonov, ==, 1e-3);
    g_assert_cmpint(lighting.mode, ==, LS_SOLVE_PER_TARGET);
    lighting.tikhonov = 0;
    g_assert_cmpint(lighting_once(&lighting, p, 3, alpha, NULL), ==, LS_OK);
    for (size_t t = 0; t < 3; t++)
        for (size_t s = 0; s < SPECTRA; s++)
            g_assert_cmpfloat_with_epsilon(alpha[t * SPECTRA + s], truth[t][s], 1e-11);
    g_assert_cmpint(lighting_once(&lighting, p, 0, alpha, NULL), ==, LS_ERR_INVALID);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/least-squares/residual-is-orthogonal-to-the-columns",
                    test_least_squares_residual_is_orthogonal_to_the_columns);
    g_test_add_func("/least-squares/rank-deficient-has-minimum-norm",
                    test_rank_deficient_least_squares_has_minimum_norm);
    g_test_add_func("/solve/condition-is-that-of-a-known-matrix",
                    test_condition_is_that_of_a_known_matrix);
    g_test_add_func("/solve/tikhonov-is-relative-to-the-mean-diagonal",
                    test_tikhonov_is_relative_to_the_mean_diagonal);
    g_test_add_func("/solve/bad-systems-are-refused", test_bad_systems_are_refused);
    g_test_add_func("/lighting/the-stage-s-own-light-is-solved-exactly",
                    test_the_stage_s_own_light_is_solved_exactly);
    g_test_add_func("/lighting/m-is-applied-to-both-sides", test_m_is_applied_to_both_sides);
    g_test_add_func("/lighting/mono-solves-each-output-channel-alone",
                    test_mono_solves_each_output_channel_alone);
    return g_test_run();
}
