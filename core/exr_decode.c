#include "core/exr_decode.h"

#include "core/half.h"

#include <stdbool.h>
#include <string.h>

enum { BLOCK_PX = 256 };

_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__,
               "samples are copied as they lie in files");

static size_t row_bytes(const exr_attr_chlist_t *channels, uint32_t width)
{
    size_t pixel = 0;
    for (int c = 0; c < channels->num_channels; c++)
        pixel += ls_exr_sample_bytes(channels->entries[c].pixel_type);
    return pixel * width;
}

static void widen(const uint8_t *in, exr_pixel_type_t from, uint32_t n, float *out)
{
    uint16_t halves[BLOCK_PX];
    uint32_t whole[BLOCK_PX];
    switch (from) {
    case EXR_PIXEL_HALF:
        memcpy(halves, in, n * sizeof *halves);
        ls_half_to_floats(halves, out, n);
        break;
    case EXR_PIXEL_FLOAT:
        memcpy(out, in, n * sizeof *out);
        break;
    default:
        memcpy(whole, in, n * sizeof *whole);
        for (uint32_t k = 0; k < n; k++)
            out[k] = (float)whole[k];
    }
}

static void spread_floats(const uint8_t *in, exr_pixel_type_t from, uint32_t width, uint8_t *out,
                          size_t stride)
{
    float block[BLOCK_PX];
    for (uint32_t x = 0; x < width; x += BLOCK_PX) {
        uint32_t n = width - x < BLOCK_PX ? width - x : BLOCK_PX;
        widen(in + x * ls_exr_sample_bytes(from), from, n, block);
        for (uint32_t k = 0; k < n; k++)
            memcpy(out + (x + k) * stride, &block[k], sizeof *block);
    }
}

static void spread_halves(const uint8_t *in, uint32_t width, uint8_t *out, size_t stride)
{
    for (uint32_t x = 0; x < width; x++)
        memcpy(out + x * stride, in + 2 * (size_t)x, 2);
}

/* One row of a chunk: the channels one after the other. */
static void spread_row(const struct ls_exr_target *target, const uint8_t *row, uint32_t width,
                       uint8_t *out)
{
    size_t sample = ls_exr_sample_bytes(target->type), stride = target->n * sample;
    const exr_attr_chlist_t *channels = target->layout.channels;
    for (int c = 0; c < channels->num_channels; c++) {
        exr_pixel_type_t from = channels->entries[c].pixel_type;
        for (uint32_t k = 0; k < target->n; k++)
            if (target->picked[k] == c && target->type == EXR_PIXEL_HALF)
                spread_halves(row, width, out + k * sample, stride);
            else if (target->picked[k] == c)
                spread_floats(row, from, width, out + k * sample, stride);
        row += width * ls_exr_sample_bytes(from);
    }
}

static void spread(const struct ls_exr_target *target, const exr_decode_pipeline_t *decode,
                   uint32_t x, uint32_t y)
{
    uint32_t width = (uint32_t)decode->chunk.width, height = (uint32_t)decode->chunk.height;
    size_t row = row_bytes(target->layout.channels, width);
    size_t pixel = target->n * ls_exr_sample_bytes(target->type);
    for (uint32_t k = 0; k < height; k++)
        spread_row(target, (const uint8_t *)decode->unpacked_buffer + k * row, width,
                   target->pixels + ((size_t)(y + k) * target->layout.width + x) * pixel);
}

/* Everything that the library's decompressors and spread rely on. */
static enum ls_err check_chunk(const struct ls_exr_source *source,
                               const struct ls_exr_target *target, const exr_chunk_info_t *chunk,
                               uint32_t x, uint32_t y, struct ls_diag *diag)
{
    uint32_t w = (uint32_t)chunk->width, h = (uint32_t)chunk->height;
    if (chunk->width < 1 || chunk->height < 1 || w > target->layout.width - x ||
        h > target->layout.height - y)
        return ls_fail(diag, LS_ERR_INVALID,
                       "OpenEXR: a chunk at (%u, %u) does not fit into the picture", x, y);
    if (chunk->packed_size > source->n || chunk->unpacked_size > target->limit_bytes / 4)
        return ls_fail(diag, LS_ERR_LIMIT,
                       "OpenEXR: a chunk of %llu bytes is larger than the limit allows",
                       (unsigned long long)chunk->unpacked_size);
    bool plain = target->layout.compression == EXR_COMPRESSION_NONE;
    if (chunk->unpacked_size != h * row_bytes(target->layout.channels, w) || !chunk->packed_size ||
        (plain && chunk->packed_size != chunk->unpacked_size))
        return ls_fail(diag, LS_ERR_INVALID,
                       "OpenEXR: a chunk at (%u, %u) has %llu bytes for %u x %u px", x, y,
                       (unsigned long long)chunk->packed_size, w, h);
    return LS_OK;
}

static enum ls_err decode_chunk(const struct ls_exr_source *source,
                                const struct ls_exr_target *target, const exr_chunk_info_t *chunk,
                                uint32_t x, uint32_t y, exr_decode_pipeline_t *decode,
                                struct ls_diag *diag)
{
    enum ls_err err = check_chunk(source, target, chunk, x, y, diag);
    if (err)
        return err;
    bool first = decode->context == NULL;
    exr_result_t r = first ? exr_decoding_initialize(source->context, target->part, chunk, decode)
                           : exr_decoding_update(source->context, target->part, chunk, decode);
    if (!r && first) {
        r = exr_decoding_choose_default_routines(source->context, target->part, decode);
        decode->unpack_and_convert_fn = NULL;
    }
    if (!r)
        r = exr_decoding_run(source->context, target->part, decode);
    if (r)
        return ls_exr_source_fail(source, r, "cannot decode", diag);
    spread(target, decode, x, y);
    return LS_OK;
}

static enum ls_err decode_scanlines(const struct ls_exr_source *source,
                                    const struct ls_exr_target *target,
                                    exr_decode_pipeline_t *decode, struct ls_diag *diag)
{
    int32_t lines = 0;
    exr_result_t r = exr_get_scanlines_per_chunk(source->context, target->part, &lines);
    if (r || lines < 1)
        return ls_exr_source_fail(source, r, "cannot read the layout", diag);
    for (uint32_t y = 0; y < target->layout.height; y += (uint32_t)lines) {
        exr_chunk_info_t chunk;
        r = exr_read_scanline_chunk_info(source->context, target->part,
                                         target->layout.y + (int32_t)y, &chunk);
        if (r)
            return ls_exr_source_fail(source, r, "cannot find scanlines", diag);
        enum ls_err err = decode_chunk(source, target, &chunk, 0, y, decode, diag);
        if (err)
            return err;
    }
    return LS_OK;
}

static enum ls_err decode_tiles(const struct ls_exr_source *source,
                                const struct ls_exr_target *target, exr_decode_pipeline_t *decode,
                                struct ls_diag *diag)
{
    uint32_t tile_w = target->layout.tile_w, tile_h = target->layout.tile_h;
    for (uint32_t y = 0; y < target->layout.height; y += tile_h)
        for (uint32_t x = 0; x < target->layout.width; x += tile_w) {
            exr_chunk_info_t chunk;
            exr_result_t r = exr_read_tile_chunk_info(
                source->context, target->part, (int)(x / tile_w), (int)(y / tile_h), 0, 0, &chunk);
            if (r)
                return ls_exr_source_fail(source, r, "cannot find a tile", diag);
            enum ls_err err = decode_chunk(source, target, &chunk, x, y, decode, diag);
            if (err)
                return err;
        }
    return LS_OK;
}

enum ls_err ls_exr_decode(const struct ls_exr_source *source, const struct ls_exr_target *target,
                          struct ls_diag *diag)
{
    exr_decode_pipeline_t pipeline = EXR_DECODE_PIPELINE_INITIALIZER;
    enum ls_err err = target->layout.tiled ? decode_tiles(source, target, &pipeline, diag)
                                           : decode_scanlines(source, target, &pipeline, diag);
    exr_decoding_destroy(source->context, &pipeline);
    return err;
}
