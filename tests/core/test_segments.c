#include "core/segments.h"

#include <glib.h>
#include <math.h>
#include <string.h>

static void fibonacci(float (*d)[3], uint32_t n)
{
    for (uint32_t i = 0; i < n; i++) {
        double z = 1 - (2 * i + 1.0) / n, r = sqrt(1 - z * z), a = i * 2.399963229728653;
        d[i][0] = (float)(r * cos(a));
        d[i][1] = (float)(r * sin(a));
        d[i][2] = (float)z;
    }
}

static void assert_even(const uint32_t *segment, uint32_t n, uint32_t n_segments)
{
    g_autofree uint32_t *size = g_new0(uint32_t, n_segments);
    for (uint32_t i = 0; i < n; i++) {
        g_assert_cmpuint(segment[i], <, n_segments);
        size[segment[i]]++;
    }
    for (uint32_t g = 0; g < n_segments; g++) {
        g_assert_cmpuint(size[g], >=, n / n_segments);
        g_assert_cmpuint(size[g], <=, (n + n_segments - 1) / n_segments);
    }
}

/* Root mean square of the angle between lights and the centre of their segment, in degrees. */
static double spread_deg(const float (*d)[3], uint32_t n, const uint32_t *segment,
                         uint32_t n_segments)
{
    g_autofree double(*centre)[3] = g_malloc_n(n_segments, sizeof *centre);
    g_assert_cmpint(ls_segments_centres(d, n, segment, n_segments, centre, NULL), ==, LS_OK);
    double sum = 0;
    for (uint32_t i = 0; i < n; i++) {
        const double *c = centre[segment[i]];
        double cosine = d[i][0] * c[0] + d[i][1] * c[1] + d[i][2] * c[2];
        double angle = acos(fmin(cosine, 1)) * 180 / M_PI;
        sum += angle * angle;
    }
    return sqrt(sum / n);
}

static void test_segments_are_even_and_compact(void)
{
    enum { N = 346 };
    float d[N][3];
    uint32_t segment[N];
    fibonacci(d, N);
    for (uint32_t g = 1; g <= N; g += g < 30 ? 1 : 37) {
        g_assert_cmpint(ls_segments_partition(d, N, g, segment, NULL), ==, LS_OK);
        assert_even(segment, N, g);
        /* a cap of 4 pi / g sr has half angle t, 1 - cos t = 2 / g, and spread about t / sqrt 2;
         * cells are no caps: a third more */
        double cap = acos(fmax(1 - 2.0 / g, -1)) * 180 / M_PI / sqrt(2);
        if (g >= 4)
            g_assert_cmpfloat(spread_deg(d, N, segment, g), <, 1.35 * cap + 0.1);
    }
}

static void test_the_partition_does_not_change(void)
{
    enum { N = 100 };
    float d[N][3], longer[N][3];
    uint32_t first[N], again[N];
    fibonacci(d, N);
    memcpy(longer, d, sizeof d);
    for (int i = 0; i < N; i++)
        for (int k = 0; k < 3; k++)
            longer[i][k] *= 4; /* any length; a power of two rounds nothing */
    g_assert_cmpint(ls_segments_partition(d, N, 7, first, NULL), ==, LS_OK);
    g_assert_cmpint(ls_segments_partition(longer, N, 7, again, NULL), ==, LS_OK);
    g_assert_cmpmem(first, sizeof first, again, sizeof again);
}

static void test_coincident_lights_and_holes_are_nothing_special(void)
{
    enum { N = 40 };
    float d[N][3];
    uint32_t segment[N];
    double centre[N][3];
    for (int i = 0; i < N; i++) /* all in one place, but for one opposite */
        memcpy(d[i], (float[3]){0, 1, 0}, sizeof d[i]);
    d[17][1] = -1;
    for (uint32_t g = 1; g <= N; g++) {
        g_assert_cmpint(ls_segments_partition(d, N, g, segment, NULL), ==, LS_OK);
        assert_even(segment, N, g);
        g_assert_cmpint(ls_segments_centres(d, N, segment, g, centre, NULL), ==, LS_OK);
        for (uint32_t k = 0; k < g; k++)
            g_assert_cmpfloat_with_epsilon(fabs(centre[k][1]), 1, 1e-12);
    }
    float front[N][3]; /* a hemisphere */
    for (int i = 0; i < N; i++)
        memcpy(front[i], (float[3]){(float)cos(i), (float)sin(i), (float)(i % 5)}, sizeof front[i]);
    g_assert_cmpint(ls_segments_partition(front, N, 6, segment, NULL), ==, LS_OK);
    assert_even(segment, N, 6);
}

static void test_what_is_no_direction_is_refused(void)
{
    float d[3][3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    uint32_t segment[3] = {0};
    double centre[3][3];
    struct ls_diag diag = {0};
    g_assert_cmpint(ls_segments_partition(d, 3, 0, segment, &diag), ==, LS_ERR_INVALID);
    g_assert_cmpint(ls_segments_partition(d, 3, 4, segment, &diag), ==, LS_ERR_INVALID);
    g_assert_cmpint(ls_segments_partition(d, 0, 1, segment, &diag), ==, LS_ERR_INVALID);
    g_assert_cmpint(ls_segments_partition(d, LS_SEGMENTS_MAX_LIGHTS + 1, 1, segment, &diag), ==,
                    LS_ERR_LIMIT);
    g_assert_cmpint(ls_segments_centres(d, 3, segment, 2, centre, &diag), ==, LS_ERR_INVALID);
    segment[2] = 9;
    g_assert_cmpint(ls_segments_centres(d, 3, segment, 2, centre, &diag), ==, LS_ERR_INVALID);
    d[1][1] = 0;
    g_assert_cmpint(ls_segments_partition(d, 3, 2, segment, &diag), ==, LS_ERR_INVALID);
    d[1][1] = NAN;
    g_assert_cmpint(ls_segments_partition(d, 3, 2, segment, &diag), ==, LS_ERR_INVALID);
    g_assert_nonnull(strstr(diag.text, "light 1"));
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/segments/are-even-and-compact", test_segments_are_even_and_compact);
    g_test_add_func("/segments/do-not-change", test_the_partition_does_not_change);
    g_test_add_func("/segments/coincident-lights-and-holes-are-nothing-special",
                    test_coincident_lights_and_holes_are_nothing_special);
    g_test_add_func("/segments/what-is-no-direction-is-refused",
                    test_what_is_no_direction_is_refused);
    return g_test_run();
}
