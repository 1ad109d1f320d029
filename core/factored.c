#include "core/factored.h"

#include "core/promote_tile.h"

size_t ls_factored_expand(const uint16_t *white, float gain, const uint16_t *ratio, size_t n,
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
