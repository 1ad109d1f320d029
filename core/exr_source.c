#include "core/exr_source.h"

#include <stdlib.h>
#include <string.h>

/* No single table of an honest file of ours is larger; a hostile header asks for more. */
static const size_t alloc_limit_bytes = (size_t)1 << 30;

static void *bounded_alloc(size_t n)
{
    return n > alloc_limit_bytes ? NULL : calloc(1, n); /* nothing unfilled passes for pixels */
}

static int64_t read_at(exr_const_context_t context, void *user, void *buffer, uint64_t n,
                       uint64_t offset, exr_stream_error_func_ptr_t error)
{
    const struct ls_exr_source *source = user;
    if (offset > source->n)
        return error(context, EXR_ERR_READ_IO, "the file ends before byte %llu",
                     (unsigned long long)offset),
               -1;
    uint64_t left = source->n - offset;
    if (n > left)
        n = left;
    memcpy(buffer, source->bytes + offset, n);
    return (int64_t)n;
}

static int64_t size_of(exr_const_context_t context, void *user)
{
    const struct ls_exr_source *source = user;
    return (int64_t)source->n;
}

static void on_error(exr_const_context_t context, exr_result_t code, const char *message)
{
    void *user = NULL;
    if (!context || exr_get_user_data(context, &user) || !user)
        return;
    struct ls_exr_source *source = user;
    strncpy(source->message, message, sizeof source->message - 1);
    for (char *c = source->message; *c; c++) /* it may quote the file */
        if (*c < 0x20 || *c > 0x7e)
            *c = '?';
}

enum ls_err ls_exr_source_open(struct ls_exr_source *source, const void *bytes, size_t n_bytes,
                               struct ls_diag *diag)
{
    static const uint8_t magic[4] = {0x76, 0x2f, 0x31, 0x01};
    *source = (struct ls_exr_source){.bytes = bytes, .n = n_bytes};
    if (n_bytes < 8 || memcmp(bytes, magic, sizeof magic))
        return ls_fail(diag, LS_ERR_INVALID, "not an OpenEXR file: %s",
                       n_bytes < 8 ? "shorter than 8 bytes" : "it does not begin with its mark");
    exr_context_initializer_t init = EXR_DEFAULT_CONTEXT_INITIALIZER;
    init.error_handler_fn = on_error;
    init.alloc_fn = bounded_alloc;
    init.free_fn = free;
    init.user_data = source;
    init.read_fn = read_at;
    init.size_fn = size_of;
    init.max_image_width = init.max_image_height = LS_EXR_MAX_PX;
    init.max_tile_width = init.max_tile_height = LS_EXR_MAX_PX;
    init.flags = EXR_CONTEXT_FLAG_DISABLE_CHUNK_RECONSTRUCTION;
    exr_result_t r = exr_start_read(&source->context, "picture", &init);
    if (r)
        return ls_exr_source_fail(source, r, "cannot read the header", diag);
    return LS_OK;
}

void ls_exr_source_close(struct ls_exr_source *source)
{
    if (source->context)
        exr_finish(&source->context);
    source->context = NULL;
}

enum ls_err ls_exr_source_fail(const struct ls_exr_source *source, exr_result_t result,
                               const char *doing, struct ls_diag *diag)
{
    enum ls_err err = result == EXR_ERR_OUT_OF_MEMORY             ? LS_ERR_LIMIT
                      : result == EXR_ERR_FEATURE_NOT_IMPLEMENTED ? LS_ERR_UNSUPPORTED
                                                                  : LS_ERR_INVALID;
    return ls_fail(diag, err, "OpenEXR: %s: %s", doing,
                   *source->message ? source->message : exr_get_default_error_message(result));
}

static enum ls_err check_window(const exr_attr_box2i_t *window, struct ls_exr_layout *layout,
                                struct ls_diag *diag)
{
    int64_t width = (int64_t)window->max.x - window->min.x + 1;
    int64_t height = (int64_t)window->max.y - window->min.y + 1;
    if (width < 1 || height < 1 || width > LS_EXR_MAX_PX || height > LS_EXR_MAX_PX)
        return ls_fail(diag, LS_ERR_INVALID,
                       "OpenEXR: a data window of %lld x %lld px: expected "
                       "1 x 1 to %d x %d",
                       (long long)width, (long long)height, LS_EXR_MAX_PX, LS_EXR_MAX_PX);
    /* the library adds a window's corner and size in 32 bits */
    if (window->min.x < -(1 << 29) || window->max.x > 1 << 29 || window->min.y < -(1 << 29) ||
        window->max.y > 1 << 29)
        return ls_fail(diag, LS_ERR_INVALID, "OpenEXR: a data window at (%d, %d) is out of range",
                       window->min.x, window->min.y);
    layout->x = window->min.x;
    layout->y = window->min.y;
    layout->width = (uint32_t)width;
    layout->height = (uint32_t)height;
    return LS_OK;
}

static enum ls_err describe_tiles(const struct ls_exr_source *source, int part,
                                  struct ls_exr_layout *layout, struct ls_diag *diag)
{
    int32_t levels_x = 0, levels_y = 0;
    exr_tile_level_mode_t mode;
    exr_tile_round_mode_t round;
    exr_result_t r = exr_get_tile_descriptor(source->context, part, &layout->tile_w,
                                             &layout->tile_h, &mode, &round);
    if (!r)
        r = exr_get_tile_levels(source->context, part, &levels_x, &levels_y);
    if (r)
        return ls_exr_source_fail(source, r, "cannot read the tile layout", diag);
    if (!layout->tile_w || !layout->tile_h || layout->tile_w > LS_EXR_MAX_PX ||
        layout->tile_h > LS_EXR_MAX_PX || levels_x < 1 || levels_y < 1)
        return ls_fail(diag, LS_ERR_INVALID, "OpenEXR: tiles of %u x %u px", layout->tile_w,
                       layout->tile_h);
    layout->n_levels = (uint32_t)levels_x * (uint32_t)levels_y;
    return LS_OK;
}

enum ls_err ls_exr_source_layout(const struct ls_exr_source *source, int part,
                                 struct ls_exr_layout *layout, struct ls_diag *diag)
{
    exr_storage_t storage;
    exr_attr_box2i_t window;
    int32_t n_chunks = 0;
    *layout = (struct ls_exr_layout){0};
    exr_result_t r = exr_get_storage(source->context, part, &storage);
    if (!r && storage != EXR_STORAGE_SCANLINE && storage != EXR_STORAGE_TILED)
        return ls_fail(diag, LS_ERR_UNSUPPORTED,
                       "OpenEXR: deep data is not read; flatten the "
                       "picture first");
    if (!r)
        r = exr_get_data_window(source->context, part, &window);
    if (!r)
        r = exr_get_compression(source->context, part, &layout->compression);
    if (!r)
        r = exr_get_channels(source->context, part, &layout->channels);
    if (!r)
        r = exr_get_chunk_count(source->context, part, &n_chunks);
    if (r)
        return ls_exr_source_fail(source, r, "cannot read the layout", diag);
    enum ls_err err = check_window(&window, layout, diag);
    layout->tiled = storage == EXR_STORAGE_TILED;
    if (!err && layout->tiled)
        err = describe_tiles(source, part, layout, diag);
    if (!err && (n_chunks < 1 || (size_t)n_chunks > source->n / 8))
        err = ls_fail(diag, LS_ERR_INVALID, "OpenEXR: a file of %zu bytes cannot hold %d chunks",
                      source->n, n_chunks);
    return err;
}

int ls_exr_source_part(const struct ls_exr_source *source, const char *name)
{
    int n_parts = 0;
    if (exr_get_count(source->context, &n_parts))
        return -1;
    for (int p = 0; p < n_parts; p++) {
        const char *found = NULL;
        if (!exr_get_name(source->context, p, &found) && found && !strcmp(found, name))
            return p;
    }
    return -1;
}
