/*
 * received_band: the rows of a Fetch's answer, put where they belong in their picture.
 * Layer: clients. Threads: the main thread. Ownership: the caller finishes picture and quality.
 */
#ifndef LS_CLIENTS_RECEIVED_BAND_H
#define LS_CLIENTS_RECEIVED_BAND_H

#include "clients/lightstage.h"
#include "clients/pixel_quality.h"
#include "core/image.h"

/**
 * Put a band's rows into @image, which the first band allocates (zeroed before). *whole: these were
 * the last. Errors: LS_ERR_INVALID (rows that do not fit), those of ls_image_init and
 * ls_pixel_quality_take.
 */
LS_MUST_CHECK enum ls_err ls_received_band(struct ls_image *image, struct ls_pixel_quality *quality,
                                           const struct lightstage_band *band, bool *whole,
                                           struct ls_diag *diag);

#endif
