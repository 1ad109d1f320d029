/*
 * preflight: everything that can be known about a plan before the first light fires.
 * Layer: daemon. Threads: any. Ownership: nothing is kept.
 */
#ifndef LS_DAEMON_PREFLIGHT_H
#define LS_DAEMON_PREFLIGHT_H

#include "core/calibration.h"
#include "core/error.h"
#include "daemon/engine.h"
#include "daemon/plan.h"

#include <jansson.h>

/** What the devices said, and what is calibrated. */
struct ls_preflight_input {
    const struct ls_config *config;
    const struct ls_plan *plan;
    const struct ls_lights_info *lights;
    const struct ls_lights_status *status;       /* of now; NULL = not asked */
    const struct ls_camera_info *const *cameras; /* config->n_cameras, applied */
    const struct ls_calibration *calibration;    /* NULL = none */
    const json_t *led_record;                    /* daemon/led_record.h; NULL = none */
    uint64_t disk_free_bytes;
    const uint8_t *condition_done; /* per condition: published already (resume); NULL = none */
};

/**
 * Check a plan and say what it costs. Refusals, each naming the limit and by how much:
 *   LS_ERR_LIMIT    duty, current, period, pulse or memory of the controller (ls_lights_test);
 *                   its longest hold, of a camera triggered by software
 *   LS_ERR_INVALID  rig and controller disagree, or the bracket leaves gaps
 *   LS_ERR_REFUSED  interlock open, E-stop pressed or the dome hot; a live subject would see
 * flashes (daemon/flashing.h) and allow_flashing is not set LS_ERR_FULL     the take would not fit
 * the disk Warnings do not refuse: uncalibrated patterns, settings a camera cannot prove, few
 * darks; LEDs that the last sweep found dead or dim; and what multiplexing gains and loses.
 */
LS_MUST_CHECK enum ls_err ls_preflight_check(const struct ls_preflight_input *input,
                                             struct ls_preflight *out, struct ls_diag *diag);

/** Bytes the take will write at most, journal and raw frames included. */
uint64_t ls_preflight_bytes(const struct ls_preflight_input *input);

#endif
