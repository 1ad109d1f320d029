/*
 * png: PNG pictures between spans of bytes and linear floats.
 * Layer: core (libpng, memory only). Threads: any. Ownership: stated per call.
 *
 * sRGB: IEC 61966-2-1, V = 12.92 L below L = 0.0031308, else 1.055 L^(1/2.4) - 0.055.
 */
#ifndef LS_CORE_PNG_H
#define LS_CORE_PNG_H

#include "core/error.h"
#include "core/image.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/**
 * Read 1 to 16 bit grey (1 channel), RGB or palette (3 channels) to floats in [0, 1].
 * @decode_srgb: apply the inverse sRGB curve; else values are code / maximum code.
 * Chunks that say something about colour (gAMA, iCCP, sRGB) are ignored: the caller decides.
 * Errors: LS_ERR_UNSUPPORTED (an alpha channel or transparent colour), LS_ERR_INVALID (not a PNG,
 * damaged, truncated), LS_ERR_LIMIT (more than @limit_bytes for pixels, or 8 MiB inside libpng).
 * @image: (transfer full).
 */
LS_MUST_CHECK enum ls_err ls_png_read(const void *bytes, size_t n_bytes, bool decode_srgb,
                                      size_t limit_bytes, struct ls_image *image,
                                      struct ls_diag *diag);

/**
 * Write 8 bit RGB (grey for one channel) with the sRGB curve and an sRGB chunk. A pixel v becomes
 * the code nearest to 255 sRGB(v * @scale), clamped to [0, 255]; NaN becomes 0. *bytes:
 * (transfer full), free(). Errors: LS_ERR_INVALID (sizes, a scale that is not positive).
 */
LS_MUST_CHECK enum ls_err ls_png_write(const struct ls_image *image, float scale, uint8_t **bytes,
                                       size_t *n_bytes, struct ls_diag *diag);

#endif
