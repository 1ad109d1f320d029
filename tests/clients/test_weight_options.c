/* light_weights: words of the command line, solves, damping, row weights. */
#include "tests/clients/weights_fixture.h"
#include "tests/daemon/take_fixture.h"

#include <glib/gstdio.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static void words_of_the_command_line_are_understood(void)
{
    enum ls_light_solve solve_how;
    enum ls_light_method method;
    bool smooth;
    g_assert_true(ls_light_solve_option("per-target", &solve_how));
    g_assert_cmpint(solve_how, ==, LS_LIGHT_PER_TARGET);
    g_assert_false(ls_light_solve_option("best", &solve_how));
    g_assert_true(ls_light_method_option("least-squares", &method));
    g_assert_cmpint(method, ==, LS_LIGHT_METHOD_LEAST_SQUARES);
    g_assert_false(ls_light_method_option("", &method));
    g_assert_true(ls_light_cells_option("smooth", &smooth) && smooth);
    g_assert_false(ls_light_cells_option("cubic", &smooth));
}

/* Every way of solving finds the LED that the light is of; per-target fits one channel at a time.
 */
static void every_solve_and_method_finds_the_led(void)
{
    struct ls_take_document *document = weights_document(true);
    for (int k = 0; k < 8; k++) {
        struct ls_environment_file environment = weights_lit_by(1);
        const struct ls_light_options options = {
            .model = LIGHTSTAGE_SPHERE,
            .solve = k & 1 ? LS_LIGHT_PER_TARGET : LS_LIGHT_SHARED,
            .method = k & 2 ? LS_LIGHT_METHOD_LEAST_SQUARES : LS_LIGHT_METHOD_NNLS,
            .smooth = k & 4};
        struct ls_light_weights weights;
        struct ls_diag diag = {0};
        enum ls_err err = ls_light_weights_make(document, &environment, &options, &weights, &diag);
        g_assert_cmpstr(diag.text, ==, "");
        g_assert_cmpint(err, ==, LS_OK);
        g_assert_cmpuint(weights.n_rows, ==, k & 1 ? 6 : 2);
        g_assert_cmpint(weights.solution.space, ==, LS_SOLVE_AFTER_M);
        g_assert_cmpint(weights.by_target, ==, k & 1);
        double red = 0, all = 0;
        for (uint32_t r = 0; r < weights.n_rows; r++)
            for (uint32_t i = 0; i < weights.n_lights; i++) {
                double w = fabs((double)weights.rows[r * weights.n_lights + i]);
                all += w;
                red += r % 2 == 1 ? w : 0;
            }
        /* least squares are damped by 1e-3 of the mean diagonal, and one channel alone tells two
         * spectra apart badly: within a tenth; the others are exact */
        g_assert_cmpfloat(red / all, >, k & 2 ? 0.9 : 0.999);
        ls_light_weights_finish(&weights);
        ls_environment_file_finish(&environment);
    }
    ls_take_document_destroy(document);
}

/* ---- damping and row weights ---- */

static struct ls_light_weights solve_damped(const struct ls_take_document *document,
                                            double tikhonov, const struct ls_row_weights *rows)
{
    struct ls_environment_file environment = weights_constant_map(0.8f, 0.5f, 0.3f);
    const struct ls_light_options options = {.model = LIGHTSTAGE_SPHERE,
                                             .method = LS_LIGHT_METHOD_LEAST_SQUARES,
                                             .damped = true,
                                             .tikhonov = tikhonov,
                                             .rows = rows};
    struct ls_light_weights weights;
    struct ls_diag diag = {0};
    enum ls_err err = ls_light_weights_make(document, &environment, &options, &weights, &diag);
    g_assert_cmpstr(diag.text, ==, "");
    g_assert_cmpint(err, ==, LS_OK);
    g_assert_cmpfloat(weights.tikhonov, ==, tikhonov);
    ls_environment_file_finish(&environment);
    return weights;
}

static double norm(const struct ls_light_weights *weights)
{
    double sum = 0;
    for (uint32_t i = 0; i < weights->n_rows * weights->n_lights; i++)
        sum += (double)weights->rows[i] * (double)weights->rows[i];
    return sqrt(sum);
}

/* x = (A'A + t m I)^-1 A'b with m the mean diagonal: the norm falls with t, is that of the plain
 * solution at 0, and at large t is |A'b| / (t m), so ten times t is a tenth of it. */
static void damping_is_of_the_mean_diagonal(void)
{
    struct ls_take_document *document = weights_document(true);
    double last = INFINITY, norms[4];
    static const double t[4] = {0, 1e-2, 1e5, 1e6};
    for (int k = 0; k < 4; k++) {
        struct ls_light_weights weights = solve_damped(document, t[k], NULL);
        norms[k] = norm(&weights);
        g_assert_cmpfloat(norms[k], <, last);
        last = norms[k];
        ls_light_weights_finish(&weights);
    }
    g_assert_cmpfloat_with_epsilon(norms[2] / norms[3], 10,
                                   1e-3); /* 1 / t of it is not yet there */
    ls_take_document_destroy(document);
}

/* A patch of the chart that reads twice what it should spoils the light of an LED; what counts for
 * nothing does not, in one channel or all. */
static void a_row_counts_as_much_as_it_is_told(void)
{
    struct ls_take_document *document = weights_document(true);
    double patches[TAKE_PATCHES], rows[3 * TAKE_PATCHES];
    for (int i = 0; i < 3 * TAKE_PATCHES; i++) {
        patches[i / 3] = i / 3 == 2 ? 0 : 3;
        rows[i] = i / 3 == 2 ? 0 : 3;
    }
    const struct ls_row_weights by_patch = {TAKE_PATCHES, 1, patches},
                                by_row = {TAKE_PATCHES, 3, rows};
    const struct ls_row_weights *const given[] = {NULL, &by_patch, &by_row};
    size_t n = 3 * (size_t)document->calibration->n_channels; /* readings of a patch */
    for (size_t i = 2 * n; i < 3 * n; i++)
        document->calibration->L[i] *= 2;
    for (int k = 0; k < 3; k++) {
        struct ls_environment_file environment = weights_lit_by(1);
        const struct ls_light_options options = {.model = LIGHTSTAGE_SPHERE, .rows = given[k]};
        struct ls_light_weights weights;
        g_assert_cmpint(ls_light_weights_make(document, &environment, &options, &weights, NULL), ==,
                        LS_OK);
        double off = 0; /* by more than 1e-4 is not what floats do */
        for (uint32_t i = 0; i < TAKE_LIGHTS; i++)
            off =
                fmax(off, fabs((double)weights.rows[TAKE_LIGHTS + i] / document->omega_sr[i] - 2));
        g_assert_true((off > 1e-3) == (k == 0));
        ls_light_weights_finish(&weights);
        ls_environment_file_finish(&environment);
    }
    ls_take_document_destroy(document);
}

static void row_weights_of_another_chart_are_refused(void)
{
    static const char *const bad[] = {
        "{}",         "[]",      "[1, -1]",        "[0, 0]", "[[1, 2, 3], 4]",
        "[1, \"x\"]", "[1e999]", "[[1, 2, 3, 4]]", "[1"};
    g_autofree char *path = g_build_filename(g_get_tmp_dir(), "ls-rows-XXXXXX", NULL);
    struct ls_row_weights rows = {0};
    struct ls_diag diag = {0};
    double *out = NULL;
    close(g_mkstemp(path));
    for (size_t i = 0; i < G_N_ELEMENTS(bad); i++) {
        g_assert_true(g_file_set_contents(path, bad[i], -1, NULL));
        g_assert_cmpint(ls_row_weights_read(path, &rows, &diag), ==, LS_ERR_INVALID);
        g_assert_nonnull(strstr(diag.text, path));
    }
    g_assert_true(g_file_set_contents(path, "[[1, 2, 0.5], [0, 1, 1]]", -1, NULL));
    g_assert_cmpint(ls_row_weights_read(path, &rows, &diag), ==, LS_OK);
    g_assert_cmpint(ls_row_weights_for(&rows, 2, 3, &out, &diag), ==, LS_OK);
    g_assert_cmpfloat(out[2], ==, 0.5);
    free(out);
    g_assert_cmpint(ls_row_weights_for(&rows, 3, 3, &out, &diag), ==, LS_ERR_INVALID);
    g_assert_cmpint(ls_row_weights_for(&rows, 2, 1, &out, &diag), ==, LS_ERR_INVALID);
    ls_row_weights_finish(&rows);
    g_unlink(path);
}

/* The document of a take whose plan has, in place of the sphere of R, a condition of @kind. */

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/light-weights/damping-is-of-the-mean-diagonal",
                    damping_is_of_the_mean_diagonal);
    g_test_add_func("/light-weights/a-row-counts-as-much-as-it-is-told",
                    a_row_counts_as_much_as_it_is_told);
    g_test_add_func("/light-weights/row-weights-of-another-chart-are-refused",
                    row_weights_of_another_chart_are_refused);
    g_test_add_func("/light-weights/words-of-the-command-line-are-understood",
                    words_of_the_command_line_are_understood);
    g_test_add_func("/light-weights/every-solve-and-method-finds-the-led",
                    every_solve_and_method_finds_the_led);
    return g_test_run();
}
