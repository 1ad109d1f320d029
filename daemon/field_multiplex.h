/*
 * field_multiplex: a take's pictures of many lights at a time that stand for single lights.
 * Layer: daemon. Threads: one, while the source is opened. Ownership: the source's.
 *
 * The factor of the pattern "multiplex" holds for a picture of as many lights as the rows have on
 * average, and duty / q of it is known: a light's duty is q, a whole number of PWM parts. The rest,
 * the supply's sag, is taken to grow with the lights lit, which no supply fails to do in first
 * order: of row j, with n_j lights lit,
 *     f_j = duty / q (1 + (f q / duty - 1) (n_j - 1) / (mean n - 1)).
 * With 346 lights rows differ by one light and f_j by 5e-4; it matters to the spare column only,
 * whose rows are those of fewer lights. With few lights and many spare columns it matters to all.
 */
#ifndef LS_DAEMON_FIELD_MULTIPLEX_H
#define LS_DAEMON_FIELD_MULTIPLEX_H

#include "daemon/field_source.h"

/** Order, duty and scales of a channel whose lights are to be had from multiplexed pictures: those
 * of the first duty in the plan. order 0: it was planned light by light, or not at all.
 * LS_ERR_INVALID: take.json has other rows than those of the matrix; LS_ERR_NOMEM. */
LS_MUST_CHECK enum ls_err ls_field_multiplex_find(const struct ls_field_source *source,
                                                  uint32_t channel, struct ls_light_group *out,
                                                  struct ls_diag *diag);

/** Is a condition one of the rows of @group? */
bool ls_field_multiplex_belongs(const struct ls_light_group *group,
                                const struct ls_condition_fact *fact);

/**
 * Look at the spare column of every channel whose rows are all there, on up to four tiles of the
 * picture: once, when the take is opened. A tenth of what correcting the sag between rows changes
 * is allowed for, beside the noise. Errors: LS_ERR_NOMEM. An alarm is no error: it is told with
 * whatever is served.
 */
LS_MUST_CHECK enum ls_err ls_field_multiplex_check(struct ls_field_source *source,
                                                   struct ls_diag *diag);

#endif
