#include "core/histogram.h"

#include <math.h>

_Static_assert(ATOMIC_LLONG_LOCK_FREE == 2, "counters of 64 bits need no lock");

enum { PER_OCTAVE = 1 << LS_HISTOGRAM_BITS };

static uint32_t bucket_of(uint64_t value)
{
    if (value < 2 * PER_OCTAVE)
        return (uint32_t)value;
    uint32_t octave = 63 - (uint32_t)__builtin_clzll(value) - LS_HISTOGRAM_BITS;
    return octave * PER_OCTAVE + (uint32_t)(value >> octave);
}

static uint64_t lowest_of(uint32_t bucket)
{
    if (bucket < 2 * PER_OCTAVE)
        return bucket;
    return (uint64_t)(bucket % PER_OCTAVE + PER_OCTAVE) << (bucket / PER_OCTAVE - 1);
}

static uint64_t middle_of(uint32_t bucket)
{
    uint64_t width = bucket < 2 * PER_OCTAVE ? 1 : 1ull << (bucket / PER_OCTAVE - 1);
    return lowest_of(bucket) + width / 2;
}

static uint64_t get(const _Atomic uint64_t *counter)
{
    return atomic_load_explicit(counter, memory_order_relaxed);
}

void ls_histogram_add(struct ls_histogram *histogram, uint64_t value)
{
    atomic_fetch_add_explicit(&histogram->buckets[bucket_of(value)], 1, memory_order_relaxed);
    atomic_fetch_add_explicit(&histogram->sum, value, memory_order_relaxed);
    uint64_t max = get(&histogram->max);
    while (max < value &&
           !atomic_compare_exchange_weak_explicit(&histogram->max, &max, value,
                                                  memory_order_relaxed, memory_order_relaxed))
        ;
}

static uint64_t count_of(const struct ls_histogram *histogram, uint32_t n_buckets)
{
    uint64_t n = 0;
    for (uint32_t i = 0; i < n_buckets; i++)
        n += get(&histogram->buckets[i]);
    return n;
}

uint64_t ls_histogram_quantile(const struct ls_histogram *histogram, double q)
{
    uint64_t n = count_of(histogram, LS_HISTOGRAM_BUCKETS), below = 0;
    double wanted = ceil(q * (double)n);
    uint64_t rank = wanted < 1 ? 1 : (uint64_t)wanted;
    for (uint32_t i = 0; i < LS_HISTOGRAM_BUCKETS; i++) {
        below += get(&histogram->buckets[i]);
        if (below < rank)
            continue;
        uint64_t max = get(&histogram->max), middle = middle_of(i);
        return middle > max ? max : middle;
    }
    return 0;
}

struct ls_histogram_summary ls_histogram_summary(const struct ls_histogram *histogram)
{
    return (struct ls_histogram_summary){.count = count_of(histogram, LS_HISTOGRAM_BUCKETS),
                                         .sum = get(&histogram->sum),
                                         .max = get(&histogram->max),
                                         .p50 = ls_histogram_quantile(histogram, 0.5),
                                         .p99 = ls_histogram_quantile(histogram, 0.99)};
}

uint64_t ls_histogram_below(const struct ls_histogram *histogram, uint64_t limit)
{
    return count_of(histogram, bucket_of(limit));
}
