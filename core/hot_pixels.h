/*
 * hot_pixels: find hot and noisy pixels in dark statistics; lists of pixels.
 * Layer: core. Threads: any. Ownership: a list owns its indices; free with ls_pixel_list_finish.
 */
#ifndef LS_CORE_HOT_PIXELS_H
#define LS_CORE_HOT_PIXELS_H

#include "core/error.h"
#include "core/pixel.h"

#include <stdint.h>

/** Pixels by index y width + x, ascending, without duplicates: what ls_merge_params.defects
 * takes. */
struct ls_pixel_list {
    uint32_t n;
    uint32_t *index; /* NULL when n is 0 */
};

/**
 * Hot: the mean lies above the second largest of its eight same-colour neighbours by more than
 * 8 robust sigmas (1.4826 times the median absolute difference of a pixel from its neighbours'
 * median) and by more than 1 DN. Ambient light wider than a pixel is not taken for a hot pixel,
 * and neither of two hot neighbours hides the other.
 * Noisy: the variance lies above 36 times the median variance and above 4 DN^2; needs the variance
 * of at least 8 frames to mean anything, so pass NULL for fewer.
 * @mean_dn, @variance_dn2: width height floats, all finite (see ls_dark_mean).
 * Errors: LS_ERR_NOMEM. @list: (transfer full), empty on error.
 */
LS_MUST_CHECK enum ls_err ls_hot_pixels(const float *mean_dn, const float *variance_dn2,
                                        enum ls_cfa cfa, uint32_t width, uint32_t height,
                                        struct ls_pixel_list *list);

/** Make @into the union of both lists. LS_ERR_NOMEM leaves it unchanged. */
LS_MUST_CHECK enum ls_err ls_pixel_list_join(struct ls_pixel_list *into,
                                             const struct ls_pixel_list *other);

/** Frees the indices; an all-zero list is allowed. */
void ls_pixel_list_finish(struct ls_pixel_list *list);

#endif
