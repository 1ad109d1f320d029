/*
 * image: a picture of linear floats in memory, what every codec reads into and writes from.
 * Layer: core. Threads: any, one at a time per image. Ownership: the image owns its pixels.
 */
#ifndef LS_CORE_IMAGE_H
#define LS_CORE_IMAGE_H

#include "core/error.h"

#include <stddef.h>
#include <stdint.h>

/** Row-major, top row first, left pixel first, channels interleaved: (height, width, channels). */
struct ls_image {
    uint32_t width, height; /* px, >= 1 */
    uint32_t n_channels;    /* 1 (Y) or 3 (R G B) */
    float *pixels;
};

/**
 * Allocate zeroed pixels. Errors: LS_ERR_INVALID (a size of 0, channels other than 1 and 3),
 * LS_ERR_LIMIT (more than @limit_bytes of pixels), LS_ERR_NOMEM. @image is untouched on error.
 */
LS_MUST_CHECK enum ls_err ls_image_init(struct ls_image *image, uint32_t width, uint32_t height,
                                        uint32_t n_channels, size_t limit_bytes,
                                        struct ls_diag *diag);

/** Free the pixels and zero the struct. Zeroed images are allowed. */
void ls_image_finish(struct ls_image *image);

#endif
