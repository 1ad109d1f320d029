/* smooth_order: neighbours follow each other. */
#include "core/smooth_order.h"

#include <glib.h>
#include <math.h>

enum { N = 346 };

/* An even sphere along a spiral from top to bottom: neighbouring rows are far apart. */
static void spiral(float (*d)[3], uint32_t n)
{
    for (uint32_t i = 0; i < n; i++) {
        double y = 1 - (2 * i + 1.0) / n, r = sqrt(1 - y * y), a = i * 2.399963229728653;
        d[i][0] = (float)(1.35 * r * cos(a));
        d[i][1] = (float)(1.35 * y);
        d[i][2] = (float)(1.35 * r * sin(a));
    }
}

static double mean_nearest(float (*d)[3], uint32_t n)
{
    double sum = 0;
    for (uint32_t i = 0; i < n; i++) {
        double best = 9;
        for (uint32_t j = 0; j < n; j++) {
            const float two[2][3] = {{d[i][0], d[i][1], d[i][2]}, {d[j][0], d[j][1], d[j][2]}};
            best = i == j ? best : fmin(best, ls_smooth_order_step(two, 2, (uint32_t[]){0, 1}));
        }
        sum += best;
    }
    return sum / n;
}

static void expect_permutation(const uint32_t *order, uint32_t n)
{
    gboolean *seen = g_new0(gboolean, n);
    for (uint32_t i = 0; i < n; i++) {
        g_assert_cmpuint(order[i], <, n);
        g_assert_false(seen[order[i]]);
        seen[order[i]] = TRUE;
    }
    g_free(seen);
}

static void test_step(void)
{
    float d[N][3];
    uint32_t order[N], rows[N], again[N];
    spiral(d, N);
    for (uint32_t i = 0; i < N; i++)
        rows[i] = i;
    g_assert_cmpint(ls_smooth_order((const float(*)[3])d, N, order, NULL), ==, LS_OK);
    expect_permutation(order, N);
    double smooth = ls_smooth_order_step((const float(*)[3])d, N, order);
    double by_row = ls_smooth_order_step((const float(*)[3])d, N, rows);
    double nearest = mean_nearest(d, N);
    g_test_message("degrees: nearest %.2f, smooth %.2f, by row %.2f", nearest * 180 / G_PI,
                   smooth * 180 / G_PI, by_row * 180 / G_PI);
    g_assert_cmpfloat(smooth, >=, nearest * 0.999); /* no path is shorter; floats of positions */
    g_assert_cmpfloat(smooth, <, 1.15 * nearest);
    g_assert_cmpfloat(by_row, >, 5 * smooth);
    g_assert_cmpint(ls_smooth_order((const float(*)[3])d, N, again, NULL), ==, LS_OK);
    for (uint32_t i = 0; i < N; i++)
        g_assert_cmpuint(order[i], ==, again[i]);
}

static void test_odd_domes(void)
{
    float same[5][3] = {{0, 1, 0}, {0, 1, 0}, {0, 1, 0}, {1, 0, 0}, {0, 1, 0}};
    const float none[2][3] = {{0, 1, 0}, {0, 0, 0}};
    uint32_t order[5];
    struct ls_diag diag = {{0}};
    for (uint32_t n = 0; n <= 5; n++) {
        g_assert_cmpint(ls_smooth_order((const float(*)[3])same, n, order, NULL), ==, LS_OK);
        expect_permutation(order, n);
    }
    /* the lone light at an end: one step of a right angle among four */
    g_assert_cmpfloat(fabs(ls_smooth_order_step((const float(*)[3])same, 5, order) - G_PI / 2 / 4),
                      <, 1e-6);
    g_assert_cmpint(ls_smooth_order(none, 2, order, &diag), ==, LS_ERR_INVALID);
    g_assert_cmpstr(diag.text, ==, "light 1 has no direction");
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/smooth-order/a-step-is-hardly-longer-than-to-the-nearest-light", test_step);
    g_test_add_func("/smooth-order/coincident-and-few-lights-are-put-in-order", test_odd_domes);
    return g_test_run();
}
