#include "core/spectrum.h"

#include <glib.h>
#include <math.h>
#include <string.h>

static struct ls_spectra *load(const char *relative)
{
    const char *data = g_getenv("LS_SHARED_DATA"), *source = g_getenv("LS_SOURCE_ROOT");
    g_autofree char *path =
        data ? g_build_filename(data, relative, NULL)
             : g_build_filename(source ? source : ".", "..", "shared", "data", relative, NULL);
    g_autofree char *text = NULL;
    gsize bytes;
    struct ls_spectra *spectra = NULL;
    struct ls_diag diag = {{0}};
    if (!g_file_get_contents(path, &text, &bytes, NULL)) {
        g_test_skip_printf("measured data %s is absent", path);
        return NULL;
    }
    enum ls_err err = ls_spectra_parse_csv(text, bytes, &spectra, &diag);
    g_assert_cmpstr(diag.text, ==, "");
    g_assert_cmpint(err, ==, LS_OK);
    return spectra;
}

static void test_observer_is_the_published_one(void)
{
    struct ls_spectra *spectra = load("cameras/cie_observers.csv");
    if (!spectra)
        return;
    for (int c = 0; c < 3; c++) {
        g_autofree char *name = g_strdup_printf("CIE 1931 2 Degree Standard Observer_%d", c);
        const struct ls_spectrum *published = ls_spectra_find(spectra, name);
        g_assert_nonnull(published);
        for (int i = 0; i < LS_SPECTRUM_N; i++)
            /* the file prints more digits than the table */
            g_assert_cmpfloat_with_epsilon(ls_cie_1931[c].v[i], published->v[i], 1e-8);
    }
    ls_spectra_destroy(spectra);
}

static void test_daylight_matches_the_published_tables(void)
{
    static const struct {
        const char *name;
        double kelvin;
    } d[] = {{"D50", 5002.8}, {"D55", 5502.5}, {"D65", 6503.616}, {"D75", 7504.0}};
    struct ls_spectra *spectra = load("illuminants/cie.csv");
    if (!spectra)
        return;
    for (size_t k = 0; k < G_N_ELEMENTS(d); k++) {
        const struct ls_spectrum *published = ls_spectra_find(spectra, d[k].name);
        struct ls_spectrum ours;
        g_assert_nonnull(published);
        g_assert_cmpint(ls_daylight(d[k].kelvin, &ours), ==, LS_OK);
        for (int i = 0; i < LS_SPECTRUM_N; i++)
            /* the tables round M1 and M2 to 3 digits: up to 5e-4 x 46 + 5e-4 x 10, and more for
             * D50 to D75, whose temperatures are nominal to 0.1 K */
            g_assert_cmpfloat_with_epsilon(ours.v[i], published->v[i], 0.15);
    }
    ls_spectra_destroy(spectra);
    struct ls_spectrum none;
    g_assert_cmpint(ls_daylight(3999, &none), ==, LS_ERR_INVALID);
    g_assert_cmpint(ls_daylight(NAN, &none), ==, LS_ERR_INVALID);
}

static void test_d65_is_white_in_rec709(void)
{
    struct ls_spectrum rgb[3], d65;
    ls_rec709_functionals(rgb);
    g_assert_cmpint(ls_daylight(6503.616, &d65), ==, LS_OK);
    double y = ls_spectrum_dot(&d65, &ls_cie_1931[1]) / ls_spectrum_integral(&ls_cie_1931[1]);
    for (int c = 0; c < 3; c++)
        /* BT.709's white (0.3127, 0.3290) is D65 rounded to 4 digits */
        g_assert_cmpfloat_with_epsilon(ls_spectrum_dot(&d65, &rgb[c]) / y, 1, 1e-3);
}

static void test_rec709_in_a_camera_s_unit_reads_one_in_green(void)
{
    struct ls_spectrum green = {{0}}, rgb[3], d65, dark = {{0}};
    for (int i = 0; i < LS_SPECTRUM_N; i++)
        green.v[i] = 37 * exp(-pow((i - 30) / 8.0, 2));
    g_assert_cmpint(ls_rec709_functionals_for(&green, rgb, NULL), ==, LS_OK);
    g_assert_cmpint(ls_daylight(6503.616, &d65), ==, LS_OK);
    double reads = ls_spectrum_dot(&d65, &green);
    for (int c = 0; c < 3; c++)
        g_assert_cmpfloat_with_epsilon(ls_spectrum_dot(&d65, &rgb[c]) / reads, 1, 1e-3);
    g_assert_cmpint(ls_rec709_functionals_for(&dark, rgb, NULL), ==, LS_ERR_INVALID);
}

static void test_resampling_interpolates_and_ends_at_zero(void)
{
    const double nm[] = {400, 402, 411, 500}, value[] = {1, 3, 12, 12};
    struct ls_spectrum s;
    g_assert_cmpint(ls_spectrum_resample(nm, value, 4, &s, NULL), ==, LS_OK);
    g_assert_cmpfloat(s.v[3], ==, 0);                 /* 395 nm */
    g_assert_cmpfloat(s.v[4], ==, 1);                 /* 400 */
    g_assert_cmpfloat_with_epsilon(s.v[5], 6, 1e-12); /* 405: 3 + 3/9 x 9 */
    g_assert_cmpfloat(s.v[24], ==, 12);               /* 500 */
    g_assert_cmpfloat(s.v[25], ==, 0);
}

static void test_a_gaussian_led_keeps_its_energy(void)
{
    struct ls_spectrum s;
    double nm[401], value[401], sigma = 15 / 2.3548;
    for (int k = 0; k < 401; k++) {
        nm[k] = 380 + k;
        value[k] = exp(-0.5 * pow((nm[k] - 452.3) / sigma, 2));
    }
    g_assert_cmpint(ls_spectrum_resample(nm, value, 401, &s, NULL), ==, LS_OK);
    /* the bound of the header */
    g_assert_cmpfloat_with_epsilon(ls_spectrum_integral(&s) / (sigma * sqrt(2 * M_PI)), 1, 1e-4);
}

static void refuse(const char *text, enum ls_err expected, const char *word)
{
    struct ls_spectra *spectra = NULL;
    struct ls_diag diag = {{0}};
    g_assert_cmpint(ls_spectra_parse_csv(text, strlen(text), &spectra, &diag), ==, expected);
    g_assert_null(spectra);
    g_assert_nonnull(strstr(diag.text, word));
}

static void test_bad_csv_is_refused_with_the_line(void)
{
    refuse("", LS_ERR_INVALID, "header");
    refuse("nm,a\n1,2\n", LS_ERR_INVALID, "wavelength_nm");
    refuse("wavelength_nm\n", LS_ERR_INVALID, "no column");
    refuse("wavelength_nm,a\n400,1\n400,2\n", LS_ERR_INVALID, "ascend");
    refuse("wavelength_nm,a\n\n# c\n400,x\n", LS_ERR_INVALID, "line 4");
    refuse("wavelength_nm,a\n400,1,2\n", LS_ERR_INVALID, "line 2");
    refuse("wavelength_nm,a,b\n400,1\n", LS_ERR_INVALID, "line 2");
    refuse("wavelength_nm,a\n400,inf\n", LS_ERR_INVALID, "line 2");
    refuse("wavelength_nm,a\n", LS_ERR_INVALID, "no samples");
    refuse("wavelength_nm,a\n400,\n", LS_ERR_INVALID, "column \"a\"");
}

static void test_csv_needs_no_terminator_and_takes_gaps(void)
{
    const char text[] = {'w', 'a', 'v', 'e',  'l', 'e', 'n',  'g',  't', 'h', '_',
                         'n', 'm', ',', 'a',  ',', 'b', '\r', '\n', '4', '0', '0',
                         ',', '1', ',', '\n', '4', '1', '0',  ',',  '3', ',', '5'};
    struct ls_spectra *spectra = NULL;
    g_autofree char *exact = g_memdup2(text, sizeof text); /* a sanitizer sees a read past it */
    g_assert_cmpint(ls_spectra_parse_csv(exact, sizeof text, &spectra, NULL), ==, LS_OK);
    g_assert_cmpfloat(ls_spectra_find(spectra, "a")->v[5], ==, 2);
    g_assert_cmpfloat(ls_spectra_find(spectra, "b")->v[4], ==, 0);
    g_assert_cmpfloat(ls_spectra_find(spectra, "b")->v[6], ==, 5);
    g_assert_null(ls_spectra_find(spectra, "c"));
    ls_spectra_destroy(spectra);
}

/* --- smoothest --- */

static double roughness(const struct ls_spectrum *s)
{
    double sum = 0;
    for (int i = 1; i + 1 < LS_SPECTRUM_N; i++)
        sum += pow(s->v[i - 1] - 2 * s->v[i] + s->v[i + 1], 2);
    return sum;
}

/* A narrow violet for which exchanging one sample at a time did not end within 20000. */
static void test_smoothest_ends_where_single_exchanges_wander(void)
{
    const double violet[3] = {47293.413667139452, -46908.705743594423, 391287.64798362256};
    struct ls_spectrum rgb[3], s;
    struct ls_smoothest report;
    ls_rec709_functionals(rgb);
    g_assert_cmpint(ls_spectrum_smoothest(violet, rgb, &s, &report, NULL), ==, LS_OK);
    g_assert_true(report.reachable);
    g_assert_cmpuint(report.iterations, <, 3000); /* a tenth of a millisecond each */
    for (int c = 0; c < 3; c++)
        g_assert_cmpfloat_with_epsilon(ls_spectrum_dot(&s, &rgb[c]) / violet[c], 1, 1e-5);
}

static void test_smoothest_reproduces_any_real_colour(void)
{
    struct ls_spectrum rgb[3];
    guint32 seed = (guint32)g_test_rand_int();
    g_autoptr(GRand) rand = g_rand_new_with_seed(seed);
    unsigned worst_iterations = 0;
    g_test_message("seed %u", seed);
    ls_rec709_functionals(rgb);
    for (int k = 0; k < 300; k++) {
        struct ls_spectrum truth = {{0}}, s;
        struct ls_smoothest report;
        /* 400 to 710 nm, as narrow as an LED of 17 nm: the range the header promises */
        double at = g_rand_double_range(rand, 4, 66),
               width = exp(g_rand_double_range(rand, 0.7, 4));
        double want[3];
        for (int i = 0; i < LS_SPECTRUM_N; i++)
            truth.v[i] = exp(-pow((i - at) / width, 2)) * (k % 2 ? 1 : 1e6);
        for (int c = 0; c < 3; c++)
            want[c] = ls_spectrum_dot(&truth, &rgb[c]);
        g_assert_cmpint(ls_spectrum_smoothest(want, rgb, &s, &report, NULL), ==, LS_OK);
        g_assert_true(report.reachable);
        double norm = sqrt(want[0] * want[0] + want[1] * want[1] + want[2] * want[2]);
        for (int c = 0; c < 3; c++)
            /* what the penalty leaves, as the header says */
            g_assert_cmpfloat_with_epsilon(ls_spectrum_dot(&s, &rgb[c]) / norm, want[c] / norm,
                                           1e-6);
        for (int i = 0; i < LS_SPECTRUM_N; i++)
            g_assert_cmpfloat(s.v[i], >=, 0);
        /* no feasible spectrum is smoother; the Gaussian is feasible */
        g_assert_cmpfloat(roughness(&s), <=, roughness(&truth) * (1 + 1e-4));
        worst_iterations = MAX(worst_iterations, report.iterations);
    }
    g_test_message("at most %u exchanges", worst_iterations);
    /* each costs a tenth of a millisecond */
    g_assert_cmpuint(worst_iterations, <, 3000);
}

/* the KKT conditions, checked from outside: y = 2 D'D s + A' l >= 0, = 0 where s > 0, for the l
 * that fits y = 0 on the positive samples */
static void test_smoothest_is_a_kkt_point(void)
{
    struct ls_spectrum rgb[3], s;
    const double want[3] = {1, 0, 0}; /* so red that part of the spectrum is zero */
    ls_rec709_functionals(rgb);
    g_assert_cmpint(ls_spectrum_smoothest(want, rgb, &s, NULL, NULL), ==, LS_OK);
    double hs[LS_SPECTRUM_N] = {0}, normal[3][4] = {{0}};
    int positive = 0;
    for (int r = 0; r + 2 < LS_SPECTRUM_N; r++) {
        double d = s.v[r] - 2 * s.v[r + 1] + s.v[r + 2];
        hs[r] += d;
        hs[r + 1] -= 2 * d;
        hs[r + 2] += d;
    }
    for (int i = 0; i < LS_SPECTRUM_N; i++) {
        double w = i == 0 || i == LS_SPECTRUM_N - 1 ? 2.5 : 5;
        positive += s.v[i] > 0;
        for (int c = 0; s.v[i] > 0 && c < 3; c++) {
            for (int d = 0; d < 3; d++)
                normal[c][d] += w * w * rgb[c].v[i] * rgb[d].v[i];
            normal[c][3] -= w * rgb[c].v[i] * hs[i];
        }
    }
    g_assert_cmpint(positive, <, LS_SPECTRUM_N);
    for (int c = 0; c < 3; c++)
        for (int r = 0; r < 3; r++)
            for (int d = 3; r != c && d >= 0; d--)
                normal[r][d] -= normal[r][c] / normal[c][c] * normal[c][d];
    double largest = 0;
    for (int i = 0; i < LS_SPECTRUM_N; i++)
        largest = fmax(largest, fabs(hs[i]));
    for (int i = 0; i < LS_SPECTRUM_N; i++) {
        double w = i == 0 || i == LS_SPECTRUM_N - 1 ? 2.5 : 5, y = hs[i];
        for (int c = 0; c < 3; c++)
            y += w * rgb[c].v[i] * normal[c][3] / normal[c][c];
        /* hs is a difference of differences: 1e-6 of its largest value is its rounding */
        if (s.v[i] > 0)
            g_assert_cmpfloat(fabs(y), <, 1e-6 * largest);
        else
            g_assert_cmpfloat(y, >, -1e-6 * largest);
    }
}

static void test_equal_energy_gives_a_flat_spectrum(void)
{
    struct ls_spectrum rgb[3], flat, s;
    double want[3];
    ls_rec709_functionals(rgb);
    for (int i = 0; i < LS_SPECTRUM_N; i++)
        flat.v[i] = 1;
    for (int c = 0; c < 3; c++)
        want[c] = ls_spectrum_dot(&flat, &rgb[c]);
    g_assert_cmpint(ls_spectrum_smoothest(want, rgb, &s, NULL, NULL), ==, LS_OK);
    for (int i = 0; i < LS_SPECTRUM_N; i++)
        /* its roughness is 0, so nothing else is as smooth; 1e-6 is the penalty's remainder */
        g_assert_cmpfloat_with_epsilon(s.v[i], 1, 1e-6);
}

static void test_an_impossible_colour_is_said_to_be_one(void)
{
    static const double impossible[][3] = {{-1, 0, 0}, {0.1, 1, -1}, {0, 0, -3},
                                           {1, -1, 1}, {-1, -1, -1}, {0, -1e-9, 0}};
    struct ls_spectrum rgb[3], s;
    struct ls_smoothest report;
    ls_rec709_functionals(rgb);
    for (size_t k = 0; k < G_N_ELEMENTS(impossible); k++) {
        g_assert_cmpint(ls_spectrum_smoothest(impossible[k], rgb, &s, &report, NULL), ==, LS_OK);
        g_assert_false(report.reachable);
        g_assert_cmpfloat(report.residual, >, 1e-3);
        /* zero is feasible, so the nearest is no farther than it */
        g_assert_cmpfloat(report.residual, <=, 1 + 1e-9);
        for (int i = 0; i < LS_SPECTRUM_N; i++)
            g_assert_true(s.v[i] >= 0 && isfinite(s.v[i]));
    }
}

static void test_black_bad_and_dependent_input(void)
{
    const double black[3] = {0}, bad[3] = {NAN, 0, 0}, tiny[3] = {1e-300, 1e-300, 1e-300};
    struct ls_spectrum rgb[3], s;
    ls_rec709_functionals(rgb);
    g_assert_cmpint(ls_spectrum_smoothest(black, rgb, &s, NULL, NULL), ==, LS_OK);
    g_assert_cmpfloat(ls_spectrum_integral(&s), ==, 0);
    g_assert_cmpint(ls_spectrum_smoothest(tiny, rgb, &s, NULL, NULL), ==, LS_OK);
    g_assert_true(isfinite(ls_spectrum_integral(&s)));
    g_assert_cmpint(ls_spectrum_smoothest(bad, rgb, &s, NULL, NULL), ==, LS_ERR_INVALID);
    rgb[2] = rgb[1];
    g_assert_cmpint(ls_spectrum_smoothest(tiny, rgb, &s, NULL, NULL), ==, LS_ERR_INVALID);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/spectrum/observer-is-the-published-one", test_observer_is_the_published_one);
    g_test_add_func("/spectrum/daylight-matches-the-published-tables",
                    test_daylight_matches_the_published_tables);
    g_test_add_func("/spectrum/d65-is-white-in-rec709", test_d65_is_white_in_rec709);
    g_test_add_func("/spectrum/rec709-in-a-camera-s-unit-reads-one-in-green",
                    test_rec709_in_a_camera_s_unit_reads_one_in_green);
    g_test_add_func("/spectrum/resampling-interpolates-and-ends-at-zero",
                    test_resampling_interpolates_and_ends_at_zero);
    g_test_add_func("/spectrum/a-gaussian-led-keeps-its-energy",
                    test_a_gaussian_led_keeps_its_energy);
    g_test_add_func("/spectrum/bad-csv-is-refused-with-the-line",
                    test_bad_csv_is_refused_with_the_line);
    g_test_add_func("/spectrum/csv-needs-no-terminator-and-takes-gaps",
                    test_csv_needs_no_terminator_and_takes_gaps);
    g_test_add_func("/smoothest/ends-where-single-exchanges-wander",
                    test_smoothest_ends_where_single_exchanges_wander);
    g_test_add_func("/smoothest/reproduces-any-real-colour",
                    test_smoothest_reproduces_any_real_colour);
    g_test_add_func("/smoothest/is-a-kkt-point", test_smoothest_is_a_kkt_point);
    g_test_add_func("/smoothest/equal-energy-gives-a-flat-spectrum",
                    test_equal_energy_gives_a_flat_spectrum);
    g_test_add_func("/smoothest/an-impossible-colour-is-said-to-be-one",
                    test_an_impossible_colour_is_said_to_be_one);
    g_test_add_func("/smoothest/black-bad-and-dependent-input", test_black_bad_and_dependent_input);
    return g_test_run();
}
