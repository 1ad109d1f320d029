/*
 * plan: the ordered shots of a take, made from a small text file.
 * Layer: daemon. Threads: made on ls-main or a take's own thread, read-only afterwards.
 * Ownership: the plan owns its arrays.
 *
 * A *step* is one trigger pulse: one condition at one exposure, photographed by every camera. A
 * *shot* is one camera's picture of a step: shot id = step * n_cameras + camera. Darks come first,
 * because merging is online; then conditions in order, each with its whole bracket. They are fired
 * in this order, or exposure by exposure where the cameras need that (daemon/bracket.h). After every
 * LS_WATCH_EVERY of these stands a *watch*: a few darks of the longest exposure, stored and
 * compared with the dark of the beginning, which they do not replace. Of more than
 * LS_REFERENCE_SHOTS steps of them there are *references* too: a full sphere of white before the
 * first, after every LS_REFERENCE_SHOTS steps, and at the end, stored and compared with the first,
 * so that a drift of the light shows (daemon/checks.h); no condition is corrected by them.
 *
 * Single lights of an entry are shown in an order in which neighbours follow each other
 * (core/smooth_order.h), each channel back the way that the one before it came, so that a live
 * subject sees light wander and not jump. The order follows from the plan's text and the rig, and
 * take.json holds it.
 */
#ifndef LS_DAEMON_PLAN_H
#define LS_DAEMON_PLAN_H

#include "core/calibration.h"
#include "core/error.h"
#include "daemon/config.h"
#include "drivers/lights.h"

#include <stdbool.h>
#include <stdint.h>

enum { LS_MAX_EXPOSURES = 8, LS_WATCH_EVERY = 50, LS_REFERENCE_SHOTS = 100 };

enum ls_subject { LS_SUBJECT_STILL, LS_SUBJECT_LIVE };

/** How exposures are made: daemon/bracket.h. */
enum ls_bracket { LS_BRACKET_WIDTH, LS_BRACKET_OUTERMOST };

/**
 * A condition of the plan: what the LEDs do, and what it is called on disk.
 *
 * Pictures of several lights belong to a *pattern*, the name their calibrated factor is kept under
 * (core/calibration.h), and are part `part` of its `parts`:
 *   "sphere"         all lights
 *   "lights-12"      12 lights that the plan names
 *   "segments-14"    14 groups of neighbours; part is the group
 *   "headlight"      the three lights nearest the first camera, or three named; "headlight-5": five
 *   "multiplex"      a row of the S-matrix of core/bases.h, part the row, light i column i
 *   "harmonic-07"    (1 + f) / 2 of harmonic 7, part its number, parts how many there are; or in
 *                    pairs "harmonic-07p", "harmonic-07n": max(f, 0), max(-f, 0); f = Y / peak over
 *                    the lights (core/bases.h)
 *   "gradient-x"     (1 + omega.x) / 2; y, z; "gradient-full": all lights at that level
 *   "custom"         item `part` of the plan's own list (daemon/plan_custom.h)
 * Lights whose level rounds to 0 are left out.
 */
struct ls_plan_condition {
    char id[32];                /* "dark-0", "W-0137", "sphere-R", "watch-0"; the file's stem */
    struct ls_condition lights; /* leds point into the plan */
    char pattern[24];           /* of the list below; "" of darks and single lights */
    uint16_t part, parts;       /* 0 and 1 of a pattern that is one picture */
    uint16_t level;             /* of weight 1; level / 65535 is the nominal duty */
    bool fits_current;          /* the plan left it to the controller: ls_plan_fit_current */
    bool dark;                  /* a dark of exposure `exposure`, mean of `repeats` frames */
    bool watch;                 /* a dark that only watches for drift: nothing is merged with it */
    bool reference;   /* a sphere that only watches for drift: nothing is promoted by it */
    uint8_t exposure; /* dark only */
    uint16_t repeats; /* frames per exposure: 1, or K for darks */
    int32_t light;    /* of ONE, else -1 */
    int32_t channel;  /* of all LEDs; -1 of darks */
    uint32_t first_step, n_steps;
};

struct ls_plan_step {
    uint32_t condition;
    uint16_t repeat;
    uint8_t exposure;
};

struct ls_plan {
    char name[65];
    enum ls_subject subject;
    bool allow_flashing, keep_raw;
    enum ls_bracket bracket; /* settled by what the cameras can do: ls_bracket_choose */
    bool sweep;         /* only what the checks look at: daemon/plan_sweep.h */
    uint32_t period_us; /* pulse start to pulse start, at least */
    uint32_t settle_us;
    uint32_t n_exposures; /* shortest first */
    uint32_t pulse_us[LS_MAX_EXPOSURES];
    uint32_t n_conditions, n_steps;
    struct ls_plan_condition *conditions;
    struct ls_plan_step *steps;
    struct ls_led *leds; /* storage of the conditions' leds */
};

/**
 * Parse a plan (libconfig text, keys in lightstage-plan(5); `subject` is mandatory) against the rig.
 * Errors: LS_ERR_INVALID with line and what was expected; LS_ERR_LIMIT. (transfer full).
 */
LS_MUST_CHECK enum ls_err ls_plan_parse(const char *text, const struct ls_config *config,
                                        struct ls_plan **out, struct ls_diag *diag);

/**
 * Levels that the plan left to the controller become the highest, up to full, at which no picture
 * of theirs draws more than its current: all alike, as the pictures of a pattern must be. Before
 * anything else looks at levels.
 */
void ls_plan_fit_current(struct ls_plan *plan, const struct ls_lights_info *lights);

/** The calibrated factor of a condition's pattern at its nominal duty; 1 for darks and single
 * lights, which need none; 0 where none was calibrated. */
double ls_plan_factor(const struct ls_plan_condition *condition, const struct ls_config *config,
                      const struct ls_calibration *calibration);

/** NULL is allowed. */
void ls_plan_destroy(struct ls_plan *plan);

#endif
