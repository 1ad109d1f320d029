/*
 * bracket: how a plan's exposures are made, and the order in which its steps are fired.
 * Layer: daemon. Threads: choose before anybody else looks at the plan; the rest any. Ownership:
 * nothing is kept.
 *
 * width      Every camera exposes as long as the pulse lasts: condition by condition, each with its
 *            whole bracket.
 * outermost  A camera's exposure is a register, which must not be written while frames are under
 *            way: everything at the first exposure, then everything at the second, ... Between
 *            these rounds the register is written and read back, and a dark pulse is fired whose
 *            frame is discarded. The frames of a bracket are then whole rounds apart, so each is
 *            kept in the take's folder (kept.h) until the last is there: the plan keeps its raw
 *            frames.
 *
 * A *round* is a set of steps fired in the plan's order, repairs included, before the next begins:
 * the darks, then the lights; outermost: of each exposure the darks, then of each the lights. What
 * stands between lights (watches, references) belongs to these.
 */
#ifndef LS_DAEMON_BRACKET_H
#define LS_DAEMON_BRACKET_H

#include "daemon/plan.h"
#include "drivers/camera.h"

/** "width", "outermost". RT-safe. */
const char *ls_bracket_name(enum ls_bracket bracket);

/** Settle @plan->bracket by what the cameras, applied, can do; and keep_raw where it needs that. */
void ls_bracket_choose(struct ls_plan *plan, const struct ls_config *config);

/**
 * May the merge of camera @camera join these exposures, with @offset_us added to each? Asked before
 * a take, and again when the offset was measured. LS_ERR_INVALID: no exposure is left, or the step
 * from one to the next leaves a gap in the camera's range (core/merge.h).
 */
LS_MUST_CHECK enum ls_err ls_bracket_check(const struct ls_plan *plan,
                                           const struct ls_config *config, uint32_t camera,
                                           double offset_us, struct ls_diag *diag);

uint32_t ls_bracket_rounds(const struct ls_plan *plan);

/** Rounds before this one have darks only. */
uint32_t ls_bracket_first_of_lights(const struct ls_plan *plan);

bool ls_bracket_in_round(const struct ls_plan *plan, uint32_t round, uint32_t step);

/** The exposure that all steps of a round have; -1: any. */
int ls_bracket_exposure(const struct ls_plan *plan, uint32_t round);

/** Dark pulses between rounds. */
uint32_t ls_bracket_settling(const struct ls_plan *plan);

/** Do frames of this condition wait for each other on disk? */
bool ls_bracket_keeps(const struct ls_plan *plan, const struct ls_plan_condition *condition);

#endif
