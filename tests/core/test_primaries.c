#include "core/primaries.h"

#include <glib.h>
#include <math.h>

static const struct ls_primaries *const spaces[] = {&ls_primaries_rec709, &ls_primaries_acescg};

static void multiply(const double m[3][3], const double v[3], double out[3])
{
    for (int r = 0; r < 3; r++)
        out[r] = m[r][0] * v[0] + m[r][1] * v[1] + m[r][2] * v[2];
}

/* BT.709-6, 3.3, has luminance to four digits; the ACES white's is 1 by definition of Y. */
static void test_primaries_and_white(void)
{
    static const double luminance[3] = {0.2126, 0.7152, 0.0722}, one[3] = {1, 1, 1};
    for (int s = 0; s < 2; s++) {
        double m[3][3], white[3];
        ls_primaries_to_xyz(spaces[s], m);
        multiply(m, one, white);
        double sum = white[0] + white[1] + white[2];
        g_assert_cmpfloat_with_epsilon(white[1], 1, 1e-14);
        g_assert_cmpfloat_with_epsilon(white[0] / sum, spaces[s]->xy[3][0], 1e-14);
        g_assert_cmpfloat_with_epsilon(white[1] / sum, spaces[s]->xy[3][1], 1e-14);
        for (int c = 0; c < 3; c++) {
            double total = m[0][c] + m[1][c] + m[2][c];
            g_assert_cmpfloat_with_epsilon(m[0][c] / total, spaces[s]->xy[c][0], 1e-14);
            g_assert_cmpfloat_with_epsilon(m[1][c] / total, spaces[s]->xy[c][1], 1e-14);
        }
        for (int c = 0; c < 3 && s == 0; c++)
            g_assert_cmpfloat_with_epsilon(m[1][c], luminance[c], 5e-5);
    }
}

static void assert_identity(const double m[3][3])
{
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++)
            g_assert_cmpfloat_with_epsilon(m[r][c], r == c, 1e-14);
}

static void test_there_and_back(void)
{
    double a[3][3], b[3][3], m[3][3];
    for (int s = 0; s < 2; s++) {
        ls_primaries_to_xyz(spaces[s], a);
        ls_primaries_from_xyz(spaces[s], b);
        ls_colours_multiply(b, a, m);
        assert_identity(m);
        ls_primaries_convert(spaces[s], spaces[1 - s], a);
        ls_primaries_convert(spaces[1 - s], spaces[s], b);
        ls_colours_multiply(a, b, m);
        assert_identity(m);
        ls_primaries_convert(spaces[s], spaces[s], m);
        assert_identity(m);
    }
}

/* As the ACES configurations of OpenColorIO publish it, to six digits. */
static void test_acescg_is_the_published_one(void)
{
    static const double published[3][3] = {{0.613097, 0.339523, 0.047379},
                                           {0.070194, 0.916354, 0.013452},
                                           {0.020616, 0.109570, 0.869815}};
    static const double one[3] = {1, 1, 1};
    double m[3][3], white[3];
    ls_primaries_convert(&ls_primaries_rec709, &ls_primaries_acescg, m);
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++)
            g_assert_cmpfloat_with_epsilon(m[r][c], published[r][c], 1e-6);
    multiply(m, one, white);
    for (int c = 0; c < 3; c++)
        g_assert_cmpfloat_with_epsilon(white[c], 1, 1e-14);
}

static void test_colours_are_rounded_once(void)
{
    const double m[3][3] = {{1.75, -0.6, -0.15}, {-0.3, 1.9, -0.6}, {0, -0.7, 1.7}};
    GRand *rand = g_rand_new_with_seed(7);
    for (int k = 0; k < 1000; k++) {
        float rgb[3];
        long double sum[3] = {0}, size[3] = {0};
        for (int c = 0; c < 3; c++)
            rgb[c] = (float)g_rand_double_range(rand, -1, 4);
        for (int r = 0; r < 3; r++)
            for (int c = 0; c < 3; c++) {
                sum[r] += (long double)m[r][c] * (long double)rgb[c];
                size[r] += fabsl((long double)m[r][c] * (long double)rgb[c]);
            }
        ls_colours_apply(m, rgb, 1, rgb);
        for (int c = 0; c < 3; c++)
            g_assert_cmpfloat((double)fabsl((long double)rgb[c] - sum[c]), <=,
                              (double)(fabsl(sum[c]) * 0x1p-24L + size[c] * 0x1p-51L));
    }
    g_rand_free(rand);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/primaries/matrices-say-primaries-and-white", test_primaries_and_white);
    g_test_add_func("/primaries/there-and-back-is-the-identity", test_there_and_back);
    g_test_add_func("/primaries/rec709-to-acescg-is-the-published-matrix",
                    test_acescg_is_the_published_one);
    g_test_add_func("/primaries/colours-are-rounded-once", test_colours_are_rounded_once);
    return g_test_run();
}
