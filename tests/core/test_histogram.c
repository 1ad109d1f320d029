#include "core/histogram.h"

#include <glib.h>
#include <math.h>
#include <stdlib.h>

enum { VALUES = 20000, WRITERS = 4 };

static int ascending(const void *a, const void *b)
{
    uint64_t x = *(const uint64_t *)a, y = *(const uint64_t *)b;
    return x < y ? -1 : x > y;
}

/* What is printed makes the run again. */
static GRand *seeded(void)
{
    guint32 seed = g_test_rand_int();
    g_test_message("seed %u", seed);
    return g_rand_new_with_seed(seed);
}

/* Sizes from 1 to 2^@octaves, every octave as likely as another. */
static uint64_t *draw(GRand *rand, size_t n, double octaves)
{
    uint64_t *values = g_new(uint64_t, n);
    for (size_t i = 0; i < n; i++)
        values[i] = (uint64_t)exp2(g_rand_double_range(rand, 0, octaves));
    return values;
}

static void fill(struct ls_histogram *histogram, const uint64_t *values, size_t n)
{
    for (size_t i = 0; i < n; i++)
        ls_histogram_add(histogram, values[i]);
}

/* The header's bound: half a bucket, which is 1/32 of its lower border wide; one more for whole
 * numbers. */
static void assert_close(uint64_t found, uint64_t exact)
{
    g_assert_cmpfloat(fabs((double)found - (double)exact), <=, (double)exact / 64 + 1);
}

static void check_quantiles(GRand *rand, size_t n, double octaves)
{
    static const double asked[] = {0, 0.001, 0.25, 0.5, 0.9, 0.99, 0.999, 1};
    struct ls_histogram *histogram = g_new0(struct ls_histogram, 1);
    uint64_t *values = draw(rand, n, octaves);
    fill(histogram, values, n);
    qsort(values, n, sizeof *values, ascending);
    for (size_t i = 0; i < G_N_ELEMENTS(asked); i++) {
        size_t rank = (size_t)ceil(asked[i] * (double)n);
        assert_close(ls_histogram_quantile(histogram, asked[i]), values[rank ? rank - 1 : 0]);
    }
    g_assert_cmpuint(ls_histogram_summary(histogram).max, ==, values[n - 1]);
    g_free(values);
    g_free(histogram);
}

static void test_quantiles(void)
{
    GRand *rand = seeded();
    for (size_t n = 1; n <= VALUES; n = 3 * n + 1)
        check_quantiles(rand, n, 34); /* nanoseconds up to 17 s */
    check_quantiles(rand, VALUES, 3);
    check_quantiles(rand, VALUES, 63.9);
    g_rand_free(rand);
}

static void test_borders(void)
{
    for (unsigned k = 0; k < 64; k++)
        for (int by = -1; by <= 1; by++) {
            uint64_t value = (1ull << k) + (uint64_t)by;
            struct ls_histogram histogram = {0};
            ls_histogram_add(&histogram, value);
            g_assert_cmpuint(ls_histogram_quantile(&histogram, 0.5), <=, value);
            assert_close(ls_histogram_quantile(&histogram, 0.5), value);
            g_assert_cmpuint(ls_histogram_below(&histogram, 1ull << k), ==, by < 0);
        }
}

static void test_ends(void)
{
    struct ls_histogram histogram = {0};
    g_assert_cmpuint(ls_histogram_summary(&histogram).count, ==, 0);
    g_assert_cmpuint(ls_histogram_quantile(&histogram, 0.99), ==, 0);
    ls_histogram_add(&histogram, 0);
    ls_histogram_add(&histogram, UINT64_MAX);
    g_assert_cmpuint(ls_histogram_quantile(&histogram, 0), ==, 0);
    g_assert_cmpuint(ls_histogram_summary(&histogram).max, ==, UINT64_MAX);
    g_assert_cmpuint(ls_histogram_summary(&histogram).count, ==, 2);
}

static void test_below(void)
{
    GRand *rand = seeded();
    struct ls_histogram histogram = {0};
    uint64_t *values = draw(rand, VALUES, 40);
    fill(&histogram, values, VALUES);
    for (unsigned k = 0; k < 42; k++) {
        uint64_t exact = 0;
        for (size_t i = 0; i < VALUES; i++)
            exact += values[i] < 1ull << k;
        g_assert_cmpuint(ls_histogram_below(&histogram, 1ull << k), ==, exact);
    }
    g_free(values);
    g_rand_free(rand);
}

struct writer {
    struct ls_histogram *histogram;
    uint64_t *values;
};

static gpointer write_all(gpointer data)
{
    struct writer *writer = data;
    fill(writer->histogram, writer->values, VALUES);
    return NULL;
}

static void test_writers(void)
{
    GRand *rand = seeded();
    struct ls_histogram together = {0}, alone = {0};
    struct writer writers[WRITERS];
    GThread *threads[WRITERS];
    for (int i = 0; i < WRITERS; i++) {
        writers[i] = (struct writer){&together, draw(rand, VALUES, 30)};
        fill(&alone, writers[i].values, VALUES);
    }
    for (int i = 0; i < WRITERS; i++)
        threads[i] = g_thread_new("writer", write_all, &writers[i]);
    for (int i = 0; i < WRITERS; i++) {
        g_thread_join(threads[i]);
        g_free(writers[i].values);
    }
    struct ls_histogram_summary a = ls_histogram_summary(&together);
    struct ls_histogram_summary b = ls_histogram_summary(&alone);
    g_assert_cmpmem(&a, sizeof a, &b, sizeof b);
    g_assert_cmpuint(a.count, ==, WRITERS * VALUES);
    g_rand_free(rand);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/histogram/quantiles-are-within-a-64th-of-the-exact-ones", test_quantiles);
    g_test_add_func("/histogram/every-power-of-two-is-a-border", test_borders);
    g_test_add_func("/histogram/nothing-zero-and-the-largest-value-have-their-place", test_ends);
    g_test_add_func("/histogram/counts-below-a-power-of-two-are-exact", test_below);
    g_test_add_func("/histogram/threads-adding-at-once-lose-nothing", test_writers);
    return g_test_run();
}
