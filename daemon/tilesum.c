#include "daemon/tilesum.h"

#include "core/crc32c.h"

#include <stdlib.h>
#include <string.h>

struct tile {
    uint32_t x, y, w, h;
};

static struct tile tile_at(const struct ls_exr_mosaic *mosaic, uint32_t index)
{
    uint32_t n_x = (mosaic->width + LS_EXR_TILE_PX - 1) / LS_EXR_TILE_PX;
    struct tile tile = {.x = index % n_x * LS_EXR_TILE_PX, .y = index / n_x * LS_EXR_TILE_PX};
    tile.w = mosaic->width - tile.x < LS_EXR_TILE_PX ? mosaic->width - tile.x : LS_EXR_TILE_PX;
    tile.h = mosaic->height - tile.y < LS_EXR_TILE_PX ? mosaic->height - tile.y : LS_EXR_TILE_PX;
    return tile;
}

enum { INFINITE_HALF = 0x7c00, LANES = 8 };

/* Several halves at once. */
typedef int16_t halves __attribute__((vector_size(2 * LANES)));

static halves larger(halves a, halves b)
{
    halves first = a > b;
    return (a & first) | (b & ~first);
}

/* Bits of the magnitude order like the magnitudes; beyond infinity's they are NaN. */
static halves larger_of(halves most, const uint16_t *row, size_t n_bytes)
{
    halves some = {0};
    memcpy(&some, row, n_bytes);
    some &= 0x7fff;
    return larger(most, some & (some <= INFINITE_HALF));
}

static uint32_t max_half(const uint16_t *row, uint32_t n, uint32_t max)
{
    halves most = {0};
    uint32_t whole = n - n % LANES;
    for (uint32_t k = 0; k < whole; k += LANES)
        most = larger_of(most, row + k, sizeof most);
    if (n > whole)
        most = larger_of(most, row + whole, (n - whole) * sizeof *row);
    for (uint32_t k = 0; k < LANES; k++)
        max = (uint32_t)most[k] > max ? (uint32_t)most[k] : max;
    return max;
}

static uint32_t max_float(const float *row, uint32_t n, uint32_t max)
{
    for (uint32_t k = 0; k < n; k++) {
        uint32_t bits;
        memcpy(&bits, &row[k], sizeof bits);
        bits &= 0x7fffffff;
        if (bits > max && bits <= 0x7f800000)
            max = bits;
    }
    return max;
}

static void sum_row(const struct ls_exr_mosaic *mosaic, uint32_t y, struct tile tile, uint32_t *crc,
                    uint32_t *max)
{
    size_t at = (size_t)y * mosaic->width + tile.x;
    if (mosaic->half) {
        *crc = ls_crc32c(*crc, mosaic->half + at, tile.w * sizeof *mosaic->half);
        *max = max_half(mosaic->half + at, tile.w, *max);
    } else {
        *crc = ls_crc32c(*crc, mosaic->floats + at, tile.w * sizeof *mosaic->floats);
        *max = max_float(mosaic->floats + at, tile.w, *max);
    }
}

/* Row by row of the picture: down a tile, memory would be read in leaps of a page. Tiles side by
 * side keep the processor's checksum unit busy, too: none waits for the one before. */
static void sum_tiles(const struct ls_exr_mosaic *mosaic, uint32_t n, uint32_t *crc, uint32_t *max)
{
    uint32_t n_x = (mosaic->width + LS_EXR_TILE_PX - 1) / LS_EXR_TILE_PX;
    for (uint32_t first = 0; first < n; first += n_x) {
        struct tile tile = tile_at(mosaic, first);
        for (uint32_t y = tile.y; y < tile.y + tile.h; y++)
            for (uint32_t k = first; k < first + n_x; k++)
                sum_row(mosaic, y, tile_at(mosaic, k), &crc[k], &max[k]);
    }
}

static uint32_t count_invalid(const struct ls_exr_mosaic *mosaic, struct tile tile)
{
    static const uint8_t none[LS_EXR_TILE_PX];
    uint32_t n = 0;
    for (uint32_t y = tile.y; y < tile.y + tile.h; y++) {
        const uint8_t *row = mosaic->validity + (size_t)y * mosaic->width + tile.x;
        if (memcmp(row, none, tile.w))
            for (uint32_t x = 0; x < tile.w; x++)
                n += row[x] != 0;
    }
    return n;
}

static enum ls_err sum_validity(const struct ls_exr_mosaic *mosaic, struct ls_published *published)
{
    uint32_t total = 0;
    published->tile_invalid = calloc(published->n_tiles, sizeof *published->tile_invalid);
    if (!published->tile_invalid)
        return LS_ERR_NOMEM;
    for (uint32_t k = 0; k < published->n_tiles; k++)
        total += published->tile_invalid[k] = count_invalid(mosaic, tile_at(mosaic, k));
    if (total) {
        published->validity_crc =
            ls_crc32c(0, mosaic->validity, (size_t)mosaic->width * mosaic->height);
    } else {
        free(published->tile_invalid);
        published->tile_invalid = NULL;
    }
    return LS_OK;
}

enum ls_err ls_tilesum(const struct ls_exr_mosaic *mosaic, struct ls_published *published)
{
    uint32_t n = ((mosaic->width + LS_EXR_TILE_PX - 1) / LS_EXR_TILE_PX) *
                 ((mosaic->height + LS_EXR_TILE_PX - 1) / LS_EXR_TILE_PX);
    published->width = mosaic->width;
    published->height = mosaic->height;
    published->is_float = mosaic->half == NULL;
    published->n_tiles = n;
    published->tile_crc = calloc(n, sizeof *published->tile_crc);
    published->tile_max = calloc(n, sizeof *published->tile_max);
    if (!published->tile_crc || !published->tile_max)
        return LS_ERR_NOMEM;
    sum_tiles(mosaic, n, published->tile_crc, published->tile_max);
    return mosaic->validity ? sum_validity(mosaic, published) : LS_OK;
}
