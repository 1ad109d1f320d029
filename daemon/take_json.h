/*
 * take_json: the document a take carries so that it explains itself.
 * Layer: daemon. Threads: any. Ownership: as stated.
 *
 * Keys (the store adds its own: daemon/store.h):
 *   "software" "lightstaged 0.1.0", "conventions" 1,
 *   "plan" { "text" (as given), "subject", "bracket" width|outermost (bracket.h), "period_us",
 * "pulse_us" [], "conditions" [ { "id", "kind" dark|one|sphere|segment|list, "light" (rig row,
 * one), "lights" [] (segment, list: rig rows), "levels" [] (list: of each of "lights"), "channel"
 * "W", "level" (of weight 1: the nominal duty), "pattern", "part", "parts" (several lights:
 * daemon/plan.h), "exposure" (dark), "watch" true (a dark between lights, not subtracted from
 * anything), "reference" true (a sphere between lights, nothing is promoted by it), "repeats",
 *     "first_step", "steps" } ],
 *   "uncalibrated" [] (ids of the conditions whose pattern and level the calibration has no factor
 *     for; all of several lights where there is no calibration) },
 * "rig" { "name", "lights" { "position_m" [[x,y,z]], "address" [] }, "channels" [ { "name",
 * "kind" } ], "cameras" [ { "name", "vendor", "model", "serial", "width", "height", "pixel_format",
 *       "position_m", "look_at_m", "focal_length_mm", "sensor_mm", "range", "black_dn",
 *       "full_scale_dn", "electrons_per_dn", "read_noise_dn", "exposure_offset_us",
 *       "unverified", "gain", "black_level" (as read back), "exposure" width|timed;
 *       "lens", "aperture", "iso_speed" where the rig file says them;
 *       "exposure_offset_sigma_us" of an offset that was measured } ],
 *     "controller" { "serial", "firmware", "pwm_levels", "pwm_period_us" } },
 *   "exposure_s" [] (as used, shortest first), "reference_exposure_s",
 *   "preflight" { "seconds", "bytes", "energy_j", "peak_current_a",
 *     "led_duty", "dark_noise_share", "warnings" [] } (struct ls_preflight of daemon/engine.h),
 *   "led_sweep" (daemon/led_record.h: what the last sweep before this take found),
 *   "calibration" (core/calibration.h) or null; "token" of the client that started it; once a run
 *   has ended "darks" and "clocks" (daemon/findings.h), "drift" and "checks" (daemon/checks.h).
 */
#ifndef LS_DAEMON_TAKE_JSON_H
#define LS_DAEMON_TAKE_JSON_H

#include "core/error.h"
#include "daemon/config.h"
#include "daemon/plan.h"
#include "drivers/camera.h"
#include "drivers/lights.h"

#include <jansson.h>

struct ls_preflight;

struct ls_take_document {
    const struct ls_config *config;
    const struct ls_plan *plan;
    const char *plan_text;
    const char *token; /* of the client that started it; NULL or "" = none */
    const struct ls_lights_info *lights;
    const struct ls_camera_info *const *cameras; /* config->n_cameras of them */
    double reference_exposure_s;
    const struct ls_preflight *preflight;     /* NULL = none */
    json_t *led_record;                       /* daemon/led_record.h; NULL = none */
    const char *calibration_json;             /* NULL = none */
    const struct ls_calibration *calibration; /* the same, parsed */
};

/** *text: (transfer full), free(). Errors: LS_ERR_INVALID (calibration is no JSON), LS_ERR_NOMEM.
 */
LS_MUST_CHECK enum ls_err ls_take_json_make(const struct ls_take_document *document, char **text,
                                            struct ls_diag *diag);

/** The plan text inside a take.json. *plan_text: (transfer full), free(). LS_ERR_INVALID. */
LS_MUST_CHECK enum ls_err ls_take_json_plan(const char *take_json, char **plan_text,
                                            struct ls_diag *diag);

/** Exposure offsets of the cameras that were to be measured, as this take.json has them, into
 * @config. LS_ERR_INVALID. */
LS_MUST_CHECK enum ls_err ls_take_json_offsets(const char *take_json, struct ls_config *config,
                                               struct ls_diag *diag);

/** Is the rig in this take.json the one in @document (lights, channels, camera geometry and
 * formats)? LS_ERR_MISMATCH naming the first difference; LS_ERR_INVALID. */
LS_MUST_CHECK enum ls_err ls_take_json_same_rig(const char *take_json,
                                                const struct ls_take_document *document,
                                                struct ls_diag *diag);

/** A take.json to be added to. *doc: (transfer full), an object. LS_ERR_INVALID with the line. */
LS_MUST_CHECK enum ls_err ls_take_json_read(const char *take_json, json_t **doc,
                                            struct ls_diag *diag);

/** @doc (transfer full) as text; @bad: adding to it failed, for want of memory. *text: (transfer
 * full), free(). LS_ERR_NOMEM. */
LS_MUST_CHECK enum ls_err ls_take_json_print(json_t *doc, int bad, char **text,
                                             struct ls_diag *diag);

#endif
