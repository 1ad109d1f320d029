/*
 * pixel_quality: validity and variance of a picture, as the daemon sends them behind its values.
 * Layer: clients. Threads: the main thread. Ownership: owns both; see finish.
 */
#ifndef LS_CLIENTS_PIXEL_QUALITY_H
#define LS_CLIENTS_PIXEL_QUALITY_H

#include "clients/lightstage.h"
#include "core/error.h"
#include "core/merge.h"

#include <jansson.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/** Set what is wanted, the rest zero. */
struct ls_pixel_quality {
    bool want_variance, want_validity;
    float *variance;   /* [height][width] of the picture being received, or NULL */
    uint8_t *validity; /* enum ls_validity, or NULL */
};

/** Keep what comes with @band. Errors: LS_ERR_INVALID (it is not what was asked for: a daemon that
 * does not know validity), LS_ERR_NOMEM. */
LS_MUST_CHECK enum ls_err ls_pixel_quality_take(struct ls_pixel_quality *quality,
                                                const struct lightstage_band *band,
                                                struct ls_diag *diag);

/** {"saturated", "dark", "gap"}: how many of @n pixels; NULL where validity is not wanted.
 * (transfer full). */
json_t *ls_pixel_quality_json(const struct ls_pixel_quality *quality, size_t n);

/** Forget the picture; what is wanted stays. */
void ls_pixel_quality_finish(struct ls_pixel_quality *quality);

#endif
