/*
 * preview: a raw frame as a small picture to look at, with two figures to set a camera by.
 * Layer: core. Threads: any; pure. Ownership: spans are the caller's.
 *
 * The picture. Blocks of `bin` x `bin` photosites become one pixel: each colour the mean of its
 * photosites in the block (of a mono camera all three alike), less black, over the range to full
 * scale, through the sRGB curve, 8 bit, no white balance. Blocks cut by the right or lower edge are
 * left out.
 *
 * Clip. Of each colour the share of photosites at or above full scale: those whose value is lost.
 *
 * Focus. The energy of the gradient of green (Tenengrad: Krotkov, Focusing, IJCV 1, 1987; by
 * Sobel's operator, no threshold) over the squared mean of green, less what photon and read noise
 * bring: max(0, mean(gx^2 + gy^2) - 24 / 64 v) / mean^2, g per step of the green picture, v the
 * mean variance of its pixels by the camera's noise model. Green is one photosite in each 2 x 2 of
 * a mosaic, all of a mono camera. Brightness cancels, so the figure tells focus apart from exposure
 * while nothing clips; it depends on the subject and its light, so only figures of one framing
 * compare. Where the mean is not twice above the noise of one pixel it is 0.
 */
#ifndef LS_CORE_PREVIEW_H
#define LS_CORE_PREVIEW_H

#include "core/error.h"
#include "core/pixel.h"

#include <stdint.h>

enum { LS_PREVIEW_MOST_BIN = 256 };

struct ls_preview_params {
    const struct ls_pixel_format *format;
    uint32_t width, height; /* of the raw frame, px */
    double black_dn, full_scale_dn;
    double electrons_per_dn, read_noise_dn;
    uint32_t bin; /* even, at most LS_PREVIEW_MOST_BIN; ls_preview_bin's, say */
};

struct ls_preview_figures {
    uint32_t n_colours; /* 3, mono 1 */
    double clip[3];     /* [0, 1] */
    double focus;       /* 0 or more */
};

/** The smallest even bin that leaves at most @most_px pixels (at least 1) in a row and a column. */
uint32_t ls_preview_bin(uint32_t width, uint32_t height, uint32_t most_px);

/** Pixels of the picture in a row, rows. */
static inline uint32_t ls_preview_size(uint32_t px, uint32_t bin)
{
    return px / bin;
}

/**
 * @raw: ls_pixel_payload_bytes. @rgb: [height / bin][width / bin][3]. Errors: LS_ERR_INVALID (no
 * format, a bin that is odd or too large, a frame smaller than a block, black not below full
 * scale), LS_ERR_NOMEM (rows on the way).
 */
LS_MUST_CHECK enum ls_err ls_preview_make(const struct ls_preview_params *params, const void *raw,
                                          uint8_t *rgb, struct ls_preview_figures *figures);

#endif
