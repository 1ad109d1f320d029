/*
 * framing: a camera free-running under steady light, to point, focus and expose it by.
 * Layer: daemon. Threads: start on ls-main; works on a thread of its own, ls-framing.
 * Ownership: configuration and preview are (transfer none) and outlive it.
 *
 * The camera is triggered by software at most ten times a second and offers its frames to the
 * preview. The light is the controller's steady light (drivers/lights.h): every light of one
 * channel, by its PWM at more than 200 Hz (a slower one is refused), within its limits of duty,
 * current and power. The exposure is rounded up to whole PWM periods, so that no bands appear.
 * Whatever ends it, on return of ls_framing_end the light is out, or the configured work light if
 * that was on before. It is a steady light: if the daemon dies, the controller puts it out.
 */
#ifndef LS_DAEMON_FRAMING_H
#define LS_DAEMON_FRAMING_H

#include "core/error.h"
#include "daemon/config.h"
#include "daemon/errand.h"
#include "daemon/preview.h"

#include <stdbool.h>
#include <stdint.h>

struct ls_framing_wish {
    uint32_t camera;    /* row of the rig */
    double exposure_us; /* [1, 1e6] */
    int32_t channel;    /* of the light; -1: none of ours */
    double level;       /* its duty, (0, 1] */
};

struct ls_framing;

/** Begin; devices are opened on its thread, once the errands put before are done with them, and
 * what they say is told by ls_framing_end. Errors: LS_ERR_INVALID (the wish), LS_ERR_NOMEM,
 * LS_ERR_OS. *out: (transfer full). */
LS_MUST_CHECK enum ls_err ls_framing_start(const struct ls_config *config,
                                           const struct ls_framing_wish *wish,
                                           struct ls_preview *preview, struct ls_errands *errands,
                                           struct ls_framing **out, struct ls_diag *diag);

/** Does it go on? Any thread. */
bool ls_framing_runs(const struct ls_framing *framing);

/** Let it end: light out (@dark: also one that was on before), camera closed. Any thread, does not
 * wait. */
void ls_framing_stop(struct ls_framing *framing, bool dark);

/** Wait until it has ended by itself or been stopped, and free it. Any thread, once. What it
 * ended with before it was told to: those of ls_camera_open, apply and next, of ls_lights_open and
 * work; LS_ERR_LIMIT (PWM too slow, or over a limit of the controller), LS_ERR_REFUSED (the light
 * went out). NULL is allowed. */
enum ls_err ls_framing_end(struct ls_framing *framing, struct ls_diag *diag);

#endif
