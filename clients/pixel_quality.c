#include "clients/pixel_quality.h"

#include <stdlib.h>
#include <string.h>

static enum ls_err allocate(struct ls_pixel_quality *quality, size_t n, struct ls_diag *diag)
{
    if (quality->want_variance && !quality->variance)
        quality->variance = calloc(n, sizeof *quality->variance);
    if (quality->want_validity && !quality->validity)
        quality->validity = calloc(n, 1);
    return !quality->want_variance == !quality->variance &&
                   !quality->want_validity == !quality->validity
               ? LS_OK
               : ls_fail(diag, LS_ERR_NOMEM, "out of memory for a picture");
}

enum ls_err ls_pixel_quality_take(struct ls_pixel_quality *quality,
                                  const struct lightstage_band *band, struct ls_diag *diag)
{
    size_t px = (size_t)band->n_rows * band->width, at = (size_t)band->first_row * band->width;
    if (!band->variance != !quality->want_variance || !band->validity != !quality->want_validity)
        return ls_fail(diag, LS_ERR_INVALID,
                       "the daemon did not send the validity or variance that was asked for");
    enum ls_err err = allocate(quality, (size_t)band->width * band->height, diag);
    if (err)
        return err;
    if (band->variance)
        memcpy(quality->variance + at, band->variance, px * sizeof(float));
    if (band->validity)
        memcpy(quality->validity + at, band->validity, px);
    return LS_OK;
}

json_t *ls_pixel_quality_json(const struct ls_pixel_quality *quality, size_t n)
{
    json_int_t count[256] = {0};
    if (!quality->validity)
        return NULL;
    for (size_t i = 0; i < n; i++)
        count[quality->validity[i]]++;
    return json_pack("{sI sI sI}", "saturated", count[LS_VALIDITY_SATURATED], "dark",
                     count[LS_VALIDITY_DARK], "gap", count[LS_VALIDITY_GAP]);
}

void ls_pixel_quality_finish(struct ls_pixel_quality *quality)
{
    free(quality->variance);
    free(quality->validity);
    quality->variance = NULL;
    quality->validity = NULL;
}
