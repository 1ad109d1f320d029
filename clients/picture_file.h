/*
 * picture_file: pictures as clients write them: OpenEXR with what they mean, PNG to look at.
 * Layer: clients. Threads: the main thread. Ownership: the caller's.
 */
#ifndef LS_CLIENTS_PICTURE_FILE_H
#define LS_CLIENTS_PICTURE_FILE_H

#include "clients/pixel_quality.h"
#include "core/error.h"
#include "core/exr.h"
#include "core/image.h"

/** Where a region's pixels lie in the whole picture; whole 0 x 0 = the image is all of it. */
struct ls_picture_place {
    int32_t x, y;
    uint32_t whole_width, whole_height;
};

/** @quality: parts "validity" (half; omitted where all is ok) and "variance" (float) behind a part
 * "mosaic", as far as they are there; NULL = none. */
LS_MUST_CHECK enum ls_err
ls_picture_file_exr(const char *path, const struct ls_image *image, enum ls_exr_type type,
                    const struct ls_picture_place *place, const struct ls_pixel_quality *quality,
                    const struct ls_exr_attrs *attrs, struct ls_diag *diag);

/** What makes the 99th percentile of the largest channel, of pixels that are finite, 0.8; of at
 * most 65536 pixels, evenly spread. 1: there is none. */
float ls_picture_scale(const struct ls_image *image);

/** @scale: linear values are multiplied by it; 0 = that of ls_picture_scale, and returned in *used
 * (may be NULL). */
LS_MUST_CHECK enum ls_err ls_picture_file_png(const char *path, const struct ls_image *image,
                                              float scale, float *used, struct ls_diag *diag);

#endif
