#include "core/exr_source.h"

#include <stdlib.h>
#include <string.h>

static enum ls_err check_mappable(const struct ls_exr_layout *layout, struct ls_diag *diag)
{
    if (!layout->tiled || layout->compression != EXR_COMPRESSION_NONE || layout->n_levels != 1)
        return ls_fail(diag, LS_ERR_UNSUPPORTED,
                       "OpenEXR: only uncompressed tiles of one level "
                       "can be used in place; convert with oiiotool --compression none --tile 64 "
                       "64");
    if (layout->channels->num_channels != 1)
        return ls_fail(diag, LS_ERR_UNSUPPORTED,
                       "OpenEXR: %d channels; only a part with one can "
                       "be used in place",
                       layout->channels->num_channels);
    const exr_attr_chlist_entry_t *channel = &layout->channels->entries[0];
    if (channel->x_sampling != 1 || channel->y_sampling != 1 ||
        channel->pixel_type == EXR_PIXEL_UINT)
        return ls_fail(diag, LS_ERR_UNSUPPORTED,
                       "OpenEXR: its channel is subsampled or of integer type");
    return LS_OK;
}

static enum ls_err map_tile(const struct ls_exr_source *source, int part, uint32_t tx, uint32_t ty,
                            struct ls_exr_tiles *tiles, struct ls_diag *diag)
{
    exr_chunk_info_t chunk;
    uint64_t want = (uint64_t)ls_exr_tile_width(tiles, tx) * ls_exr_tile_height(tiles, ty) *
                    (tiles->type == LS_EXR_HALF ? 2 : 4);
    exr_result_t r =
        exr_read_tile_chunk_info(source->context, part, (int)tx, (int)ty, 0, 0, &chunk);
    if (r)
        return ls_exr_source_fail(source, r, "cannot find a tile", diag);
    if (chunk.packed_size != want)
        return ls_fail(diag, LS_ERR_INVALID,
                       "OpenEXR: tile (%u, %u) has %llu bytes: expected "
                       "%llu",
                       tx, ty, (unsigned long long)chunk.packed_size, (unsigned long long)want);
    if (chunk.data_offset > source->n || want > source->n - chunk.data_offset)
        return ls_fail(diag, LS_ERR_INVALID,
                       "OpenEXR: tile (%u, %u) reaches beyond the end of "
                       "the file: it is truncated",
                       tx, ty);
    tiles->tile[(size_t)ty * tiles->n_x + tx] = source->bytes + chunk.data_offset;
    return LS_OK;
}

struct extent {
    const uint8_t *begin, *end;
};

static int by_address(const void *a, const void *b)
{
    const struct extent *left = a, *right = b;
    return left->begin < right->begin ? -1 : left->begin > right->begin;
}

static enum ls_err check_overlap(const struct ls_exr_tiles *tiles, struct ls_diag *diag)
{
    size_t n = (size_t)tiles->n_x * tiles->n_y, sample = tiles->type == LS_EXR_HALF ? 2 : 4;
    LS_CLEANUP_FREE struct extent *extents = malloc(n * sizeof *extents);
    if (!extents)
        return ls_fail(diag, LS_ERR_NOMEM, "no memory for %zu tiles", n);
    for (size_t k = 0; k < n; k++) {
        extents[k].begin = tiles->tile[k];
        extents[k].end = tiles->tile[k] + sample *
                                              ls_exr_tile_width(tiles, (uint32_t)(k % tiles->n_x)) *
                                              ls_exr_tile_height(tiles, (uint32_t)(k / tiles->n_x));
    }
    qsort(extents, n, sizeof *extents, by_address);
    for (size_t k = 1; k < n; k++)
        if (extents[k].begin < extents[k - 1].end)
            return ls_fail(diag, LS_ERR_INVALID, "OpenEXR: two tiles share the same bytes");
    return LS_OK;
}

static enum ls_err map_part(const struct ls_exr_source *source, int part,
                            struct ls_exr_tiles *tiles, struct ls_diag *diag)
{
    struct ls_exr_layout layout;
    enum ls_err err = ls_exr_source_layout(source, part, &layout, diag);
    if (!err)
        err = check_mappable(&layout, diag);
    if (err)
        return err;
    tiles->width = layout.width;
    tiles->height = layout.height;
    tiles->tile_w = layout.tile_w;
    tiles->tile_h = layout.tile_h;
    tiles->n_x = (layout.width + layout.tile_w - 1) / layout.tile_w;
    tiles->n_y = (layout.height + layout.tile_h - 1) / layout.tile_h;
    tiles->type =
        layout.channels->entries[0].pixel_type == EXR_PIXEL_HALF ? LS_EXR_HALF : LS_EXR_FLOAT;
    size_t n = (size_t)tiles->n_x * tiles->n_y;
    if (n > source->n / 8)
        return ls_fail(diag, LS_ERR_INVALID, "OpenEXR: a file of %zu bytes cannot hold %zu tiles",
                       source->n, n);
    tiles->tile = calloc(n, sizeof *tiles->tile);
    if (!tiles->tile)
        return ls_fail(diag, LS_ERR_NOMEM, "no memory for %zu tiles", n);
    for (uint32_t ty = 0; ty < tiles->n_y && !err; ty++)
        for (uint32_t tx = 0; tx < tiles->n_x && !err; tx++)
            err = map_tile(source, part, tx, ty, tiles, diag);
    return err ? err : check_overlap(tiles, diag);
}

enum ls_err ls_exr_map_tiles(const void *bytes, size_t n_bytes, const char *part,
                             struct ls_exr_tiles *tiles, struct ls_diag *diag)
{
    struct ls_exr_source source;
    *tiles = (struct ls_exr_tiles){0};
    enum ls_err err = ls_exr_source_open(&source, bytes, n_bytes, diag);
    if (err)
        return err;
    int index = part ? ls_exr_source_part(&source, part) : 0;
    if (index < 0)
        err = ls_fail(diag, LS_ERR_NOT_FOUND, "OpenEXR: there is no part \"%s\"", part);
    else
        err = map_part(&source, index, tiles, diag);
    ls_exr_source_close(&source);
    if (err)
        ls_exr_tiles_finish(tiles);
    return err;
}

void ls_exr_tiles_finish(struct ls_exr_tiles *tiles)
{
    free(tiles->tile);
    *tiles = (struct ls_exr_tiles){0};
}
