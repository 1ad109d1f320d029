#include "core/promote.h"

#include <glib.h>
#include <math.h>
#include <string.h>

static GRand *seeded(guint32 seed)
{
    g_test_message("seed %u", seed);
    return g_rand_new_with_seed(seed);
}

static double gaussian(GRand *rand)
{
    double u = 1 - g_rand_double(rand);
    return sqrt(-2 * log(u)) * cos(2 * M_PI * g_rand_double(rand));
}

static void test_a_bright_ratio_is_the_plain_one(void)
{
    enum { W = 9, H = 7 };
    g_autoptr(GRand) rand = seeded(1);
    float f[W * H * 3], v[W * H * 3], sigma[W * H * 3], r[W * H * 3];
    const double neutral[3] = {0.5, 1, 2};
    for (int j = 0; j < W * H * 3; j++) {
        sigma[j] = 0.01f;
        v[j] = (float)g_rand_double_range(rand, 0.1, 5); /* from 10 sigma on */
        f[j] = (float)(g_rand_double_range(rand, -1, 50) * (double)v[j]);
        if (j % 11 == 0)
            sigma[j] = 0; /* noiseless is bright, however dark */
        if (j % 22 == 0)
            v[j] = 1e-30f, f[j] = 3e-30f;
    }
    g_assert_cmpint(ls_promote_ratio(f, v, sigma, W, H, 3, neutral, r, NULL), ==, LS_OK);
    for (int j = 0; j < W * H * 3; j++)
        /* required 1e-3; a float's rounding here */
        g_assert_cmpfloat_with_epsilon((double)r[j] / ((double)f[j] / (double)v[j]), 1, 1e-6);
}

static void test_what_was_not_measured_is_neutral(void)
{
    static const float bad[][3] = {{1, 0, 1},        {1, -5, 1},        {0, 0, 0},
                                   {NAN, 1, 0.01f},  {1, NAN, 0.01f},   {INFINITY, 1, 0.01f},
                                   {1, INFINITY, 1}, {1, 1, NAN},       {1, 1, INFINITY},
                                   {1, 1, -1},       {1e38f, 1e-38f, 0}};
    const double neutral[1] = {0.25};
    for (size_t k = 0; k < G_N_ELEMENTS(bad); k++) {
        enum { W = 5, H = 4 };
        float f[W * H], v[W * H], sigma[W * H], r[W * H];
        for (int j = 0; j < W * H; j++)
            f[j] = bad[k][0], v[j] = bad[k][1], sigma[j] = bad[k][2];
        g_assert_cmpint(ls_promote_ratio(f, v, sigma, W, H, 1, neutral, r, NULL), ==, LS_OK);
        for (int j = 0; j < W * H; j++)
            g_assert_cmpfloat_with_epsilon(r[j], 0.25, 1e-6);
    }
}

static void test_one_bad_pixel_takes_its_neighbours_ratio(void)
{
    enum { W = 11, H = 11 };
    float f[W * H], v[W * H], sigma[W * H], r[W * H];
    const double neutral[1] = {0.1};
    for (int j = 0; j < W * H; j++)
        f[j] = 3, v[j] = 1, sigma[j] = 0.01f;
    v[60] = -0.005f;
    f[60] = 0.9f; /* a plain ratio of -180: a spark */
    f[61] = NAN;
    g_assert_cmpint(ls_promote_ratio(f, v, sigma, W, H, 1, neutral, r, NULL), ==, LS_OK);
    /* 23 good samples of ratio 3, and one of almost nothing that adds 0.9 to their F */
    g_assert_cmpfloat_with_epsilon(r[60], 3, 0.05);
    g_assert_cmpfloat_with_epsilon(r[61], 3, 0.05);
}

/* One sample of @sigmas and ratio @own among bright ones of ratio 3: its own counts as much as the
 * smooth step from 4 to 10 sigma says, and at most eight times what they say. */
static double ratio_among_brighter(double sigmas, double own)
{
    enum { W = 11, H = 11, MIDDLE = 60 };
    float f[W * H], v[W * H], sigma[W * H], r[W * H];
    const double neutral[1] = {0.1};
    for (int j = 0; j < W * H; j++)
        f[j] = 3000, v[j] = 1000, sigma[j] = 0.01f;
    v[MIDDLE] = (float)(0.01 * sigmas);
    f[MIDDLE] = (float)(0.01 * sigmas * own);
    g_assert_cmpint(ls_promote_ratio(f, v, sigma, W, H, 1, neutral, r, NULL), ==, LS_OK);
    return (double)r[MIDDLE];
}

static void test_between_four_and_ten_sigma_neighbours_have_their_say(void)
{
    static const struct {
        double sigmas, share;
    } steps[] = {{3.9, 0}, {5.5, 0.15625}, {7, 0.5}, {8.5, 0.84375}, {10.1, 1}};
    for (size_t k = 0; k < G_N_ELEMENTS(steps); k++) {
        double share = steps[k].share;
        /* the neighbours' sums hold a permille of the sample, and floats the rest */
        g_assert_cmpfloat_with_epsilon(ratio_among_brighter(steps[k].sigmas, 5),
                                       5 * share + 3 * (1 - share), 0.002);
        double spark = share < 1 ? 8 * 3 : 100;
        g_assert_cmpfloat_with_epsilon(ratio_among_brighter(steps[k].sigmas, 100),
                                       spark * share + 3 * (1 - share), 0.02);
    }
}

/* dark noise over a surface of one true ratio: no sparks, little bias, and no worse than the
 * constant p(s)/p(0) where nothing is known */
static void test_noise_makes_no_sparks(void)
{
    enum { W = 96, H = 96 };
    guint32 seed = (guint32)g_test_rand_int();
    g_autoptr(GRand) rand = g_rand_new_with_seed(seed);
    g_autofree float *f = g_new(float, W *H), *v = g_new(float, W *H);
    g_autofree float *sigma = g_new(float, W *H), *r = g_new(float, W *H);
    static const double snr[] = {0, 0.1, 0.5, 1, 2, 3, 5, 7, 9, 12, 50};
    const double neutral[1] = {1}, truth = 2;
    g_test_message("seed %u", seed);
    for (size_t k = 0; k < G_N_ELEMENTS(snr); k++) {
        double largest = 0, mean = 0, mse = 0;
        for (int j = 0; j < W * H; j++) {
            sigma[j] = 0.01f;
            v[j] = (float)(0.01 * (snr[k] + gaussian(rand)));
            f[j] = (float)(0.01 * (truth * snr[k] + gaussian(rand)));
        }
        g_assert_cmpint(ls_promote_ratio(f, v, sigma, W, H, 1, neutral, r, NULL), ==, LS_OK);
        for (int j = 0; j < W * H; j++) {
            g_assert_true(isfinite(r[j]));
            largest = fmax(largest, fabs((double)r[j]));
            mean += (double)r[j] / (W * H);
            mse += pow((double)r[j] - truth, 2) / (W * H);
        }
        g_test_message("V = %4.1f sigma: mean %.3f rms error %.3f largest %.2f", snr[k], mean,
                       sqrt(mse), largest);
        /* the constant is 1 away from the truth */
        g_assert_cmpfloat(sqrt(mse), <=, 1.05);
        g_assert_cmpfloat(largest, <, 3 * truth);
        if (snr[k] >= 1) /* 289 samples of 1 sigma are 17 sigma together */
            g_assert_cmpfloat_with_epsilon(mean, truth, 0.05 * truth);
    }
}

static void test_a_crop_with_its_border_is_bit_identical(void)
{
    enum { W = 60, H = 50, X = 13, Y = 9, CW = 40, CH = 35 };
    g_autoptr(GRand) rand = seeded(3);
    g_autofree float *f = g_new(float, W *H * 3), *v = g_new(float, W *H * 3);
    g_autofree float *sigma = g_new(float, W *H * 3), *r = g_new(float, W *H * 3);
    g_autofree float *cf = g_new(float, CW *CH * 3), *cv = g_new(float, CW *CH * 3);
    g_autofree float *cs = g_new(float, CW *CH * 3), *cr = g_new(float, CW *CH * 3);
    const double neutral[3] = {1, 1, 1};
    for (int j = 0; j < W * H * 3; j++) {
        sigma[j] = 0.01f;
        v[j] = (float)(0.05 * gaussian(rand));
        f[j] = (float)(0.05 * gaussian(rand));
    }
    for (int y = 0; y < CH; y++) {
        size_t from = (size_t)((Y + y) * W + X) * 3, to = (size_t)y * CW * 3;
        memcpy(cf + to, f + from, CW * 3 * sizeof *f);
        memcpy(cv + to, v + from, CW * 3 * sizeof *f);
        memcpy(cs + to, sigma + from, CW * 3 * sizeof *f);
    }
    g_assert_cmpint(ls_promote_ratio(f, v, sigma, W, H, 3, neutral, r, NULL), ==, LS_OK);
    g_assert_cmpint(ls_promote_ratio(cf, cv, cs, CW, CH, 3, neutral, cr, NULL), ==, LS_OK);
    const int halo = LS_RATIO_HALO_PX;
    for (int y = halo; y < CH - halo; y++)
        g_assert_cmpmem(cr + (y * CW + halo) * 3, (size_t)(CW - 2 * halo) * 3 * sizeof *r,
                        r + ((Y + y) * W + X + halo) * 3, (size_t)(CW - 2 * halo) * 3 * sizeof *r);
}

static void test_the_smallest_pictures_work_and_bad_calls_are_refused(void)
{
    const float f = 4, v = 2, sigma = 0.1f;
    double neutral[3] = {1, 1, 1};
    float r;
    g_assert_cmpint(ls_promote_ratio(&f, &v, &sigma, 1, 1, 1, neutral, &r, NULL), ==, LS_OK);
    g_assert_cmpfloat(r, ==, 2);
    g_assert_cmpint(ls_promote_ratio(&f, &v, &sigma, 0, 1, 1, neutral, &r, NULL), ==,
                    LS_ERR_INVALID);
    g_assert_cmpint(ls_promote_ratio(&f, &v, &sigma, 1, 1, 2, neutral, &r, NULL), ==,
                    LS_ERR_INVALID);
    neutral[0] = 0;
    g_assert_cmpint(ls_promote_ratio(&f, &v, &sigma, 1, 1, 1, neutral, &r, NULL), ==,
                    LS_ERR_INVALID);
}

static void test_sigma_is_that_of_a_simulated_sum(void)
{
    enum { N = 40, TRIALS = 20000 };
    guint32 seed = (guint32)g_test_rand_int();
    g_autoptr(GRand) rand = g_rand_new_with_seed(seed);
    struct ls_field field = {.noise = {.read_variance = 1e-6, .dark_variance = 1e-7, .shot = 1e-4}};
    float row[N], v = 0, sigma;
    double signal = 0.02, sum2 = 0, sum1 = 0;
    g_test_message("seed %u", seed);
    for (int i = 0; i < N; i++) {
        row[i] = 1;
        v += (float)signal;
    }
    ls_promote_sigma(&field, row, N, &v, 1, &sigma);
    for (int t = 0; t < TRIALS; t++) {
        double dark = sqrt(1e-7) * gaussian(rand), e = 0;
        for (int i = 0; i < N; i++)
            e += signal + dark + sqrt(1e-6 + 1e-4 * signal) * gaussian(rand);
        sum1 += e / TRIALS;
        sum2 += e * e / TRIALS;
    }
    /* 20,000 trials know a sigma to 0.5 %; five of those */
    g_assert_cmpfloat_with_epsilon((double)sigma / sqrt(sum2 - sum1 * sum1), 1, 0.025);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/ratio/a-bright-ratio-is-the-plain-one", test_a_bright_ratio_is_the_plain_one);
    g_test_add_func("/ratio/what-was-not-measured-is-neutral",
                    test_what_was_not_measured_is_neutral);
    g_test_add_func("/ratio/one-bad-pixel-takes-its-neighbours-ratio",
                    test_one_bad_pixel_takes_its_neighbours_ratio);
    g_test_add_func("/ratio/between-four-and-ten-sigma-neighbours-have-their-say",
                    test_between_four_and_ten_sigma_neighbours_have_their_say);
    g_test_add_func("/ratio/noise-makes-no-sparks", test_noise_makes_no_sparks);
    g_test_add_func("/ratio/a-crop-with-its-border-is-bit-identical",
                    test_a_crop_with_its_border_is_bit_identical);
    g_test_add_func("/ratio/the-smallest-pictures-work-and-bad-calls-are-refused",
                    test_the_smallest_pictures_work_and_bad_calls_are_refused);
    g_test_add_func("/ratio/sigma-is-that-of-a-simulated-sum",
                    test_sigma_is_that_of_a_simulated_sum);
    return g_test_run();
}
