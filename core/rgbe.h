/*
 * rgbe: Radiance HDR (.hdr, .pic) read from a span of bytes to linear Rec. 709 floats.
 * Layer: core. Threads: any. Ownership: stated per call.
 *
 * Format: G. Ward, Real Pixels, Graphics Gems II (1991), and Radiance's filefmts.pdf. A pixel
 * (r, g, b, e) is (r, g, b) + 0.5 over 256, times 2^(e - 128), and exactly 0 for e = 0.
 */
#ifndef LS_CORE_RGBE_H
#define LS_CORE_RGBE_H

#include "core/error.h"
#include "core/image.h"

#include <stddef.h>

/**
 * Read a picture. Old and new run lengths and flat pixels; a `#?` line repeated in the header is
 * accepted. Honoured: EXPOSURE (pixels are divided by the product of all of them), the orientations
 * -Y +X and, by flipping, any of the other seven; COLORCORR (divided likewise); PRIMARIES equal to
 * Rec. 709 or Radiance's own default, or all zero, which some programs write for "unset".
 * Refused (LS_ERR_UNSUPPORTED): XYZE, other PRIMARIES, a GAMMA other than 1, PIXASPECT other
 * than 1. LS_ERR_INVALID: malformed, truncated or brighter than a float holds, with the line or
 * scanline. LS_ERR_LIMIT: more than @limit_bytes of memory. @image: (transfer full), 3 channels,
 * top row first.
 */
LS_MUST_CHECK enum ls_err ls_rgbe_read(const void *bytes, size_t n_bytes, size_t limit_bytes,
                                       struct ls_image *image, struct ls_diag *diag);

#endif
