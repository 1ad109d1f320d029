/*
 * accumulate_kernels: the inner loops of ls_accumulate (relight.h), one instance per instruction
 * set. All return the same bits. Layer: core. Threads: any; pure. Users include relight.h; this is
 * for the kernels' own files, their tests and benches.
 */
#ifndef LS_CORE_ACCUMULATE_KERNELS_H
#define LS_CORE_ACCUMULATE_KERNELS_H

#include "core/cpu.h"

#include <stddef.h>
#include <stdint.h>

enum {
    LS_ACCUMULATE_GROUP = 8,   /* pictures per partial sum */
    LS_ACCUMULATE_BLOCK = 6,   /* sums made at a time, at most */
    LS_ACCUMULATE_MOST = 4096, /* pixels of a call: a tile's */
    LS_ACCUMULATE_PANEL = 512, /* pixels taken at a time of many sums */
    LS_ACCUMULATE_ROW = 64,    /* pixels that lie side by side in every sum: a tile's row */
};

/** What to sum. */
struct ls_accumulate_terms {
    const void *const *halfs; /* [n], any alignment */
    const float *weights;     /* as ls_accumulate_pack leaves them; finite */
    uint32_t n, n_sums;       /* each >= 1 */
    void *room;               /* ls_accumulate_room bytes, used meanwhile */
};

struct ls_accumulate_kernels {
    /**
     * For q < n_sums, j < count: sum = 0; then for each group of 8 pictures, the last of what is
     * left: part = 0; part = fmaf(w[i][q], e[i][first + j], part) of its pictures in turn;
     * sum += part. It goes to acc[q * stride + j / 64 * row_stride + j % 64]. An Inf or NaN among
     * the samples e counts as 0, and the function returns how many there were.
     * @count: 1 .. LS_ACCUMULATE_MOST. @acc has room for @count rounded up to 64 pixels; the rest
     * of them may be overwritten with anything. RT-safe.
     */
    unsigned (*sum)(const struct ls_accumulate_terms *terms, uint32_t first, uint32_t count,
                    float *acc, size_t row_stride, size_t stride);
};

extern const struct ls_accumulate_kernels ls_accumulate_kernels_c, ls_accumulate_kernels_avx2,
    ls_accumulate_kernels_avx512;

/** (transfer none). RT-safe. */
const struct ls_accumulate_kernels *ls_accumulate_kernels(enum ls_isa isa);

/** Blocks are as equal as they can be: sums [start(b), start(b + 1)) for b < blocks. RT-safe. */
static inline uint32_t ls_accumulate_blocks(uint32_t n_sums)
{
    return (n_sums + LS_ACCUMULATE_BLOCK - 1) / LS_ACCUMULATE_BLOCK;
}

static inline uint32_t ls_accumulate_block_start(uint32_t n_sums, uint32_t b)
{
    return b * n_sums / ls_accumulate_blocks(n_sums);
}

/** Pictures in whole groups. RT-safe. */
static inline uint32_t ls_accumulate_padded(uint32_t n)
{
    return (n + LS_ACCUMULATE_GROUP - 1) / LS_ACCUMULATE_GROUP * LS_ACCUMULATE_GROUP;
}

/** Bytes of struct ls_accumulate_terms' room: the sums of a tile, or a panel of all pictures.
 * RT-safe. */
static inline size_t ls_accumulate_room(uint32_t n, uint32_t n_sums)
{
    return n_sums <= LS_ACCUMULATE_BLOCK
               ? sizeof(float) * n_sums * LS_ACCUMULATE_MOST
               : sizeof(uint16_t) * LS_ACCUMULATE_PANEL * ls_accumulate_padded(n);
}

/** @packed[n_sums * padded(n)]: block by block, in it picture by picture, the weights @w[i][q], and
 * 0 for the pictures that are missing in the last group. RT-safe. */
void ls_accumulate_pack(const float *const *w, uint32_t n, uint32_t n_sums, float *packed);

#endif
