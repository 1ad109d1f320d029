#include "core/exr_source.h"
#include "core/half.h"

#include <limits.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

enum { MAX_CHANNELS = 64 };

/* The file as it grows, and what the library said about it. */
struct sink {
    uint8_t *bytes;
    size_t n, capacity;
    bool fixed; /* the memory is the caller's */
    bool full;  /* there was no more */
    char message[256];
};

static bool grow(struct sink *sink, size_t need)
{
    if (need <= sink->capacity)
        return true;
    sink->full = sink->fixed;
    if (sink->full)
        return false;
    size_t capacity = sink->capacity * 2 > need ? sink->capacity * 2 : need;
    uint8_t *bytes = sink->bytes ? realloc(sink->bytes, capacity) : calloc(1, capacity);
    if (!bytes)
        return false;
    if (sink->bytes)
        memset(bytes + sink->capacity, 0, capacity - sink->capacity);
    sink->bytes = bytes;
    sink->capacity = capacity;
    return true;
}

static int64_t write_at(exr_const_context_t context, void *user, const void *buffer, uint64_t n,
                        uint64_t offset, exr_stream_error_func_ptr_t error)
{
    struct sink *sink = user;
    if (!grow(sink, offset + n))
        return error(context, EXR_ERR_OUT_OF_MEMORY, "no memory for %zu bytes", (size_t)n), -1;
    memcpy(sink->bytes + offset, buffer, n);
    if (offset + n > sink->n)
        sink->n = offset + n;
    return (int64_t)n;
}

static void on_error(exr_const_context_t context, exr_result_t code, const char *message)
{
    void *user = NULL;
    if (exr_get_user_data(context, &user) || !user)
        return;
    struct sink *sink = user;
    strncpy(sink->message, message, sizeof sink->message - 1);
}

static size_t sample_bytes(enum ls_exr_type type)
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
    size_t bytes = sample_bytes(channel->type), stride = channel->pixel_stride_bytes;
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

static exr_result_t write_tiles(exr_context_t context, int index, const struct ls_exr_part *part,
                                uint8_t *tile)
{
    const struct ls_exr_channel *sorted[MAX_CHANNELS];
    sort_channels(part, sorted);
    exr_result_t r = EXR_ERR_SUCCESS;
    for (uint32_t y = 0; y < part->height && !r; y += LS_EXR_TILE_PX)
        for (uint32_t x = 0; x < part->width && !r; x += LS_EXR_TILE_PX) {
            uint32_t w = part->width - x < LS_EXR_TILE_PX ? part->width - x : LS_EXR_TILE_PX;
            uint32_t h = part->height - y < LS_EXR_TILE_PX ? part->height - y : LS_EXR_TILE_PX;
            size_t n = 0;
            for (uint32_t row = y; row < y + h; row++)
                for (size_t c = 0; c < part->n_channels; c++)
                    n += pack_row(sorted[c], x, row, w, tile + n);
            r = exr_write_tile_chunk(context, index, x / LS_EXR_TILE_PX, y / LS_EXR_TILE_PX, 0, 0,
                                     tile, n);
        }
    return r;
}

static exr_result_t declare_part(exr_context_t context, const struct ls_exr_part *part, int *index)
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
                                         EXR_LINEORDER_INCREASING_Y, EXR_COMPRESSION_NONE);
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

static enum ls_err check_part(const struct ls_exr_part *part, size_t n_parts, struct ls_diag *diag)
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
    if (!part->n_channels || part->n_channels > MAX_CHANNELS)
        return ls_fail(diag, LS_ERR_INVALID, "OpenEXR: %zu channels: expected 1 to %d",
                       part->n_channels, MAX_CHANNELS);
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

static size_t pixel_bytes(const struct ls_exr_part *part)
{
    size_t n = 0;
    for (size_t c = 0; c < part->n_channels; c++)
        n += sample_bytes(part->channels[c].type);
    return n;
}

/* Room for everything but long attributes, so that the sink grows rarely. */
static size_t expected_bytes(const struct ls_exr_part *parts, size_t n_parts)
{
    size_t n = 65536;
    for (size_t p = 0; p < n_parts; p++) {
        size_t tiles =
            (size_t)(parts[p].width / LS_EXR_TILE_PX + 1) * (parts[p].height / LS_EXR_TILE_PX + 1);
        n += (size_t)parts[p].width * parts[p].height * pixel_bytes(&parts[p]) + tiles * 32;
    }
    return n;
}

static exr_result_t write_parts(exr_context_t context, const struct ls_exr_part *parts,
                                size_t n_parts)
{
    exr_result_t r = EXR_ERR_SUCCESS;
    size_t widest = 0;
    for (size_t p = 0; p < n_parts && !r; p++) {
        int index;
        r = declare_part(context, &parts[p], &index);
        widest = pixel_bytes(&parts[p]) > widest ? pixel_bytes(&parts[p]) : widest;
    }
    if (!r)
        r = exr_write_header(context);
    LS_CLEANUP_FREE uint8_t *tile = malloc(LS_EXR_TILE_PX * LS_EXR_TILE_PX * widest);
    if (!tile)
        return EXR_ERR_OUT_OF_MEMORY;
    for (size_t p = 0; p < n_parts && !r; p++)
        r = write_tiles(context, (int)p, &parts[p], tile);
    return r;
}

static enum ls_err fail(const struct sink *sink, exr_result_t r, struct ls_diag *diag)
{
    enum ls_err err = r == EXR_ERR_OUT_OF_MEMORY || sink->full ? LS_ERR_NOMEM : LS_ERR_INVALID;
    return ls_fail(diag, err, "OpenEXR: cannot write: %s",
                   *sink->message ? sink->message : exr_get_default_error_message(r));
}

static enum ls_err check_parts(const struct ls_exr_part *parts, size_t n_parts,
                               struct ls_diag *diag)
{
    if (!n_parts || n_parts > INT16_MAX)
        return ls_fail(diag, LS_ERR_INVALID, "OpenEXR: a file of %zu parts", n_parts);
    for (size_t p = 0; p < n_parts; p++) {
        enum ls_err err = check_part(&parts[p], n_parts, diag);
        if (err)
            return err;
    }
    return LS_OK;
}

static enum ls_err write_into(const struct ls_exr_part *parts, size_t n_parts, struct sink *sink,
                              struct ls_diag *diag)
{
    exr_context_initializer_t init = EXR_DEFAULT_CONTEXT_INITIALIZER;
    init.error_handler_fn = on_error;
    init.user_data = sink;
    init.write_fn = write_at;
    init.max_image_width = init.max_image_height = LS_EXR_MAX_PX;
    init.max_tile_width = init.max_tile_height = LS_EXR_MAX_PX;

    exr_context_t context = NULL;
    exr_result_t r = exr_start_write(&context, "picture", EXR_WRITE_FILE_DIRECTLY, &init);
    if (!r)
        r = write_parts(context, parts, n_parts);
    exr_result_t finished = context ? exr_finish(&context) : EXR_ERR_SUCCESS;
    r = r ? r : finished;
    return r ? fail(sink, r, diag) : LS_OK;
}

enum ls_err ls_exr_write(const struct ls_exr_part *parts, size_t n_parts, uint8_t **bytes,
                         size_t *n_bytes, struct ls_diag *diag)
{
    struct sink sink = {0};
    enum ls_err err = check_parts(parts, n_parts, diag);
    if (!err && !grow(&sink, expected_bytes(parts, n_parts)))
        err = ls_fail(diag, LS_ERR_NOMEM, "OpenEXR: no memory");
    if (!err)
        err = write_into(parts, n_parts, &sink, diag);
    if (err) {
        free(sink.bytes);
        return err;
    }
    *bytes = sink.bytes;
    *n_bytes = sink.n;
    return LS_OK;
}

static bool all_zero(const uint8_t *bytes, size_t n)
{
    return !n || (!bytes[0] && !memcmp(bytes, bytes + 1, n - 1));
}

/* A mosaic as parts of a file. */
struct mosaic_parts {
    struct ls_exr_channel y, validity;
    struct ls_exr_part parts[2];
    size_t n;
};

static void describe(const struct ls_exr_mosaic *mosaic, struct mosaic_parts *out)
{
    bool half = mosaic->half != NULL;
    size_t stride = half ? 2 : 4;
    out->y = (struct ls_exr_channel){"Y",
                                     half ? LS_EXR_HALF : LS_EXR_FLOAT,
                                     half ? LS_EXR_FROM_HALF : LS_EXR_FROM_FLOAT,
                                     half ? (const void *)mosaic->half : mosaic->floats,
                                     stride,
                                     stride * mosaic->width};
    out->validity = (struct ls_exr_channel){"Y", LS_EXR_HALF,  LS_EXR_FROM_U8, mosaic->validity,
                                            1,   mosaic->width};
    for (int k = 0; k < 2; k++)
        out->parts[k] = (struct ls_exr_part){.name = k ? "validity" : "mosaic",
                                             .width = mosaic->width,
                                             .height = mosaic->height,
                                             .channels = k ? &out->validity : &out->y,
                                             .n_channels = 1,
                                             .attrs = k ? NULL : mosaic->attrs};
    bool flagged =
        mosaic->validity && !all_zero(mosaic->validity, (size_t)mosaic->width * mosaic->height);
    out->n = flagged ? 2 : 1;
}

static enum ls_err check_mosaic(const struct ls_exr_mosaic *mosaic, struct ls_diag *diag)
{
    return !mosaic->half == !mosaic->floats
               ? ls_fail(diag, LS_ERR_INVALID, "OpenEXR: a mosaic is either half or float")
               : LS_OK;
}

enum ls_err ls_exr_write_mosaic(const struct ls_exr_mosaic *mosaic, uint8_t **bytes,
                                size_t *n_bytes, struct ls_diag *diag)
{
    struct mosaic_parts file;
    enum ls_err err = check_mosaic(mosaic, diag);
    if (err)
        return err;
    describe(mosaic, &file);
    return ls_exr_write(file.parts, file.n, bytes, n_bytes, diag);
}

enum ls_err ls_exr_write_mosaic_to(const struct ls_exr_mosaic *mosaic, uint8_t *bytes,
                                   size_t capacity, size_t *n_bytes, struct ls_diag *diag)
{
    struct mosaic_parts file;
    struct sink sink = {.bytes = bytes, .capacity = capacity, .fixed = true};
    enum ls_err err = check_mosaic(mosaic, diag);
    if (err)
        return err;
    describe(mosaic, &file);
    err = check_parts(file.parts, file.n, diag);
    if (!err)
        err = write_into(file.parts, file.n, &sink, diag);
    *n_bytes = sink.n;
    return err;
}

enum ls_err ls_exr_write_image(const struct ls_image *image, enum ls_exr_type type,
                               const struct ls_exr_attrs *attrs, uint8_t **bytes, size_t *n_bytes,
                               struct ls_diag *diag)
{
    static const char *const names[2][3] = {{"Y"}, {"R", "G", "B"}};
    struct ls_exr_channel channels[3];
    for (uint32_t c = 0; c < image->n_channels && c < 3; c++)
        channels[c] =
            (struct ls_exr_channel){names[image->n_channels == 3][c],
                                    type,
                                    LS_EXR_FROM_FLOAT,
                                    image->pixels + c,
                                    image->n_channels * sizeof(float),
                                    (size_t)image->width * image->n_channels * sizeof(float)};
    struct ls_exr_part part = {.width = image->width,
                               .height = image->height,
                               .channels = channels,
                               .n_channels = image->n_channels,
                               .attrs = attrs};
    if (image->n_channels != 1 && image->n_channels != 3)
        return ls_fail(diag, LS_ERR_INVALID, "OpenEXR: a picture of %u channels: expected 1 or 3",
                       image->n_channels);
    return ls_exr_write(&part, 1, bytes, n_bytes, diag);
}

static uint64_t mosaic_bytes(uint32_t width, uint32_t height, size_t bytes_per_pixel)
{
    uint64_t pixels = (uint64_t)width * height;
    uint64_t tiles =
        ((uint64_t)width / LS_EXR_TILE_PX + 1) * ((uint64_t)height / LS_EXR_TILE_PX + 1);
    /* per tile and part 8 bytes of table and 24 of leader */
    return pixels * bytes_per_pixel + tiles * 2 * 32 + 32768;
}

uint64_t ls_exr_mosaic_bytes_max(uint32_t width, uint32_t height, enum ls_exr_type type)
{
    return mosaic_bytes(width, height, sample_bytes(type) + 2 /* the validity plane as half */);
}

uint64_t ls_exr_mosaic_room(const struct ls_exr_mosaic *mosaic)
{
    size_t bytes = (mosaic->half ? 2 : 4) + (mosaic->validity ? 2 : 0);
    return mosaic_bytes(mosaic->width, mosaic->height, bytes);
}
