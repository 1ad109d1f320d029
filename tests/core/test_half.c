#include "core/half.h"

#include "core/half_kernels.h"
#include "tests/core/isas.h"
#include "tests/core/noise.h"

#include <glib.h>
#include <math.h>
#include <string.h>

static float from_bits(uint32_t bits)
{
    float value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

static uint32_t bits_of(float value)
{
    uint32_t bits;
    memcpy(&bits, &value, sizeof bits);
    return bits;
}

/* The value of a half from its definition, in double. */
static double defined_value(uint16_t h)
{
    double sign = h & 0x8000 ? -1 : 1, mantissa = h & 0x3ff;
    int exponent = h >> 10 & 0x1f;

    if (exponent == 31)
        return mantissa ? NAN : sign * INFINITY;
    return sign * (exponent ? ldexp(1024 + mantissa, exponent - 25) : ldexp(mantissa, -24));
}

static void test_widening(void)
{
    for (uint32_t h = 0; h < 0x10000; h++) {
        double expected = defined_value((uint16_t)h), got = ls_half_to_float((uint16_t)h);
        if (isnan(expected))
            g_assert_true(isnan(got));
        else
            g_assert_true(got == expected && signbit(got) == signbit(expected));
    }
}

static void test_round_trip(void)
{
    for (uint32_t h = 0; h < 0x10000; h++) {
        int nan = (h & 0x7c00) == 0x7c00 && h & 0x3ff;
        uint32_t expected = nan ? h | 0x200 : h; /* NaNs come back quiet */
        g_assert_cmphex(ls_half_from_float(ls_half_to_float((uint16_t)h)), ==, expected);
    }
}

/* Between each two neighbouring halves: just below, at and just above the midpoint. */
static void test_rounding(void)
{
    for (uint16_t h = 0; h < 0x7bff; h++) {
        float low = ls_half_to_float(h), high = ls_half_to_float((uint16_t)(h + 1));
        float middle = (low + high) / 2; /* exact in float */
        uint16_t even = h & 1 ? (uint16_t)(h + 1) : h;
        g_assert_cmphex(ls_half_from_float(middle), ==, even);
        g_assert_cmphex(ls_half_from_float(nextafterf(middle, 0)), ==, h);
        g_assert_cmphex(ls_half_from_float(nextafterf(middle, INFINITY)), ==, h + 1);
        g_assert_cmphex(ls_half_from_float(-middle), ==, even | 0x8000);
    }
}

static void test_limits(void)
{
    g_assert_cmphex(ls_half_from_float(65504), ==, 0x7bff);
    g_assert_cmphex(ls_half_from_float(nextafterf(65520, 0)), ==, 0x7bff);
    g_assert_cmphex(ls_half_from_float(65520), ==, 0x7c00);
    g_assert_cmphex(ls_half_from_float(-1e30f), ==, 0xfc00);
    g_assert_cmphex(ls_half_from_float(INFINITY), ==, 0x7c00);
    g_assert_cmphex(ls_half_from_float(0x1p-25f), ==, 0);
    g_assert_cmphex(ls_half_from_float(nextafterf(0x1p-25f, 1)), ==, 1);
    g_assert_cmphex(ls_half_from_float(from_bits(1)), ==, 0);
    g_assert_cmphex(ls_half_from_float(from_bits(0x80000001)), ==, 0x8000);
    g_assert_cmphex(ls_half_from_float(from_bits(0x7f800001)), ==, 0x7e00);
    g_assert_cmphex(ls_half_from_float(from_bits(0xffc02000)), ==, 0xfe01);
}

static void check_span(const struct ls_half_kernels *k, const float *in, size_t n, size_t shift)
{
    static uint16_t half[4200];
    static float back[4200];

    k->from_floats(in, half + shift, n);
    for (size_t i = 0; i < n; i++)
        g_assert_cmphex(half[shift + i], ==, ls_half_from_float(in[i]));
    k->to_floats(half + shift, back + shift, n);
    for (size_t i = 0; i < n; i++)
        g_assert_cmphex(bits_of(back[shift + i]), ==, bits_of(ls_half_to_float(half[shift + i])));
}

/* Every exponent and sign with random mantissas, and all boundary values. */
static void test_spans(const void *data)
{
    const struct ls_half_kernels *k = ls_half_kernels(isas_of(data));
    enum { N = 4096, SEED = 7 };
    struct noise noise = {SEED};
    static float in[N];

    g_test_message("seed %d", SEED);
    for (int round = 0; round < 50; round++) {
        for (size_t i = 0; i < N; i++) {
            uint32_t r = (uint32_t)noise_bits(&noise);
            uint32_t exponent = round & 1 ? r >> 23 & 0xff : 100 + (r >> 23) % 45;
            uint32_t mantissa = round % 3 ? r & 0x7fffff : r & 0x7ff000;
            in[i] = from_bits((r & 0x80000000) | exponent << 23 | mantissa);
        }
        check_span(k, in, N, (size_t)round % 4);
    }
    for (size_t n = 0; n < 40; n++)
        check_span(k, in + n, n, n);
}

static void test_all_halves_as_spans(const void *data)
{
    static uint16_t in[0x10000];
    static float out[0x10000];

    for (uint32_t h = 0; h < 0x10000; h++)
        in[h] = (uint16_t)h;
    ls_half_kernels(isas_of(data))->to_floats(in, out, 0x10000);
    for (uint32_t h = 0; h < 0x10000; h++)
        g_assert_cmphex(bits_of(out[h]), ==, bits_of(ls_half_to_float((uint16_t)h)));
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/half/every-half-widens-to-its-defined-value", test_widening);
    g_test_add_func("/half/every-half-survives-the-round-trip", test_round_trip);
    g_test_add_func("/half/ties-go-to-even-between-all-neighbours", test_rounding);
    g_test_add_func("/half/limits-denormals-infinities-and-nans-follow-ieee-754", test_limits);
    isas_add("/half/spans-give-the-bits-of-single-values", test_spans);
    isas_add("/half/spans-widen-every-half-alike", test_all_halves_as_spans);
    return g_test_run();
}
