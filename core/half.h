/*
 * half: IEEE 754 binary16 to and from float, one value or a span.
 * Layer: core. Threads: any. Ownership: none, everything is the caller's.
 *
 * Conversions follow IEEE 754 and the F16C instructions bit for bit: round to nearest, ties to
 * even; denormals kept; overflow (magnitude >= 65520) to infinity; a NaN stays a NaN with its sign
 * and the top ten bits of its payload, made quiet. Widening is exact.
 * Largest finite 65504; smallest normal 2^-14 (6.1e-5); smallest denormal 2^-24 (6.0e-8); relative
 * error of a normal value <= 2^-11 (4.9e-4).
 */
#ifndef LS_CORE_HALF_H
#define LS_CORE_HALF_H

#include <stddef.h>
#include <stdint.h>

#define LS_HALF_MAX 65504.0f

/** Nearest half, as its bits. RT-safe. */
uint16_t ls_half_from_float(float value);

/** The value of a half given as its bits; exact. RT-safe. */
float ls_half_to_float(uint16_t bits);

/** @n values from @in to @out, which must not overlap; any alignment of elements. The
 * result is the same bits on every processor. RT-safe. */
void ls_half_from_floats(const float *in, uint16_t *out, size_t n);

/** As ls_half_from_floats, widening. RT-safe. */
void ls_half_to_floats(const uint16_t *in, float *out, size_t n);

#endif
