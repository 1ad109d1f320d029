/*
 * promote_tile_lanes: the text of the promote_tile kernels; each instruction set includes it once
 * and names its instance.
 * Layer: core, inside promote_tile only. Threads: any. Ownership: none.
 */
#ifndef LS_CORE_PROMOTE_TILE_LANES_H
#define LS_CORE_PROMOTE_TILE_LANES_H

#include "core/lanes.h"
#include "core/promote_tile_kernels.h"

#include <float.h>

/* LANES products as halves; what is not finite becomes 0. *finite: a mask of those that were. */
LANES_INLINE halves promote_lanes(floats white, floats ratio, ints *finite)
{
    floats v = white * ratio;
    *finite = lanes_magnitude(v) <= FLT_MAX;
    return lanes_to_half(lanes_clamp_half(lanes_keep(*finite, v)));
}

/* White samples with their gain, @n of them; zeros after them where they end within LANES. */
LANES_INLINE void widen_white(const uint16_t *white, float gain, size_t n, floats *out)
{
    uint16_t rest[LANES] = {0};
    size_t j = 0;
    for (; j + LANES <= n; j += LANES)
        out[j / LANES] = lanes_load_half(white + j) * gain;
    memcpy(rest, white + j, (n - j) * sizeof *rest);
    if (n > j)
        out[j / LANES] = lanes_load_half(rest) * gain;
}

/* Returns how many products were not finite. */
LANES_INLINE size_t promote_block(const floats *white, const uint16_t *ratio, size_t n,
                                  uint16_t *out)
{
    uint16_t rest[2][LANES] = {{0}};
    ints finite, lost = {0};
    size_t j = 0, sum = 0;
    for (; j + LANES <= n; j += LANES) {
        lanes_store_half(out + j,
                         promote_lanes(white[j / LANES], lanes_load_half(ratio + j), &finite));
        lost += finite + 1;
    }
    if (n > j) {
        memcpy(rest[0], ratio + j, (n - j) * sizeof *ratio);
        lanes_store_half(rest[1],
                         promote_lanes(white[j / LANES], lanes_load_half(rest[0]), &finite));
        memcpy(out + j, rest[1], (n - j) * sizeof *out);
        lost += finite + 1;
    }
    for (int k = 0; k < LANES; k++)
        sum += (size_t)lost[k];
    return sum;
}

/* The white samples of a block are widened once and wait in the first-level cache for every
 * spectrum; one spectrum at a time keeps the streams from memory few. */
LANES_INLINE size_t promote_tile(const struct ls_promote_tile *tile)
{
    enum { BLOCK = 1024 };
    floats white[BLOCK / LANES];
    size_t lost = 0;

    for (size_t first = 0; first < tile->n; first += BLOCK) {
        size_t n = tile->n - first < BLOCK ? tile->n - first : BLOCK;
        widen_white(tile->white + first, tile->gain, n, white);
        for (uint32_t s = 0; s < tile->n_spectra; s++)
            lost += promote_block(white, tile->ratio[s] + first, n, tile->out[s] + first);
    }
    return lost;
}

#endif
