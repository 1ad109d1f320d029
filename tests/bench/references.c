#include "tests/bench/references.h"

#include <math.h>
#include <string.h>

/* part @t of n, in whole cache lines */
static size_t part(size_t bytes, unsigned t, unsigned n)
{
    return t == n ? bytes : bytes / 64 * t / n * 64;
}

static void copy_part(void *data, unsigned t, unsigned n)
{
    const struct reference_bytes *b = data;
    size_t from = part(b->bytes, t, n), to = part(b->bytes, t + 1, n);
    memcpy((char *)b->to + from, (const char *)b->from + from, to - from);
}

void reference_copy(void *bytes)
{
    bench_parallel(((struct reference_bytes *)bytes)->n_threads, copy_part, bytes);
}

/* four sums, so that the adds do not wait for each other; vectors by the compiler */
static void read_part(void *data, unsigned t, unsigned n)
{
    struct reference_bytes *b = data;
    size_t from = part(b->bytes, t, n), to = part(b->bytes, t + 1, n);
    uint64_t sum[8] = {0};
    for (size_t i = from; i + 64 <= to; i += 64) {
        uint64_t line[8];
        memcpy(line, (const char *)b->from + i, 64);
        for (int k = 0; k < 8; k++)
            sum[k] += line[k];
    }
    for (int k = 0; k < 8; k++)
        __atomic_fetch_add(&b->sum, sum[k], __ATOMIC_RELAXED);
}

void reference_read(void *bytes)
{
    bench_parallel(((struct reference_bytes *)bytes)->n_threads, read_part, bytes);
}

uint64_t reference_fma_c(uint64_t steps, double *sum)
{
    float lane[16];
    for (int k = 0; k < 16; k++)
        lane[k] = (float)k;
    for (uint64_t i = 0; i < steps; i++)
        for (int k = 0; k < 16; k++)
            lane[k] = fmaf(lane[k], 0.999f, 1e-3f);
    for (int k = 0; k < 16; k++)
        *sum += (double)lane[k];
    return 16 * steps;
}

static void fma_part(void *data, unsigned t, unsigned n)
{
    struct reference_fma *fma = data;
    double sum = 0;
    uint64_t done = LS_ISA_PICK(fma->isa, reference_fma_c, reference_fma_avx2,
                                reference_fma_avx512)(fma->n, &sum);
    __atomic_fetch_add(&fma->done, done, __ATOMIC_RELAXED);
    if (t == 0)
        fma->sum = sum;
}

void reference_fma(void *data)
{
    struct reference_fma *fma = data;
    fma->done = 0;
    bench_parallel(fma->n_threads, fma_part, fma);
}
