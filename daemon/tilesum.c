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

/* Bits of the magnitude order like the magnitudes; beyond infinity's they are NaN. */
static uint32_t max_half(const uint16_t *row, uint32_t n, uint32_t max)
{
    for (uint32_t k = 0; k < n; k++) {
        uint32_t bits = row[k] & 0x7fff;
        if (bits > max && bits <= 0x7c00)
            max = bits;
    }
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

static void sum_tile(const struct ls_exr_mosaic *mosaic, struct tile tile, uint32_t *crc,
                     uint32_t *max)
{
    *crc = *max = 0;
    for (uint32_t y = tile.y; y < tile.y + tile.h; y++) {
        size_t at = (size_t)y * mosaic->width + tile.x;
        if (mosaic->half) {
            *crc = ls_crc32c(*crc, mosaic->half + at, tile.w * sizeof *mosaic->half);
            *max = max_half(mosaic->half + at, tile.w, *max);
        } else {
            *crc = ls_crc32c(*crc, mosaic->floats + at, tile.w * sizeof *mosaic->floats);
            *max = max_float(mosaic->floats + at, tile.w, *max);
        }
    }
}

static uint32_t count_invalid(const struct ls_exr_mosaic *mosaic, struct tile tile)
{
    uint32_t n = 0;
    for (uint32_t y = tile.y; y < tile.y + tile.h; y++)
        for (uint32_t x = tile.x; x < tile.x + tile.w; x++)
            n += mosaic->validity[(size_t)y * mosaic->width + x] != 0;
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
    for (uint32_t k = 0; k < n; k++)
        sum_tile(mosaic, tile_at(mosaic, k), &published->tile_crc[k], &published->tile_max[k]);
    return mosaic->validity ? sum_validity(mosaic, published) : LS_OK;
}
