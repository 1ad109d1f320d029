#include "clients/received_band.h"

#include "core/half.h"

#include <stdlib.h>
#include <string.h>

static enum ls_err put_values(float *to, const struct lightstage_band *band, struct ls_diag *diag)
{
    bool half = band->sample == LIGHTSTAGE_HALF;
    uint16_t *halfs = half ? malloc(band->values_bytes + 1) : NULL;
    if (half && !halfs)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    memcpy(half ? (void *)halfs : (void *)to, band->values, band->values_bytes);
    if (half)
        ls_half_to_floats(halfs, to, band->values_bytes / sizeof *halfs);
    free(halfs);
    return LS_OK;
}

enum ls_err ls_received_band(struct ls_image *image, struct ls_pixel_quality *quality,
                             const struct lightstage_band *band, bool *whole, struct ls_diag *diag)
{
    enum ls_err err = LS_OK;
    if (!image->pixels)
        err = ls_image_init(image, band->width, band->height, band->components, (size_t)4 << 30,
                            diag);
    if (err)
        return err;
    if (band->width != image->width || band->components != image->n_channels ||
        band->height != image->height)
        return ls_fail(diag, LS_ERR_INVALID, "the daemon sent rows that do not fit the picture");
    err = ls_pixel_quality_take(quality, band, diag);
    if (!err)
        err = put_values(image->pixels + (size_t)band->first_row * image->width * image->n_channels,
                         band, diag);
    *whole = !err && band->first_row + band->n_rows == band->height;
    return err;
}
