/*
 * demosaic: a float mosaic to RGB, for any region, identical to the same region of the whole.
 * Layer: core. Threads: any; pure. Ownership: everything is the caller's.
 *
 * Two linear filters. Summing lights on the mosaic and demosaicing once is therefore exact for
 * weights equal in R, G and B. For weights that differ it is wrong with GRADIENT, which mixes
 * colours (accumulate once per distinct weight), and exact with BILINEAR, which does not, if each
 * pixel takes its own colour's weight. Ratios and matrices are formed after demosaicing, never
 * before.
 *
 * BILINEAR averages the 2 or 4 nearest samples of the colour. GRADIENT (default) adds the second
 * derivative of the colour that *is* known at the pixel, the class of Malvar, He and Cutler,
 * "High-quality linear interpolation for demosaicing of Bayer-patterned color images" (ICASSP
 * 2004); its coefficients are derived in demosaic_lanes.h. Both reproduce constants, and linear
 * ramps away from the border; a neutral (R = G = B) quadratic is reproduced by GRADIENT far better.
 *
 * Border: coordinates are mirrored about the centre of the outermost pixel (-1 -> 1, W -> W - 2),
 * which keeps their parity and therefore their colour. An image one pixel wide or high has no
 * parity to keep; there the missing colours are taken from what is there (a 1 x 1 image is grey).
 *
 * Accuracy: float, fixed order of summation; error <= 2e-6 of the largest sample in the 5 x 5
 * neighbourhood, the same bits from every instruction set. NaN and Inf stay within two pixels of
 * where they were. Halves in are widened exactly; halves out are rounded once, at the end.
 */
#ifndef LS_CORE_DEMOSAIC_H
#define LS_CORE_DEMOSAIC_H

#include "core/error.h"
#include "core/pixel.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum ls_demosaic_method {
    LS_DEMOSAIC_GRADIENT,
    LS_DEMOSAIC_BILINEAR,
};

/** Pixels around a region that its result depends on, for either method. */
enum { LS_DEMOSAIC_HALO = 2 };

/** A rectangle of pixels. */
struct ls_demosaic_region {
    uint32_t x, y, width, height;
};

/** A window of a mosaic in memory; its place in the whole image gives the colours. */
struct ls_demosaic_source {
    const float *data;                /* pixel (window.x, window.y); NULL: see half */
    size_t stride;                    /* samples from row to row */
    struct ls_demosaic_region window; /* what of the image is in memory */
    uint32_t image_width, image_height;
    enum ls_cfa cfa;      /* of pixel (0, 0) of the image; NONE copies to all three */
    const uint16_t *half; /* in place of data: the same mosaic in halves */
};

/** Where RGB goes. Planar: plane[c], pixel_step 1. Interleaved: plane[c] = base + c,
 * pixel_step 3. As float, or as the nearest half (half[] in place of plane[], which is then NULL),
 * where what lies beyond half's range becomes +-65504. With @add, interleaved floats grow instead:
 * plane[c] += (scale rgb[c]) ratio[c]. With @half_ratio, interleaved halves are what core/factored
 * makes of those halves: half[c] = scale rgb[c] half_ratio[c]. */
struct ls_demosaic_target {
    float *plane[3];
    size_t pixel_step, row_step; /* in samples */
    uint16_t *half[3];
    bool add;
    float scale;
    const float *ratio;         /* interleaved, its rows ratio_step apart; NULL = 1 */
    const uint16_t *half_ratio; /* likewise */
    size_t ratio_step;
};

/** The part of an image that the demosaic of @region reads: the halo, cut at the border.
 * RT-safe. */
struct ls_demosaic_region ls_demosaic_needs(struct ls_demosaic_region region, uint32_t image_width,
                                            uint32_t image_height);

/**
 * Demosaic @region (image coordinates) of @source into @target, whose first pixel is that of the
 * region. Bit-identical to the same pixels of a demosaic of the whole image. LS_ERR_INVALID when
 * the region is not inside the image, the window does not hold what ls_demosaic_needs says, or
 * source or target is neither float nor half, or both, or adds to anything but interleaved floats,
 * or promotes anything but interleaved halves.
 * Uses about 49 KiB of stack. RT-safe.
 */
LS_MUST_CHECK enum ls_err ls_demosaic(const struct ls_demosaic_source *source,
                                      struct ls_demosaic_region region,
                                      enum ls_demosaic_method method,
                                      const struct ls_demosaic_target *target);

#endif
