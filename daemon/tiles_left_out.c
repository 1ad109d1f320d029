/* What is too dark to be sent. */
#include "core/half.h"
#include "daemon/tiles_private.h"

#include <math.h>
#include <string.h>

enum { SIDE = LS_EXR_TILE_PX };

/* Bits of magnitudes order like the magnitudes; beyond infinity's they are no number. */
static double most_of_halves(const uint8_t *bytes, size_t n)
{
    uint16_t most = 0;
    for (size_t k = 0; k < n; k++) {
        uint16_t bits;
        memcpy(&bits, bytes + k * sizeof bits, sizeof bits);
        bits &= 0x7fff;
        most = bits > most && bits <= 0x7c00 ? bits : most;
    }
    return (double)ls_half_to_float(most);
}

static double most_of_floats(const uint8_t *bytes, size_t n)
{
    float most = 0;
    for (size_t k = 0; k < n; k++) {
        float v;
        memcpy(&v, bytes + k * sizeof v, sizeof v);
        most = fmaxf(most, fabsf(v)); /* that of a number and of none is the number */
    }
    return (double)most;
}

static bool leaves_out(struct ls_tiles *tiles, uint32_t i, double most)
{
    const struct ls_tiles_bounds *b = &tiles->bounds;
    double off = b->off ? b->off(b->user, tiles->number[i], most) : most;
    if (!(off <= tiles->max_error))
        return false;
    tiles->off[i] = off;
    tiles->hash[i] = 0;
    return true;
}

bool ls_tiles_leaves_out(struct ls_tiles *tiles, uint32_t i)
{
    const struct ls_tiles_bounds *b = &tiles->bounds;
    return tiles->max_error > 0 && b->most &&
           leaves_out(tiles, i, b->most(b->user, tiles->number[i]));
}

uint64_t ls_tiles_hash(struct ls_tiles *tiles, uint32_t i, const uint8_t *bytes)
{
    size_t n = ls_tiles_tile_bytes(tiles);
    bool out = tiles->max_error > 0 && leaves_out(tiles, i,
                                                  tiles->half ? most_of_halves(bytes, n / 2)
                                                              : most_of_floats(bytes, n / 4));
    return out ? 0 : ls_tile_hash(bytes, n);
}
