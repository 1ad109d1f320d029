/*
 * histogram: how often values of what size occurred, counted without locks, in fixed memory.
 * Layer: core. Threads: add from any number at once, read from any while they add. Ownership:
 * embedded, no heap; all zero is an empty one.
 *
 * Buckets are logarithmic: values below 64 have one each; above, every octave [2^k, 2^(k+1)) is cut
 * into 32 of equal width, so a bucket is at most 1/32 of the values in it wide. A quantile is the
 * middle of the bucket it lies in, hence within 1/64 (1.6 %) of the exact one, and never above the
 * largest value; that one is kept exactly. Worked values: 63 lies in a bucket of its own; 1000000
 * in [999424, 1015808), whose middle is 1007616.
 */
#ifndef LS_CORE_HISTOGRAM_H
#define LS_CORE_HISTOGRAM_H

#include <stdatomic.h>
#include <stdint.h>

enum {
    LS_HISTOGRAM_BITS = 5, /* log2 of the buckets of an octave */
    LS_HISTOGRAM_BUCKETS = (64 - LS_HISTOGRAM_BITS + 1) << LS_HISTOGRAM_BITS,
};

struct ls_histogram {
    _Atomic uint64_t buckets[LS_HISTOGRAM_BUCKETS];
    _Atomic uint64_t sum, max;
};

/** Count @value, whatever its unit. Neither waits nor locks. RT-safe. */
void ls_histogram_add(struct ls_histogram *histogram, uint64_t value);

/** What had been counted at some moment; values added meanwhile may be missing from parts of it. */
struct ls_histogram_summary {
    uint64_t count, sum, max;
    uint64_t p50, p99; /* by nearest rank, to 1/64 */
};

struct ls_histogram_summary ls_histogram_summary(const struct ls_histogram *histogram);

/** The value of rank ceil(@q * count) in ascending order, to 1/64; @q in [0, 1], rank at least 1.
 * 0 if nothing was counted. */
uint64_t ls_histogram_quantile(const struct ls_histogram *histogram, double q);

/** Values counted that are below @limit, a power of two: exact, as that is a border of buckets. */
uint64_t ls_histogram_below(const struct ls_histogram *histogram, uint64_t limit);

#endif
