/*
 * dome: the controller contract over a link: identify, load, arm, grant, poll, blank, and what may
 * be repeated after a lost link.
 * Layer: drivers. Threads: one at a time, as lights.h, which documents each function: the names
 * and errors are its own, the program has passed ls_lights_test.
 */
#ifndef LS_DRIVERS_DOME_H
#define LS_DRIVERS_DOME_H

#include "drivers/lights.h"
#include "drivers/link.h"

struct ls_dome;

/** @link: (transfer full), also on error. */
LS_MUST_CHECK enum ls_err ls_dome_open(struct ls_link *link, struct ls_dome **out,
                                       struct ls_diag *diag);
const struct ls_lights_info *ls_dome_info(const struct ls_dome *dome);
LS_MUST_CHECK enum ls_err ls_dome_load(struct ls_dome *dome, const struct ls_program *program,
                                       const _Atomic bool *stop, struct ls_diag *diag);
LS_MUST_CHECK enum ls_err ls_dome_arm(struct ls_dome *dome, struct ls_diag *diag);
LS_MUST_CHECK enum ls_err ls_dome_grant(struct ls_dome *dome, uint32_t n_steps,
                                        struct ls_diag *diag);
LS_MUST_CHECK enum ls_err ls_dome_poll(struct ls_dome *dome, struct ls_lights_status *status,
                                       struct ls_step_event *events, size_t max_events,
                                       size_t *n_events, struct ls_diag *diag);
LS_MUST_CHECK enum ls_err ls_dome_blank(struct ls_dome *dome, struct ls_diag *diag);
LS_MUST_CHECK enum ls_err ls_dome_set_work(struct ls_dome *dome, uint16_t channel, uint16_t level,
                                           struct ls_diag *diag);
LS_MUST_CHECK enum ls_err ls_dome_work(struct ls_dome *dome, struct ls_diag *diag);
LS_MUST_CHECK enum ls_err ls_dome_steady(struct ls_dome *dome, struct ls_diag *diag);
void ls_dome_close(struct ls_dome *dome);

#endif
