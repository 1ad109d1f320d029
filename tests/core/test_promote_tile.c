#include "core/promote_tile_kernels.h"

#include "core/half.h"
#include "tests/core/isas.h"
#include "tests/core/noise.h"

#include <glib.h>
#include <math.h>
#include <string.h>

enum { SPECTRA = 5, ALL = 0x10000 };

/* White samples, ratios and results; results are followed by a mark that must stay. */
struct spans {
    size_t n;
    uint16_t *white, *ratio[SPECTRA], *out[SPECTRA];
};

static struct spans spans_new(size_t n)
{
    struct spans s = {.n = n, .white = g_new(uint16_t, n)};
    for (int k = 0; k < SPECTRA; k++) {
        s.ratio[k] = g_new(uint16_t, n);
        s.out[k] = g_new(uint16_t, n + 1);
        s.out[k][n] = 0xabcd;
    }
    return s;
}

static void spans_free(struct spans *s)
{
    g_free(s->white);
    for (int k = 0; k < SPECTRA; k++) {
        g_free(s->ratio[k]);
        g_free(s->out[k]);
    }
}

static size_t promote(struct spans *s, enum ls_isa isa, float gain)
{
    const uint16_t *ratio[SPECTRA];
    memcpy(ratio, s->ratio, sizeof ratio);
    struct ls_promote_tile tile = {s->white, SPECTRA, ratio, s->out, s->n, gain};
    size_t lost = ls_promote_tile_kernels(isa)->run(&tile);
    for (int k = 0; k < SPECTRA; k++)
        g_assert_cmphex(s->out[k][s->n], ==, 0xabcd);
    return lost;
}

/* Every half as a white sample, against halves of every kind. */
static void fill(struct spans *s, struct noise *noise)
{
    static const uint16_t kinds[] = {0,      0x8000, 1,      0x83ff, 0x0400, 0x3c00,
                                     0xbc00, 0x7bff, 0x7c00, 0xfc00, 0x7e01};
    for (size_t j = 0; j < s->n; j++) {
        s->white[j] = (uint16_t)(s->n == ALL ? j : noise_bits(noise));
        for (int k = 0; k < SPECTRA; k++) {
            uint64_t bits = noise_bits(noise);
            s->ratio[k][j] =
                bits >> 32 & 1 ? (uint16_t)bits : kinds[(bits & 0xffff) % G_N_ELEMENTS(kinds)];
        }
    }
}

static bool is_finite_half(uint16_t bits)
{
    return (bits & 0x7c00) != 0x7c00;
}

/* A product of two halves and a float has 46 bits: exact in double. */
static double exact(uint16_t white, uint16_t ratio, float gain)
{
    return (double)ls_half_to_float(white) * (double)gain * (double)ls_half_to_float(ratio);
}

static void check(const struct spans *s, float gain, size_t lost)
{
    size_t broken = 0;

    for (int k = 0; k < SPECTRA; k++)
        for (size_t j = 0; j < s->n; j++) {
            double got = (double)ls_half_to_float(s->out[k][j]);
            if (!is_finite_half(s->white[j]) || !is_finite_half(s->ratio[k][j])) {
                g_assert_cmphex(s->out[k][j], ==, 0);
                broken++;
                continue;
            }
            double want = exact(s->white[j], s->ratio[k][j], gain);
            want = fmax(-(double)LS_HALF_MAX, fmin((double)LS_HALF_MAX, want));
            /* The header's bound: half an ulp of half, and of the float that carries the gain. */
            g_assert_cmpfloat(fabs(got - want), <=,
                              fabs(want) * (0x1p-11 + 0x1p-23) + 0x1p-25 * (1 + 1e-6));
        }
    g_assert_cmpuint(lost, ==, broken);
}

static void test_bound(const void *data)
{
    enum { SEED = 51 };
    struct noise noise = {SEED};
    static const float gains[] = {1, 0.7853982f, -1.1f, 1e-3f, 1e24f, 1e-24f, 0};

    g_test_message("seed %d", SEED);
    for (size_t g = 0; g < G_N_ELEMENTS(gains); g++) {
        struct spans s = spans_new(ALL);
        fill(&s, &noise);
        check(&s, gains[g], promote(&s, isas_of(data), gains[g]));
        spans_free(&s);
    }
}

/* With a power of two as gain nothing is rounded before the half. */
static void test_nearest(const void *data)
{
    enum { SEED = 52 };
    struct noise noise = {SEED};
    struct spans s = spans_new(ALL);

    g_test_message("seed %d", SEED);
    fill(&s, &noise);
    promote(&s, isas_of(data), 0.5f);
    for (int k = 0; k < SPECTRA; k++)
        for (size_t j = 0; j < s.n; j++) {
            double want = exact(s.white[j], s.ratio[k][j], 0.5f);
            if (fabs(want) <= (double)LS_HALF_MAX)
                g_assert_cmphex(s.out[k][j], ==, ls_half_from_float((float)want));
        }
    spans_free(&s);
}

static void test_same_bits(const void *data)
{
    enum { SEED = 53 };
    struct noise noise = {SEED};

    g_test_message("seed %d", SEED);
    for (size_t n = 1; n < 3000; n = n < 40 ? n + 1 : n * 3 + 1) {
        struct spans s = spans_new(n), c = spans_new(n);
        fill(&s, &noise);
        memcpy(c.white, s.white, n * sizeof *s.white);
        for (int k = 0; k < SPECTRA; k++)
            memcpy(c.ratio[k], s.ratio[k], n * sizeof *s.white);
        g_assert_cmpuint(promote(&s, isas_of(data), 0.3f), ==, promote(&c, LS_ISA_C, 0.3f));
        for (int k = 0; k < SPECTRA; k++)
            g_assert_cmpmem(s.out[k], n * sizeof *s.white, c.out[k], n * sizeof *s.white);
        spans_free(&s);
        spans_free(&c);
    }
}

/* A tile of 1 x 1, cut out of a larger one anywhere, has the bits that it had there. */
static void test_splits(const void *data)
{
    enum { SEED = 54, N = 2100 };
    struct noise noise = {SEED};
    struct spans s = spans_new(N);

    g_test_message("seed %d", SEED);
    fill(&s, &noise);
    promote(&s, isas_of(data), 1.7f);
    for (size_t j = 0, n; j < N; j += n) {
        uint16_t out[64];
        n = 1 + noise_bits(&noise) % 63;
        n = n < N - j ? n : N - j;
        const uint16_t *ratio = s.ratio[0] + j;
        uint16_t *to = out;
        struct ls_promote_tile tile = {s.white + j, 1, &ratio, &to, n, 1.7f};
        ls_promote_tile_kernels(isas_of(data))->run(&tile);
        g_assert_cmpmem(out, n * sizeof *out, s.out[0] + j, n * sizeof *out);
    }
    spans_free(&s);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    isas_add("/promote-tile/every-half-is-within-the-bound-and-broken-ones-are-counted",
             test_bound);
    isas_add("/promote-tile/without-a-gain-the-exact-product-is-rounded-once", test_nearest);
    isas_add("/promote-tile/every-instruction-set-gives-the-bits-of-c", test_same_bits);
    isas_add("/promote-tile/any-split-gives-the-same-bits", test_splits);
    return g_test_run();
}
