/*
 * led_sweep: what the pictures of a take say of single LEDs, of clipping and of ambient light.
 * Layer: daemon. Threads: add from any, each picture once; conclude when no more come. Ownership:
 * configuration and plan are (transfer none) and outlive it.
 *
 * Keys added to take.json:
 *   "checks" { "leds" { "judged" 24, "dead" [ { "light" 3, "channel" "W", "share" 0.0 (of what was
 *     expected) } ], "dim" [ alike ], "unseen" [ alike, share null: no camera sees enough of it to
 *     judge ] } (by core/led_check.h; of an LED that several cameras see, the first of them),
 *   "clipping" [ { "channel", "camera", "condition" (the one with most of it), "share" (of pixels
 * that are saturated even in its shortest exposure) } ], "ambient" [ { "camera", "dn" (in the
 * longest exposure) } ], "warnings" [] (a sentence each: what is wrong and what to do) }, of the
 * last run that photographed anything of it.
 */
#ifndef LS_DAEMON_LED_SWEEP_H
#define LS_DAEMON_LED_SWEEP_H

#include "core/error.h"
#include "core/picture_sums.h"
#include "daemon/config.h"
#include "daemon/findings.h"
#include "daemon/plan.h"

#include <jansson.h>
#include <stdint.h>

/** More clipping than this share of a picture, more ambient light than this share of full scale, is
 * warned of. */
#define LS_CLIPPING_WARNED 0.005
#define LS_AMBIENT_WARNED 0.002

struct ls_led_sweep {
    const struct ls_config *config;
    const struct ls_plan *plan;
    float *level, *saturated; /* [camera * n_conditions + condition]; NAN: no picture came */
};

LS_MUST_CHECK enum ls_err ls_led_sweep_init(struct ls_led_sweep *sweep,
                                            const struct ls_config *config,
                                            const struct ls_plan *plan);
void ls_led_sweep_finish(struct ls_led_sweep *sweep);

/** A lit picture, by its sums. */
void ls_led_sweep_add(struct ls_led_sweep *sweep, uint32_t camera, uint32_t condition,
                      const struct ls_picture_sums *sums);

/** "checks" as above, NULL if no lit picture came. *checks: (transfer full). LS_ERR_NOMEM. */
LS_MUST_CHECK enum ls_err ls_led_sweep_conclude(const struct ls_led_sweep *sweep,
                                                const struct ls_findings *findings, json_t **checks,
                                                struct ls_diag *diag);

#endif
