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

/* LANES products; what is not finite becomes 0. Returns how many that were. */
LANES_INLINE size_t promote_lanes(floats white, const uint16_t *ratio, uint16_t *out)
{
    floats v = white * lanes_load_half(ratio);
    ints finite = lanes_magnitude(v) <= FLT_MAX;
    size_t lost = 0;

    if (!lanes_are_all_set(finite)) {
        v = lanes_keep(finite, v);
        for (int k = 0; k < LANES; k++)
            lost += finite[k] == 0;
    }
    lanes_store_half(out, lanes_to_half(lanes_clamp_half(v)));
    return lost;
}

/* @n < LANES products, by way of buffers. */
LANES_INLINE size_t promote_rest(floats white, const uint16_t *ratio, size_t n, uint16_t *out)
{
    uint16_t in[LANES] = {0}, result[LANES];

    memcpy(in, ratio, n * sizeof *in);
    size_t lost = promote_lanes(white, in, result);
    memcpy(out, result, n * sizeof *out);
    return lost;
}

/* White samples [at, at + n), n <= LANES, with their gain; 0 after them. */
LANES_INLINE floats load_white(const struct ls_promote_tile *tile, size_t at, size_t n)
{
    uint16_t in[LANES] = {0};

    if (n >= LANES)
        return lanes_load_half(tile->white + at) * tile->gain;
    memcpy(in, tile->white + at, n * sizeof *in);
    return lanes_load_half(in) * tile->gain;
}

/* The white samples of a block are widened once and wait in the first-level cache for every
 * spectrum; one spectrum at a time keeps the streams from memory few. */
LANES_INLINE size_t promote_tile(const struct ls_promote_tile *tile)
{
    enum { BLOCK = 1024 };
    floats white[BLOCK / LANES];
    size_t lost = 0;

    for (size_t first = 0; first < tile->n; first += BLOCK) {
        size_t n = tile->n - first < BLOCK ? tile->n - first : BLOCK, whole = n - n % LANES;
        for (size_t j = 0; j < n; j += LANES)
            white[j / LANES] = load_white(tile, first + j, n - j);
        for (uint32_t s = 0; s < tile->n_spectra; s++) {
            const uint16_t *ratio = tile->ratio[s] + first;
            uint16_t *out = tile->out[s] + first;
            for (size_t j = 0; j < whole; j += LANES)
                lost += promote_lanes(white[j / LANES], ratio + j, out + j);
            if (n > whole)
                lost += promote_rest(white[whole / LANES], ratio + whole, n - whole, out + whole);
        }
    }
    return lost;
}

#endif
