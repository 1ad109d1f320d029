#include "clients/picture_file.h"

#include "clients/command.h"
#include "core/png.h"

#include <math.h>
#include <stdlib.h>

static bool any_flag(const struct ls_pixel_quality *quality, size_t n)
{
    for (size_t i = 0; quality->validity && i < n; i++)
        if (quality->validity[i] != LS_VALIDITY_OK)
            return true;
    return false;
}

/* Parts behind @parts[0], like it but for their one channel. Returns how many there are. */
static size_t add_quality(const struct ls_pixel_quality *quality, struct ls_exr_part parts[3],
                          struct ls_exr_channel channels[2])
{
    size_t width = parts[0].width, n = 1;
    channels[0] =
        (struct ls_exr_channel){"Y", LS_EXR_HALF, LS_EXR_FROM_U8, quality->validity, 1, width};
    channels[1] = (struct ls_exr_channel){
        "Y",           LS_EXR_FLOAT,         LS_EXR_FROM_FLOAT, quality->variance,
        sizeof(float), width * sizeof(float)};
    for (int k = 0; k < 2; k++) {
        if (k == 0 ? !any_flag(quality, width * parts[0].height) : !quality->variance)
            continue;
        parts[n] = parts[0];
        parts[n].name = k == 0 ? "validity" : "variance";
        parts[n].channels = &channels[k];
        parts[n].n_channels = 1;
        parts[n++].attrs = NULL;
    }
    parts[0].name = n > 1 ? "mosaic" : NULL;
    return n;
}

enum ls_err ls_picture_file_exr(const char *path, const struct ls_image *image,
                                enum ls_exr_type type, const struct ls_picture_place *place,
                                const struct ls_pixel_quality *quality,
                                const struct ls_exr_attrs *attrs, struct ls_diag *diag)
{
    static const char *const rgb[] = {"R", "G", "B"}, *const grey[] = {"Y"};
    struct ls_exr_channel channels[3];
    uint32_t n = image->n_channels;
    for (uint32_t c = 0; c < n; c++)
        channels[c] =
            (struct ls_exr_channel){.name = n == 3 ? rgb[c] : grey[c],
                                    .type = type,
                                    .source = LS_EXR_FROM_FLOAT,
                                    .pixels = image->pixels + c,
                                    .pixel_stride_bytes = n * sizeof(float),
                                    .row_stride_bytes = (size_t)image->width * n * sizeof(float)};
    struct ls_exr_channel behind[2];
    struct ls_exr_part parts[3] = {{.width = image->width,
                                    .height = image->height,
                                    .x = place->x,
                                    .y = place->y,
                                    .display_width = place->whole_width,
                                    .display_height = place->whole_height,
                                    .channels = channels,
                                    .n_channels = n,
                                    .attrs = attrs}};
    uint8_t *bytes = NULL;
    size_t size = 0;
    size_t n_parts = quality ? add_quality(quality, parts, behind) : 1;
    enum ls_err err = ls_exr_write(parts, n_parts, &bytes, &size, diag);
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

float ls_picture_scale(const struct ls_image *image)
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
        scale = ls_picture_scale(image);
    if (used)
        *used = scale;
    enum ls_err err = ls_png_write(image, scale, &bytes, &size, diag);
    if (!err)
        err = ls_command_write_file(path, bytes, size, diag);
    free(bytes);
    return err;
}
