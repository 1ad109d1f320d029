#include "clients/received_band.h"

#include "core/half.h"

#include <stdlib.h>
#include <string.h>

static enum ls_err put_values(float *to, const uint8_t *payload, size_t values, bool half,
                              struct ls_diag *diag)
{
    size_t bytes = values * (half ? 2 : 4);
    uint16_t *halfs = half ? malloc(bytes + 1) : NULL;
    if (half && !halfs)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    memcpy(half ? (void *)halfs : (void *)to, payload, bytes);
    if (half)
        ls_half_to_floats(halfs, to, values);
    free(halfs);
    return LS_OK;
}

enum ls_err ls_received_band(struct ls_image *image, struct ls_pixel_quality *quality,
                             const struct ls_reply *reply, bool *whole, struct ls_diag *diag)
{
    if (reply->type != (LS_MESSAGE_FETCH | LS_MESSAGE_REPLY))
        return ls_fail(diag, LS_ERR_INVALID, "the daemon answered with another message");
    const Lightstage__FetchReply *band = (const Lightstage__FetchReply *)reply->message;
    size_t values = (size_t)band->n_rows * band->width * band->components;
    bool half = band->sample == LIGHTSTAGE__SAMPLE__HALF;
    enum ls_err err = LS_OK;
    if (!image->pixels)
        err = ls_image_init(image, band->width, band->height, band->components, (size_t)4 << 30,
                            diag);
    if (err)
        return err;
    if (band->width != image->width || band->components != image->n_channels ||
        band->first_row > image->height || band->n_rows > image->height - band->first_row ||
        reply->payload_bytes < values * (half ? 2 : 4))
        return ls_fail(diag, LS_ERR_INVALID, "the daemon sent rows that do not fit the picture");
    err = ls_pixel_quality_take(quality, band, reply->payload, reply->payload_bytes,
                                values * (half ? 2 : 4), diag);
    if (!err)
        err = put_values(image->pixels + (size_t)band->first_row * image->width * image->n_channels,
                         reply->payload, values, half, diag);
    *whole = !err && band->first_row + band->n_rows == band->height;
    return err;
}
