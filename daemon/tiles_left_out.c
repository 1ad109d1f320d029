/* What is too dark to be sent. */
#include "core/half.h"
#include "daemon/tiles_private.h"

#include <string.h>

/* Several at once, as many as any processor takes. Bits of magnitudes order like the magnitudes;
 * beyond infinity's they are no number. */
typedef int16_t halves __attribute__((vector_size(16)));
typedef int32_t floats __attribute__((vector_size(16)));

/* @n bytes: whole vectors. */
static double most_of_halves(const uint8_t *bytes, size_t n)
{
    halves most = {0};
    int16_t bits = 0;
    for (size_t k = 0; k < n; k += sizeof most) {
        halves some, first;
        memcpy(&some, bytes + k, sizeof some);
        some &= 0x7fff;
        first = (some > most) & (some <= 0x7c00);
        most = (some & first) | (most & ~first);
    }
    for (size_t k = 0; k < sizeof most / sizeof bits; k++)
        bits = most[k] > bits ? most[k] : bits;
    return (double)ls_half_to_float((uint16_t)bits);
}

static double most_of_floats(const uint8_t *bytes, size_t n)
{
    floats most = {0};
    int32_t bits = 0;
    float value;
    for (size_t k = 0; k < n; k += sizeof most) {
        floats some, first;
        memcpy(&some, bytes + k, sizeof some);
        some &= 0x7fffffff;
        first = (some > most) & (some <= 0x7f800000);
        most = (some & first) | (most & ~first);
    }
    for (size_t k = 0; k < sizeof most / sizeof bits; k++)
        bits = most[k] > bits ? most[k] : bits;
    memcpy(&value, &bits, sizeof value);
    return (double)value;
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
    bool out =
        tiles->max_error > 0 &&
        leaves_out(tiles, i, tiles->half ? most_of_halves(bytes, n) : most_of_floats(bytes, n));
    return out ? 0 : ls_tile_hash(bytes, n);
}
