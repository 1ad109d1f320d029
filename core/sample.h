/*
 * sample: the middle of many numbers, from a bounded sample of them.
 * Layer: core. Threads: any. Ownership: none.
 */
#ifndef LS_CORE_SAMPLE_H
#define LS_CORE_SAMPLE_H

#include <stddef.h>

/** No sample is larger. */
enum { LS_SAMPLES_MAX = 1 << 17 };

/** A step through @n pixels that takes at most LS_SAMPLES_MAX of them; odd, so that it meets every
 * phase of a colour filter. RT-safe. */
static inline size_t ls_sample_step(size_t n)
{
    return (n / LS_SAMPLES_MAX + 1) | 1;
}

/** Median of @n >= 1 values, which are sorted in place; the mean of the middle two if @n is even.
 */
float ls_median(float *values, size_t n);

#endif
