/* exposure_offset: the line through signals at several widths. */
#include "core/exposure_offset.h"
#include "tests/core/noise.h"

#include <glib.h>
#include <math.h>
#include <string.h>

static void test_exact(void)
{
    static const double offsets_us[] = {13.7, 0, -8.5, 250};
    for (size_t k = 0; k < G_N_ELEMENTS(offsets_us); k++) {
        struct ls_width_signal s[4];
        struct ls_exposure_offset fit;
        for (int i = 0; i < 4; i++) {
            double w = 50 << i;
            s[i] = (struct ls_width_signal){w, 3.25 * (w + offsets_us[k]), 1 + i};
        }
        for (size_t n = 2; n <= 4; n++) {
            g_assert_cmpint(ls_exposure_offset_fit(s, n, &fit, NULL), ==, LS_OK);
            g_assert_cmpfloat(fabs(fit.us - offsets_us[k]), <, 1e-9);
        }
    }
}

/* Shot noise of a million electrons: as often within its own sigma as a normal error is. */
static void test_sigma(void)
{
    enum { TRIALS = 4000 };
    struct noise noise = {.state = (uint64_t)g_test_rand_int()};
    int within = 0;
    double largest = 0;
    for (int t = 0; t < TRIALS; t++) {
        struct ls_width_signal s[3];
        struct ls_exposure_offset fit;
        for (int i = 0; i < 3; i++) {
            double w = 50 << i, mean = 4000 * (w + 13.7);
            s[i] = (struct ls_width_signal){w, mean + sqrt(mean) * noise_normal(&noise), mean};
        }
        g_assert_cmpint(ls_exposure_offset_fit(s, 3, &fit, NULL), ==, LS_OK);
        within += fabs(fit.us - 13.7) < fit.sigma_us;
        largest = fmax(largest, fit.sigma_us);
    }
    double share = (double)within / TRIALS;
    g_test_message("within sigma %.3f; sigma at most %.3f us", share, largest);
    /* 0.683, four standard errors of 4000 trials */
    g_assert_cmpfloat(fabs(share - 0.683), <, 4 * sqrt(0.683 * 0.317 / TRIALS));
    g_assert_cmpfloat(largest, <, 0.3);
}

static void refuses(double width1, double mean1, double variance1, size_t n, enum ls_err expected)
{
    const struct ls_width_signal s[2] = {{100, 10, 1}, {width1, mean1, variance1}};
    struct ls_exposure_offset fit;
    struct ls_diag diag = {0};
    g_assert_cmpint(ls_exposure_offset_fit(s, n, &fit, &diag), ==, expected);
    g_assert_cmpstr(diag.text, !=, "");
}

static void test_refused(void)
{
    refuses(100, 20, 1, 2, LS_ERR_INVALID);
    refuses(200, 20, 1, 1, LS_ERR_INVALID);
    refuses(200, 20, 1, 0, LS_ERR_INVALID);
    refuses(200, 20, 0, 2, LS_ERR_INVALID);
    refuses(200, NAN, 1, 2, LS_ERR_INVALID);
    refuses(INFINITY, 20, 1, 2, LS_ERR_INVALID);
    refuses(200, 10, 1, 2, LS_ERR_MISMATCH);
    refuses(200, 5, 1, 2, LS_ERR_MISMATCH);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/exposure-offset/exact-signals-give-it-exactly", test_exact);
    g_test_add_func("/exposure-offset/its-error-is-what-it-says", test_sigma);
    g_test_add_func("/exposure-offset/what-is-no-line-is-refused", test_refused);
    return g_test_run();
}
