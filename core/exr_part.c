#include "core/exr_part.h"

#include "core/exr_zip.h"
#include "core/half.h"

#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

size_t ls_exr_sample_bytes(enum ls_exr_type type)
{
    return type == LS_EXR_HALF ? 2 : 4;
}

static float source_value(const struct ls_exr_channel *channel, const uint8_t *at)
{
    float value;
    if (channel->source == LS_EXR_FROM_U8)
        return *at;
    memcpy(&value, at, sizeof value);
    return value;
}

/* One row of one channel of a tile, converted; returns the bytes written to @out. */
static size_t pack_row(const struct ls_exr_channel *channel, uint32_t x, uint32_t y, uint32_t n,
                       uint8_t *out)
{
    const uint8_t *at = (const uint8_t *)channel->pixels + y * channel->row_stride_bytes +
                        x * channel->pixel_stride_bytes;
    size_t bytes = ls_exr_sample_bytes(channel->type), stride = channel->pixel_stride_bytes;
    bool as_is = channel->source == LS_EXR_FROM_HALF ||
                 (channel->source == LS_EXR_FROM_FLOAT && channel->type == LS_EXR_FLOAT);
    if (as_is && stride == bytes) {
        for (size_t k = 0; k < n * bytes; k += 64) /* of the next tile: rows lie pages apart */
            __builtin_prefetch(at + n * bytes + k);
        memcpy(out, at, n * bytes);
        return n * bytes;
    }
    for (uint32_t k = 0; k < n; k++, at += stride) {
        if (as_is) {
            memcpy(out + k * bytes, at, bytes);
        } else if (channel->type == LS_EXR_HALF) {
            uint16_t half = ls_half_from_float(source_value(channel, at));
            memcpy(out + 2 * k, &half, 2);
        } else {
            float value = source_value(channel, at);
            memcpy(out + 4 * k, &value, 4);
        }
    }
    return n * bytes;
}

static int by_name(const void *a, const void *b)
{
    const struct ls_exr_channel *const *left = a, *const *right = b;
    return strcmp((*left)->name, (*right)->name);
}

/* The channels in the order the file wants. */
static void sort_channels(const struct ls_exr_part *part, const struct ls_exr_channel **sorted)
{
    for (size_t k = 0; k < part->n_channels; k++)
        sorted[k] = &part->channels[k];
    qsort(sorted, part->n_channels, sizeof *sorted, by_name);
}

/* The rows of the tile below, of which the part's channels hold what begins at its row @y. */
static exr_result_t write_tile(exr_context_t context, int index, const struct ls_exr_part *part,
                               uint32_t x, uint32_t y, uint32_t from, uint8_t *tile)
{
    const struct ls_exr_channel *sorted[LS_EXR_MAX_CHANNELS];
    uint32_t w = part->width - x < LS_EXR_TILE_PX ? part->width - x : LS_EXR_TILE_PX;
    uint32_t h = part->height - y < LS_EXR_TILE_PX ? part->height - y : LS_EXR_TILE_PX;
    size_t n = 0;
    sort_channels(part, sorted);
    for (uint32_t row = y - from; row < y - from + h; row++)
        for (size_t c = 0; c < part->n_channels; c++)
            n += pack_row(sorted[c], x, row, w, tile + n);
    int tx = (int)(x / LS_EXR_TILE_PX), ty = (int)(y / LS_EXR_TILE_PX);
    return part->packed ? ls_exr_zip_tile(context, index, tx, ty, tile, n)
                        : exr_write_tile_chunk(context, index, tx, ty, 0, 0, tile, n);
}

exr_result_t ls_exr_part_write_row(exr_context_t context, int index, const struct ls_exr_part *part,
                                   uint32_t y, uint32_t from, uint8_t *tile)
{
    exr_result_t r = EXR_ERR_SUCCESS;
    for (uint32_t x = 0; x < part->width && !r; x += LS_EXR_TILE_PX)
        r = write_tile(context, index, part, x, y, from, tile);
    return r;
}

exr_result_t ls_exr_part_declare(exr_context_t context, const struct ls_exr_part *part, int *index)
{
    bool cropped = part->display_width != 0;
    exr_attr_box2i_t data = {
        .min = {.x = part->x, .y = part->y},
        .max = {.x = part->x + (int32_t)part->width - 1, .y = part->y + (int32_t)part->height - 1}};
    exr_attr_box2i_t display = data;
    if (cropped)
        display = (exr_attr_box2i_t){
            .min = {.x = 0, .y = 0},
            .max = {.x = (int32_t)part->display_width - 1, .y = (int32_t)part->display_height - 1}};
    exr_attr_v2f_t centre = {.x = 0, .y = 0};
    exr_result_t r = exr_add_part(context, part->name, EXR_STORAGE_TILED, index);
    if (!r)
        r = exr_initialize_required_attr(context, *index, &display, &data, 1.0f, &centre, 1.0f,
                                         EXR_LINEORDER_INCREASING_Y,
                                         part->packed ? EXR_COMPRESSION_ZIP : EXR_COMPRESSION_NONE);
    if (!r)
        r = exr_set_tile_descriptor(context, *index, LS_EXR_TILE_PX, LS_EXR_TILE_PX,
                                    EXR_TILE_ONE_LEVEL, EXR_TILE_ROUND_DOWN);
    for (size_t c = 0; c < part->n_channels && !r; c++)
        r = exr_add_channel(context, *index, part->channels[c].name,
                            part->channels[c].type == LS_EXR_HALF ? EXR_PIXEL_HALF
                                                                  : EXR_PIXEL_FLOAT,
                            EXR_PERCEPTUALLY_LINEAR, 1, 1);
    for (size_t k = 0; part->attrs && k < part->attrs->n && !r; k++)
        r = ls_exr_attr_put(context, *index, &part->attrs->items[k]);
    return r;
}

static enum ls_err check_channel(const struct ls_exr_part *part, size_t index, struct ls_diag *diag)
{
    const struct ls_exr_channel *channel = &part->channels[index];
    if (!channel->name || !*channel->name || strlen(channel->name) > 31 || !channel->pixels)
        return ls_fail(diag, LS_ERR_INVALID,
                       "OpenEXR: channel %zu has no pixels or no name of 1 "
                       "to 31 characters",
                       index);
    if (channel->source == LS_EXR_FROM_HALF && channel->type != LS_EXR_HALF)
        return ls_fail(diag, LS_ERR_INVALID,
                       "OpenEXR: channel %s: half samples are stored as "
                       "half only",
                       channel->name);
    for (size_t other = 0; other < index; other++)
        if (!strcmp(part->channels[other].name, channel->name))
            return ls_fail(diag, LS_ERR_INVALID, "OpenEXR: channel %s stands twice", channel->name);
    return LS_OK;
}

enum ls_err ls_exr_part_check(const struct ls_exr_part *part, size_t n_parts, struct ls_diag *diag)
{
    if (!part->width || !part->height || part->width > LS_EXR_MAX_PX ||
        part->height > LS_EXR_MAX_PX)
        return ls_fail(diag, LS_ERR_INVALID,
                       "OpenEXR: a part of %u x %u px: expected 1 x 1 to "
                       "%d x %d",
                       part->width, part->height, LS_EXR_MAX_PX, LS_EXR_MAX_PX);
    if (part->x < -LS_EXR_MAX_PX || part->x > LS_EXR_MAX_PX || part->y < -LS_EXR_MAX_PX ||
        part->y > LS_EXR_MAX_PX || part->display_width > LS_EXR_MAX_PX ||
        part->display_height > LS_EXR_MAX_PX || !part->display_width != !part->display_height)
        return ls_fail(diag, LS_ERR_INVALID,
                       "OpenEXR: window at (%d, %d) in %u x %u px is out of "
                       "range",
                       part->x, part->y, part->display_width, part->display_height);
    if (!part->n_channels || part->n_channels > LS_EXR_MAX_CHANNELS)
        return ls_fail(diag, LS_ERR_INVALID, "OpenEXR: %zu channels: expected 1 to %d",
                       part->n_channels, LS_EXR_MAX_CHANNELS);
    if (n_parts > 1 && (!part->name || !*part->name))
        return ls_fail(diag, LS_ERR_INVALID, "OpenEXR: with several parts each needs a name");
    if (part->attrs && part->attrs->err)
        return ls_fail(diag, part->attrs->err, "OpenEXR: attribute \"%s\": %s",
                       part->attrs->err_name,
                       part->attrs->err == LS_ERR_NOMEM ? "no memory"
                                                        : "its name must have 1 to 31 characters");
    for (size_t c = 0; c < part->n_channels; c++) {
        enum ls_err err = check_channel(part, c, diag);
        if (err)
            return err;
    }
    return LS_OK;
}

size_t ls_exr_part_pixel_bytes(const struct ls_exr_part *part)
{
    size_t n = 0;
    for (size_t c = 0; c < part->n_channels; c++)
        n += ls_exr_sample_bytes(part->channels[c].type);
    return n;
}

void ls_exr_part_quiet(exr_const_context_t context, exr_result_t code, const char *message)
{
}
