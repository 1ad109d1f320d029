/*
 * dark_stage: the darks of one camera: summed, checked, published, kept for the merge; and the
 * watches between the lights, compared with them.
 * Layer: daemon. Threads: add from any merge thread; the rest while no frames come. Ownership: owns
 * its sums, means and list of defective pixels.
 */
#ifndef LS_DAEMON_DARK_STAGE_H
#define LS_DAEMON_DARK_STAGE_H

#include "core/dark.h"
#include "core/hot_pixels.h"
#include "core/error.h"
#include "core/pixel.h"
#include "daemon/plan.h"

#include <pthread.h>
#include <stdbool.h>
#include <stdint.h>

struct ls_dark_exposure {
    struct ls_dark *sum;        /* NULL once the mean exists */
    float *mean_dn;             /* NULL until then */
    struct ls_dark_stats stats; /* with the mean; adopted: noise and shares are NAN */
    uint32_t n_defects;         /* found in this exposure */
    uint8_t *validity;          /* published with the mean: LS_VALIDITY_GAP at these; NULL: none */
};

struct ls_dark_stage {
    const struct ls_pixel_format *format;
    uint32_t width, height;
    bool black_check;
    pthread_mutex_t lock;
    struct ls_dark_exposure exposures[LS_MAX_EXPOSURES];
    struct ls_pixel_list defects; /* union over exposures */
    struct ls_dark *watch;        /* sum of the watch under way, or NULL */
};

/** A watch against the dark of its exposure, means over all pixels. */
struct ls_dark_drift {
    double difference_dn; /* watch - dark */
    double allowed_dn;    /* max(LS_DARK_DRIFT_DN, 5 standard errors of the difference) */
};

#define LS_DARK_DRIFT_DN 0.05

void ls_dark_stage_init(struct ls_dark_stage *stage, const struct ls_pixel_format *format,
                        uint32_t width, uint32_t height, bool black_check);
void ls_dark_stage_finish(struct ls_dark_stage *stage);

/** Make the sum of an exposure. LS_ERR_NOMEM, LS_ERR_LIMIT. */
LS_MUST_CHECK enum ls_err ls_dark_stage_expect(struct ls_dark_stage *stage, uint32_t exposure,
                                               struct ls_diag *diag);

/** A mean of @n_frames from an earlier run of the take, width height floats in DN; defective pixels
 * are searched in it, without those that only show in the variance: these stand in its published
 * validity, see ls_dark_stage_know. */
LS_MUST_CHECK enum ls_err ls_dark_stage_adopt(struct ls_dark_stage *stage, uint32_t exposure,
                                              uint32_t n_frames, const float *mean_dn,
                                              struct ls_diag *diag);

/** Defective pixels that an earlier run of the take has found. LS_ERR_NOMEM. */
LS_MUST_CHECK enum ls_err ls_dark_stage_know(struct ls_dark_stage *stage,
                                             const struct ls_pixel_list *defects,
                                             struct ls_diag *diag);

/** Fold in a frame. */
LS_MUST_CHECK enum ls_err ls_dark_stage_add(struct ls_dark_stage *stage, uint32_t exposure,
                                            const void *raw, struct ls_diag *diag);

/** All frames are in: form the mean, find defective pixels, free the sum. LS_ERR_INVALID: the black
 * level clips and black_check is set. */
LS_MUST_CHECK enum ls_err ls_dark_stage_close(struct ls_dark_stage *stage, uint32_t exposure,
                                              struct ls_diag *diag);

/** Fold a frame into the watch under way; the first one begins it. One watch at a time. */
LS_MUST_CHECK enum ls_err ls_dark_stage_watch(struct ls_dark_stage *stage, const void *raw,
                                              struct ls_diag *diag);

/** Forget the watch under way, if there is one. */
void ls_dark_stage_drop_watch(struct ls_dark_stage *stage);

/** All frames of the watch are in: its mean, width height floats in DN, and how far it is from the
 * dark of @exposure, which is closed or adopted. The standard error of a mean over n pixels and K
 * frames is sqrt((read noise^2 + 1/12) / (n K)); an adopted dark counts with the watch's noise. */
LS_MUST_CHECK enum ls_err ls_dark_stage_close_watch(struct ls_dark_stage *stage, uint32_t exposure,
                                                    float *mean_dn, struct ls_dark_drift *drift,
                                                    struct ls_diag *diag);

#endif
