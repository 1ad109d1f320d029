/*
 * capture: execute a plan on the devices: every shot fired, bound, merged and stored, or named.
 * Layer: daemon. Threads: ls_capture_run blocks its caller and runs ls-seq, ls-cam-N, ls-merge-N
 * inside; ls_capture_abort and ls_capture_progress from any thread. Ownership: everything passed
 * in ls_capture_setup is (transfer none) and outlives the call.
 */
#ifndef LS_DAEMON_CAPTURE_H
#define LS_DAEMON_CAPTURE_H

#include "core/error.h"
#include "daemon/checks.h"
#include "daemon/config.h"
#include "daemon/plan.h"
#include "drivers/camera.h"
#include "drivers/lights.h"

#include <stdbool.h>
#include <stdint.h>

struct ls_findings;
struct ls_pixel_list;
struct ls_metrics;
struct ls_preview;
struct ls_store;

struct ls_capture_setup {
    const struct ls_config *config;
    const struct ls_plan *plan;
    struct ls_lights *lights;
    struct ls_camera *const *cameras; /* config->n_cameras of them, applied, not started */
    struct ls_store *store;
    struct ls_metrics *metrics;    /* counted into, beside what is in it already */
    struct ls_preview *preview;    /* offered the frames of lights; or NULL */
    struct ls_checks *checks;      /* told of every merged picture; or NULL */
    double reference_exposure_s;   /* stored value = E x this */
    const uint8_t *condition_done; /* per condition: 1 = published already (resume), or NULL */
    const float *const *darks;     /* [camera * n_exposures + exposure]: the published mean darks
                                      in DN of a resumed take, NULL where not done; or NULL */
    const struct ls_pixel_list *defects; /* per camera: found in these; or NULL */
};

/** Live numbers, readable while a take runs. */
struct ls_capture_progress {
    uint32_t steps_planned, steps_bound; /* steps with a frame of every camera */
    uint32_t conditions_planned, conditions_stored;
    uint32_t shots_lost;        /* fired without a usable frame, so far; repaired ones included */
    uint32_t shots_repaired;    /* of those, shot again and stored */
    double frames_per_second;   /* over the last second, all cameras */
    bool cooling;               /* paused: the dome is hot */
    struct ls_drift_seen drift; /* the largest that references have shown */
};

struct ls_capture_report {
    struct ls_capture_progress final;
    double seconds;                          /* first to last pulse */
    double frames_per_second;                /* mean over that */
    double residual_max_us, residual_rms_us; /* of binding by time */
    uint32_t missing_conditions;             /* after all repairs; each is named in the journal */
    char repaired[256];                      /* e.g. "W-0012 (1 shot), sphere-R (2 shots)" or "" */
};

struct ls_capture;

LS_MUST_CHECK enum ls_err ls_capture_create(const struct ls_capture_setup *setup,
                                            struct ls_capture **out, struct ls_diag *diag);

/**
 * Run to the end: complete, aborted, or failed. Nothing is fired if nothing is missing. On return,
 * whatever happened, the configured work light is on, else LEDs are dark. Every stored condition is
 * durable on return. Errors:
 * LS_ERR_ABORTED; LS_ERR_GONE / LS_ERR_TIMEOUT (device lost; the take can be resumed);
 * LS_ERR_REFUSED (interlock, fault); LS_ERR_FULL and LS_ERR_OS (store). LS_OK with
 * report.missing_conditions > 0: shots that could not be repaired.
 */
LS_MUST_CHECK enum ls_err ls_capture_run(struct ls_capture *capture,
                                         struct ls_capture_report *report, struct ls_diag *diag);

/** Ask a running capture to stop; LEDs go dark at once. Any thread, async-signal-safe. */
void ls_capture_abort(struct ls_capture *capture);

/** The same, and no work light comes on. */
void ls_capture_blank(struct ls_capture *capture);

/** Any thread. */
void ls_capture_progress(const struct ls_capture *capture, struct ls_capture_progress *out);

/** What the run learned of darks and clocks. After ls_capture_run. */
void ls_capture_findings(const struct ls_capture *capture, struct ls_findings *out);

/** Not while running. NULL is allowed. */
void ls_capture_destroy(struct ls_capture *capture);

#endif
