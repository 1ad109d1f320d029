#include "core/factored.h"

#include "core/promote_tile.h"

enum { BLOCK = 256 };

static const uint16_t ones[BLOCK] = {[0 ... BLOCK - 1] = 0x3c00};

static size_t expand(const uint16_t *white, float gain, const uint16_t *ratio, size_t n,
                     uint16_t *out)
{
    const struct ls_promote_tile tile = {.white = white,
                                         .n_spectra = 1,
                                         .ratio = (const uint16_t *const[]){ratio},
                                         .out = (uint16_t *const[]){out},
                                         .n = n,
                                         .gain = gain};
    return ls_promote_tile(&tile);
}

size_t ls_factored_expand(const uint16_t *white, float gain, const uint16_t *ratio, size_t n,
                          uint16_t *out)
{
    if (ratio)
        return expand(white, gain, ratio, n, out);
    size_t zeros = 0;
    for (size_t j = 0; j < n; j += BLOCK)
        zeros += expand(white + j, gain, ones, n - j < BLOCK ? n - j : BLOCK, out + j);
    return zeros;
}
