/*
 * exposure_fit: what each camera's sensor adds to a trigger pulse, measured with the dome's light.
 * Layer: daemon. Threads: one; blocks for a few seconds. Ownership: everything is (transfer none).
 *
 * For cameras whose exposure is the pulse's width and whose rig file does not say the offset. A
 * full sphere of the plan's first channel is shown at levels and widths a factor of two or more
 * apart. The shortest of them under which enough pixels read 0.3 to 0.8 of full scale tells most:
 * those pixels' means are taken at that level and width, half and a quarter of it, sixteen times
 * each with a dark beside it, and core/exposure_offset.h fits the line. Pulses are fired one at a
 * time. LEDs are dark on return.
 */
#ifndef LS_DAEMON_EXPOSURE_FIT_H
#define LS_DAEMON_EXPOSURE_FIT_H

#include "core/error.h"
#include "core/exposure_offset.h"
#include "daemon/plan.h"
#include "drivers/camera.h"
#include "drivers/lights.h"

#include <stdbool.h>

/** Has camera @camera an offset that is still to be measured? */
bool ls_exposure_fit_wanted(const struct ls_config *config, uint32_t camera);

/** Is there one among all? */
bool ls_exposure_fit_needed(const struct ls_config *config);

/** What is measured with. */
struct ls_exposure_fit {
    const struct ls_config *config;
    const struct ls_plan *plan;
    struct ls_lights *lights;
    struct ls_camera *const *cameras; /* applied, not started */
    const _Atomic bool *abort;
};

/**
 * Measure; @out: of every camera, untouched where not wanted. Errors: LS_ERR_ABORTED, LS_ERR_LIMIT
 * (too dim or too noisy to tell, to a thousandth of the shortest exposure or 0.5 us; what the
 * controller does not bear), LS_ERR_REFUSED (a latched fault), LS_ERR_TIMEOUT, those of the
 * devices.
 */
LS_MUST_CHECK enum ls_err ls_exposure_fit_run(const struct ls_exposure_fit *with,
                                              struct ls_exposure_offset *out, struct ls_diag *diag);

#endif
