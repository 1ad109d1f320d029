/*
 * level: pictures at half and quarter size, as means of whole pixels.
 * Layer: core. Threads: any, one at a time per object. Ownership: below.
 *
 * A pixel (X, Y) of level L is the mean of the pixels [sX, sX + s) x [sY, sY + s) that the full
 * picture has, s = 2^L: all s x s of them, fewer at the right and bottom edge of a picture whose
 * size s does not divide. So level L of W pixels has ceil(W / s), and none is left out.
 *
 * Each component by itself. Its addends are floats, added up in double in reading order, divided by
 * how many there are, and rounded to float once: the nearest float of the exact mean within 2^-24
 * of it and 16 x 2^-53 of the mean of the magnitudes. Where the addends are halves, or lie within a
 * factor of 2^25 of each other, the sum is exact. Example: 1, 2, 3, 5 make 2.75. Inf and NaN go on
 * into the pixel they belong to, and into no other. The result does not depend on how rows are cut
 * into bands.
 */
#ifndef LS_CORE_LEVEL_H
#define LS_CORE_LEVEL_H

#include "core/demosaic.h"
#include "core/error.h"

#include <stddef.h>
#include <stdint.h>

enum { LS_LEVEL_MAX = 2 };

/** Pixels of level @level in a row or column of @n. RT-safe. */
uint32_t ls_level_size(uint32_t n, uint32_t level);

/** The level's pixels that touch @region of the full picture: what is sent of it. RT-safe. */
struct ls_demosaic_region ls_level_region(struct ls_demosaic_region region, uint32_t level);

/** The pixels of the full picture, @width x @height, that pixels @region of the level are made of.
 * RT-safe. */
struct ls_demosaic_region ls_level_needs(struct ls_demosaic_region region, uint32_t level,
                                         uint32_t width, uint32_t height);

/** A picture on its way, row by row. */
struct ls_level_rows {
    uint32_t level, components;
    uint32_t width;     /* of the full rows */
    uint32_t rows_left; /* full rows that are still to come */
    uint32_t n_added;   /* full rows in the sums, [0, 2^level) */
    double *sums;       /* of the row being made */
};

/** Begin at @needs, as ls_level_needs says. LS_ERR_NOMEM. Zeroed or finished before; finish it. */
LS_MUST_CHECK enum ls_err ls_level_rows_init(struct ls_level_rows *rows, uint32_t level,
                                             const struct ls_demosaic_region *needs,
                                             uint32_t components, struct ls_diag *diag);

/** The next @n full rows, [n][width][components]. Fills out[rows][ceil(width / s)][components] with
 * those rows of the level that are complete and returns how many: at most n / s + 2, where the picture
 * ends. */
uint32_t ls_level_rows_add(struct ls_level_rows *rows, const float *in, uint32_t n, float *out);

/** Zeroed is allowed. */
void ls_level_rows_finish(struct ls_level_rows *rows);

#endif
