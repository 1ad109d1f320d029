/*
 * findings: what a run of a take learned of its devices, as take.json keeps it.
 * Layer: daemon. Threads: any. Ownership: plain values; text as stated.
 *
 * Keys:
 *   "darks" [ { "camera" 0, "exposure" 0, "mean_dn" (over pixels and frames), "read_noise_dn",
 *     "clipped" (share of samples at DN 0 or at the format's largest), "defects" (pixels found
 *     defective in this exposure) } ]; noise and clipped are null where the frames themselves are
 *     gone: a dark of an earlier run that could not write its findings.
 *   "clocks" [ { "clock" "controller"|"cam<k>", "tick_ns" 1000|1, "ticks", "offset_ns",
 * "drift_ppm", "residual_rms_us", "residual_max_us", "pairs" } ], of every run, oldest first: the
 * last fit to host CLOCK_MONOTONIC_RAW, host_ns(n) = ticks tick_ns + offset_ns + (n - ticks)
 * tick_ns (1 + drift_ppm 1e-6). The controller's residuals are those of the status reads fitted,
 * waiting on the link included (rms weighted as fitted); a camera is fitted to the controller and
 * its residuals are those of all its bound frames. A camera that gives no timestamps has no entry.
 */
#ifndef LS_DAEMON_FINDINGS_H
#define LS_DAEMON_FINDINGS_H

#include "core/error.h"
#include "core/exposure_offset.h"
#include "daemon/camera_thread.h"
#include "daemon/clock.h"
#include "daemon/config.h"
#include "daemon/dark_stage.h"

#include <stdbool.h>
#include <stdint.h>

struct ls_dark_finding {
    bool known;
    double mean_dn, read_noise_dn, clipped; /* the last two NAN if adopted */
    uint32_t n_defects;
};

struct ls_clock_finding {
    uint32_t pairs; /* 0 = no such clock */
    double tick_ns;
    uint64_t ticks;
    double host_ns; /* at `ticks` */
    double drift_ppm, residual_rms_us, residual_max_us;
};

struct ls_findings {
    uint32_t n_cameras, n_exposures;
    struct ls_dark_finding darks[LS_MAX_CAMERAS][LS_MAX_EXPOSURES];
    struct ls_clock_finding controller, cameras[LS_MAX_CAMERAS];
    struct ls_exposure_offset offsets[LS_MAX_CAMERAS]; /* sigma_us 0 = not measured */
};

/** @dark may be NULL: not known. */
struct ls_dark_finding ls_find_dark(const struct ls_dark_exposure *dark);

/** @controller: ticks of 1 us against the host. */
struct ls_clock_finding ls_find_controller(const struct ls_clock *controller);

/** @camera: against the controller in ns. */
struct ls_clock_finding ls_find_camera(const struct ls_clock *camera,
                                       const struct ls_clock *controller,
                                       const struct ls_camera_residuals *residuals);

/** @take_json with the findings in it: a dark replaces the entry of its camera and exposure unless
 * it knows less, clocks are added to those of earlier runs, measured exposure offsets stand where
 * the rig's cameras have theirs. *text: (transfer full), free().
 * LS_ERR_INVALID (no JSON object), LS_ERR_NOMEM. */
LS_MUST_CHECK enum ls_err ls_findings_put(const struct ls_findings *findings, const char *take_json,
                                          char **text, struct ls_diag *diag);

#endif
