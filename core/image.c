#include "core/image.h"

#include <stdlib.h>

enum ls_err ls_image_init(struct ls_image *image, uint32_t width, uint32_t height,
                          uint32_t n_channels, size_t limit_bytes, struct ls_diag *diag)
{
    if (!width || !height || (n_channels != 1 && n_channels != 3))
        return ls_fail(diag, LS_ERR_INVALID,
                       "a picture of %u x %u with %u channels: expected at "
                       "least 1 x 1 with 1 or 3",
                       width, height, n_channels);
    uint64_t n_pixels = (uint64_t)width * height;
    uint64_t pixel_bytes = n_channels * sizeof(float);
    if (n_pixels > limit_bytes / pixel_bytes)
        return ls_fail(diag, LS_ERR_LIMIT,
                       "a picture of %u x %u with %u channels is larger than "
                       "the limit of %zu bytes",
                       width, height, n_channels, limit_bytes);
    float *pixels = calloc(n_pixels, pixel_bytes);
    if (!pixels)
        return ls_fail(diag, LS_ERR_NOMEM, "no memory for a picture of %u x %u", width, height);
    *image = (struct ls_image){width, height, n_channels, pixels};
    return LS_OK;
}

void ls_image_finish(struct ls_image *image)
{
    free(image->pixels);
    *image = (struct ls_image){0};
}
