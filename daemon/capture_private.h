/*
 * capture_private: a plan under way, seen by its parts: capture.c (its life and what others may
 * ask), capture_devices.c (cameras, rings and threads, up and down), capture_passes.c (darks,
 * lights, and again what was lost), capture_books.c (what is said at the end).
 * Layer: daemon. Threads: the one that runs it; `lost`, `abort` and `rate` any.
 */
#ifndef LS_DAEMON_CAPTURE_PRIVATE_H
#define LS_DAEMON_CAPTURE_PRIVATE_H

#include "core/exposure_offset.h"
#include "daemon/camera_thread.h"
#include "daemon/capture.h"
#include "daemon/kept.h"
#include "daemon/merge_stage.h"
#include "daemon/passes.h"
#include "daemon/sequencer.h"
#include "daemon/store.h"
#include "daemon/warm_up.h"

#include <pthread.h>
#include <semaphore.h>
#include <stdatomic.h>

/** Frames per second for whoever watches. */
struct ls_capture_rate {
    pthread_mutex_t lock;
    uint64_t since_ns;
    uint32_t shots;
    double value;
};

struct ls_capture {
    struct ls_capture_setup setup;
    uint32_t n_cameras;
    bool stepwise, held;
    uint64_t patience_us;
    struct ls_ring *rings[LS_MAX_CAMERAS];
    struct ls_camera_thread *threads[LS_MAX_CAMERAS];
    bool started[LS_MAX_CAMERAS];
    struct ls_merge_stage *merge;
    struct ls_sequencer sequencer;
    sem_t heard;
    struct ls_exposure_offset offsets[LS_MAX_CAMERAS]; /* measured by this run: sigma above 0 */
    struct ls_flashing flashing;                       /* what a live subject has seen */
    struct ls_warm_up warm_up;
    struct ls_pass pass;
    uint8_t *wanted;           /* per plan step */
    uint32_t *first_attempt;   /* per shot, of a resumed take */
    struct ls_kept_shot *kept; /* the same, where brackets wait on disk */
    uint32_t steps_planned, conditions_planned;
    struct ls_camera_stats stats[LS_MAX_CAMERAS]; /* of stopped cameras */
    _Atomic uint32_t lost;
    _Atomic bool abort, blank; /* blank: no work light either */
    bool working;              /* the work light is on */
    struct ls_capture_rate *rate;
};

static inline const struct ls_config_camera *ls_capture_camera(const struct ls_capture *capture,
                                                               uint32_t camera)
{
    return &capture->setup.config->cameras[camera];
}

/* ---- capture_devices.c ---- */

/** Fill in what sequencer and warm-up know of the devices. */
void ls_capture_describe(struct ls_capture *capture);

LS_MUST_CHECK enum ls_err ls_capture_make_rings(struct ls_capture *capture, struct ls_diag *diag);

LS_MUST_CHECK enum ls_err ls_capture_start_cameras(struct ls_capture *capture,
                                                   struct ls_diag *diag);

/** After the warm-up, which leaves every camera's clock and anchor. */
LS_MUST_CHECK enum ls_err ls_capture_start_threads(struct ls_capture *capture,
                                                   struct ls_diag *diag);

/** Threads end, what is bound is merged, cameras stop. Whatever of it was started. */
void ls_capture_wind_down(struct ls_capture *capture);

/* ---- capture_passes.c ---- */

/** Fire everything that is wanted, and what was lost of it again, up to the limit of repairs. */
LS_MUST_CHECK enum ls_err ls_capture_shoot_all(struct ls_capture *capture, struct ls_diag *diag);

/* ---- capture_books.c ---- */

/** The sentence of the stage that failed first; the error that the take ends with. */
LS_MUST_CHECK enum ls_err ls_capture_explain(struct ls_capture *capture, enum ls_err err,
                                             struct ls_diag *diag);

/** Name in the journal what is missing and what was repaired; everything queued is durable then. */
LS_MUST_CHECK enum ls_err ls_capture_close_books(struct ls_capture *capture, enum ls_err err,
                                                 struct ls_diag *diag);

void ls_capture_fill_report(struct ls_capture *capture, struct ls_capture_report *report);

#endif
