#include "clients/picture_file.h"

#include "clients/command.h"
#include "core/png.h"

#include <math.h>
#include <stdlib.h>

enum ls_err ls_picture_file_exr(const char *path, const struct ls_image *image,
                                enum ls_exr_type type, const struct ls_picture_place *place,
                                const struct ls_exr_attrs *attrs, struct ls_diag *diag)
{
    static const char *const rgb[] = {"R", "G", "B"}, *const grey[] = {"Y"};
    struct ls_exr_channel channels[3];
    uint32_t n = image->n_channels;
    for (uint32_t c = 0; c < n; c++)
        channels[c] = (struct ls_exr_channel){.name = n == 3 ? rgb[c] : grey[c],
                                              .type = type,
                                              .source = LS_EXR_FROM_FLOAT,
                                              .pixels = image->pixels + c,
                                              .pixel_stride_bytes = n * sizeof(float),
                                              .row_stride_bytes =
                                                  (size_t)image->width * n * sizeof(float)};
    const struct ls_exr_part part = {.width = image->width,
                                     .height = image->height,
                                     .x = place->x,
                                     .y = place->y,
                                     .display_width = place->whole_width,
                                     .display_height = place->whole_height,
                                     .channels = channels,
                                     .n_channels = n,
                                     .attrs = attrs};
    uint8_t *bytes = NULL;
    size_t size = 0;
    enum ls_err err = ls_exr_write(&part, 1, &bytes, &size, diag);
    if (!err)
        err = ls_command_write_file(path, bytes, size, diag);
    free(bytes);
    return err;
}

static int ascending(const void *a, const void *b)
{
    float x = *(const float *)a, y = *(const float *)b;
    return (x > y) - (x < y);
}

/* From at most 64 Ki pixels, evenly spread. */
static float automatic_scale(const struct ls_image *image)
{
    size_t pixels = (size_t)image->width * image->height, step = pixels / 65536 + 1, n = 0;
    float *largest = malloc((pixels / step + 1) * sizeof *largest);
    for (size_t i = 0; largest && i < pixels; i += step) {
        float value = image->pixels[i * image->n_channels];
        for (uint32_t c = 1; c < image->n_channels; c++)
            value = fmaxf(value, image->pixels[i * image->n_channels + c]);
        if (isfinite(value))
            largest[n++] = value;
    }
    if (n > 0)
        qsort(largest, n, sizeof *largest, ascending);
    float high = n > 0 ? largest[n * 99 / 100] : 0;
    free(largest);
    return high > 0 && isfinite(0.8f / high) ? 0.8f / high : 1;
}

enum ls_err ls_picture_file_png(const char *path, const struct ls_image *image, float scale,
                                float *used, struct ls_diag *diag)
{
    uint8_t *bytes = NULL;
    size_t size = 0;
    if (scale == 0)
        scale = automatic_scale(image);
    if (used)
        *used = scale;
    enum ls_err err = ls_png_write(image, scale, &bytes, &size, diag);
    if (!err)
        err = ls_command_write_file(path, bytes, size, diag);
    free(bytes);
    return err;
}
