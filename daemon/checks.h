/*
 * checks: what the pictures of a take say about the rig while it is taken.
 * Layer: daemon. Threads: any; locked inside. Ownership: configuration and plan are (transfer none)
 * and outlive it.
 *
 * Drift. Every reference is compared with the first of its channel that came, camera by camera and
 * colour by colour (core/picture_sums.h). More than LS_DRIFT_ALARM, and more than five standard
 * errors, is an alarm. Nothing is corrected: a drift of the light is not the same for all lights
 * and channels, and the calibration holds for lights as they were measured.
 *
 * LEDs, clipping and ambient light: daemon/led_sweep.h.
 *
 * Keys added to take.json:
 *   "drift" [ { "reference" "reference-W-03", "camera" 0, "change" [0.0152, ...] (relative, a
 * number per colour of the filter, R G B or mono; null where there was nothing to compare), "error"
 * [] (standard, alike), "alarm" true } ], of every run, in the order they came;
 *   "checks" (daemon/led_sweep.h).
 */
#ifndef LS_DAEMON_CHECKS_H
#define LS_DAEMON_CHECKS_H

#include "core/error.h"
#include "core/picture_sums.h"
#include "daemon/config.h"
#include "daemon/led_sweep.h"
#include "daemon/plan.h"

#include <stdbool.h>
#include <stdint.h>

#define LS_DRIFT_ALARM 0.01

struct ls_checks;

/** The largest drift so far. */
struct ls_drift_seen {
    bool known, alarm;
    struct ls_light_drift drift;
    char text[320]; /* what, where; with alarm also what to do */
};

/** NULL: out of memory. */
struct ls_checks *ls_checks_create(const struct ls_config *config, const struct ls_plan *plan);

/** NULL is allowed. */
void ls_checks_destroy(struct ls_checks *checks);

/**
 * A picture that was merged. @alarm: what the journal should say, "" for nothing. Errors:
 * LS_ERR_NOMEM, LS_ERR_INVALID.
 */
LS_MUST_CHECK enum ls_err ls_checks_picture(struct ls_checks *checks, uint32_t camera,
                                            uint32_t condition,
                                            const struct ls_picture_view *picture,
                                            struct ls_diag *alarm, struct ls_diag *diag);

/** A picture of an earlier run of the take: what comes is compared with it. */
LS_MUST_CHECK enum ls_err ls_checks_adopt(struct ls_checks *checks, uint32_t camera,
                                          uint32_t condition, const struct ls_picture_view *picture,
                                          struct ls_diag *diag);

void ls_checks_drift(struct ls_checks *checks, struct ls_drift_seen *out);

/** After the run. *conclusion: its "checks", NULL if there is nothing to judge; (transfer full). */
LS_MUST_CHECK enum ls_err ls_checks_conclude(struct ls_checks *checks,
                                             const struct ls_findings *findings,
                                             json_t **conclusion, struct ls_diag *diag);

/** @take_json with what was found in it. @conclusion may be NULL. *text: (transfer full), free().
 * LS_ERR_INVALID (no JSON object), LS_ERR_NOMEM. */
LS_MUST_CHECK enum ls_err ls_checks_put(struct ls_checks *checks, json_t *conclusion,
                                        const char *take_json, char **text, struct ls_diag *diag);

#endif
