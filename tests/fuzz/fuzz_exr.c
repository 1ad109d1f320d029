/* exr: what is read is the same after it was written and read again; tiles lie inside the file and
 * hold what a plane of the same part holds. */
#include "core/exr.h"
#include "tests/fuzz/fuzz.h"

#include <string.h>

static const size_t limit = 32 << 20;

static void read_picture(const uint8_t *data, size_t n)
{
    struct ls_image image = {0}, back = {0};
    struct ls_exr_attrs attrs = {0};
    struct ls_diag diag = {0};
    uint8_t *bytes = NULL;
    size_t n_bytes;
    enum ls_err err = ls_exr_read(data, n, NULL, limit, &image, &attrs, &diag);
    HOLDS_REFUSED(err, diag);
    if (!err) {
        size_t size = (size_t)image.width * image.height * image.n_channels * sizeof(float);
        HOLDS(image.width && image.height && size <= limit);
        HOLDS(!attrs.err);
        if (size < 1 << 20) { /* a larger one says nothing more */
            HOLDS(!ls_exr_write_image(&image, LS_EXR_FLOAT, NULL, &bytes, &n_bytes, NULL));
            HOLDS(!ls_exr_read(bytes, n_bytes, NULL, limit, &back, NULL, NULL));
            HOLDS(back.width == image.width && back.height == image.height &&
                  back.n_channels == image.n_channels);
            HOLDS(!memcmp(back.pixels, image.pixels, size));
        }
    }
    free(bytes);
    ls_image_finish(&back);
    ls_image_finish(&image);
    ls_exr_attrs_finish(&attrs);
}

static void compare(const struct ls_exr_tiles *tiles, const struct ls_exr_plane *plane)
{
    size_t sample = plane->type == LS_EXR_HALF ? 2 : 4;
    HOLDS(plane->width == tiles->width && plane->height == tiles->height);
    HOLDS(plane->type == tiles->type);
    for (uint32_t y = 0; y < tiles->height; y++)
        for (uint32_t tx = 0; tx < tiles->n_x; tx++) {
            uint32_t ty = y / tiles->tile_h, width = ls_exr_tile_width(tiles, tx);
            const uint8_t *row = tiles->tile[(size_t)ty * tiles->n_x + tx] +
                                 (size_t)(y - ty * tiles->tile_h) * width * sample;
            HOLDS(!memcmp(row,
                          (const uint8_t *)plane->samples +
                              ((size_t)y * plane->width + (size_t)tx * tiles->tile_w) * sample,
                          width * sample));
        }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t n)
{
    struct ls_exr_tiles tiles = {0};
    struct ls_exr_plane plane = {0};
    struct ls_diag diag = {0}, why = {0};
    read_picture(data, n);
    enum ls_err mapped = ls_exr_map_tiles(data, n, NULL, &tiles, &diag);
    enum ls_err read = ls_exr_read_plane(data, n, NULL, limit, &plane, &why);
    HOLDS_REFUSED(mapped, diag);
    HOLDS_REFUSED(read, why);
    if (!mapped && !read)
        compare(&tiles, &plane);
    ls_exr_tiles_finish(&tiles);
    free(plane.samples);
    return 0;
}
