/*
 * warm_up: a few discarded dark pulses, one at a time, that set the clocks before a take.
 * Layer: daemon. Threads: the capture's own, before ls-seq and ls-cam run. Ownership: everything is
 * (transfer none).
 *
 * The first triggered frames of real cameras are often bad, so they are never used. Each pulse is
 * granted alone and each camera's frame awaited, at intervals no two of which are equal, so that a
 * frame taken for its neighbour's cannot give a consistent clock. From the pairs (camera time,
 * pulse time) the camera's clock is fitted to the controller's; where the camera can latch its
 * clock, latches and the controller's status reads, both fitted to host time, must say the same.
 * Pulses whose frames are not on one line, within 20 us, are fired again. The last frame becomes the
 * anchor that binding counts from.
 */
#ifndef LS_DAEMON_WARM_UP_H
#define LS_DAEMON_WARM_UP_H

#include "core/error.h"
#include "daemon/clock.h"
#include "daemon/ring.h"
#include "daemon/sequencer.h"
#include "drivers/camera.h"
#include "drivers/lights.h"

#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>

struct ls_warm_up_camera {
    const char *name;
    struct ls_camera *camera;
    struct ls_ring *ring;
    bool by_time, software;
    /* results */
    struct ls_clock clock;      /* camera -> controller, ns */
    struct ls_clock host_clock; /* camera -> host, ns; no pairs without latch */
    struct ls_camera_frame anchor;
};

struct ls_warm_up {
    struct ls_lights *lights;
    uint32_t n_cameras;
    struct ls_warm_up_camera cameras[LS_MAX_CAMERAS];
    uint32_t pulse_us, period_us, settle_us;
    uint64_t patience_us; /* for a frame, after its pulse */
    const _Atomic bool *abort;
    struct ls_clock controller; /* controller -> host, ns */
};

/**
 * Run it; cameras are started. Errors: LS_ERR_TIMEOUT (a camera answers no pulse: the sentence
 * names it), LS_ERR_MISMATCH (its clock makes no sense), LS_ERR_ABORTED, those of the devices. LEDs
 * are dark throughout.
 */
LS_MUST_CHECK enum ls_err ls_warm_up_run(struct ls_warm_up *warm_up, struct ls_diag *diag);

#endif
