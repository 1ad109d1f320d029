#include "core/half.h"

#include "core/half_kernels.h"

#include <string.h>

uint16_t ls_half_from_float(float value)
{
    uint32_t bits;
    memcpy(&bits, &value, sizeof bits);
    uint32_t sign = bits >> 16 & 0x8000, magnitude = bits & 0x7fffffff;

    if (magnitude > 0x7f800000) /* NaN */
        return (uint16_t)(sign | 0x7e00 | (magnitude >> 13 & 0x3ff));
    if (magnitude >= 0x477ff000) /* 65520 and above round to infinity */
        return (uint16_t)(sign | 0x7c00);
    if (magnitude >= 0x38800000) { /* normal: re-bias by 112, drop 13 bits; a carry is welcome */
        uint32_t rounded = magnitude + 0xfff + (magnitude >> 13 & 1) - (112u << 23);
        return (uint16_t)(sign | rounded >> 13);
    }
    if (magnitude < 0x33000000) /* below half of the smallest denormal */
        return (uint16_t)sign;
    uint32_t mantissa = (magnitude & 0x7fffff) | 0x800000;
    uint32_t shift = 126 - (magnitude >> 23); /* 14 .. 24: units of 2^-24 */
    uint32_t floor = mantissa >> shift, rest = mantissa & ((1u << shift) - 1);
    uint32_t tie = 1u << (shift - 1);
    return (uint16_t)(sign | (floor + (rest > tie || (rest == tie && floor & 1))));
}

float ls_half_to_float(uint16_t bits)
{
    uint32_t sign = (bits & 0x8000u) << 16, exponent = bits >> 10 & 0x1f, mantissa = bits & 0x3ff;
    uint32_t out;
    float value;

    if (exponent == 0) { /* zero or denormal: mantissa x 2^-24 is exact */
        value = (float)mantissa * 0x1p-24f;
        memcpy(&out, &value, sizeof out);
        out |= sign;
    } else if (exponent == 31) {
        out = sign | 0x7f800000 | (mantissa ? 0x400000 | mantissa << 13 : 0);
    } else {
        out = sign | (exponent + 112) << 23 | mantissa << 13;
    }
    memcpy(&value, &out, sizeof value);
    return value;
}

static void from_floats(const float *in, uint16_t *out, size_t n)
{
    for (size_t i = 0; i < n; i++)
        out[i] = ls_half_from_float(in[i]);
}

static void to_floats(const uint16_t *in, float *out, size_t n)
{
    for (size_t i = 0; i < n; i++)
        out[i] = ls_half_to_float(in[i]);
}

const struct ls_half_kernels ls_half_kernels_c = {from_floats, to_floats};

const struct ls_half_kernels *ls_half_kernels(enum ls_isa isa)
{
    return LS_ISA_PICK(isa, &ls_half_kernels_c, &ls_half_kernels_avx2, &ls_half_kernels_avx512);
}

void ls_half_from_floats(const float *in, uint16_t *out, size_t n)
{
    ls_half_kernels(ls_cpu_isa())->from_floats(in, out, n);
}

void ls_half_to_floats(const uint16_t *in, float *out, size_t n)
{
    ls_half_kernels(ls_cpu_isa())->to_floats(in, out, n);
}
