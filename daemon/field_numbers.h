/*
 * field_numbers: gains, solid angles, factors and noise of a take's field.
 * Layer: daemon. Threads: one, while the source is opened. Ownership: the source's.
 */
#ifndef LS_DAEMON_FIELD_NUMBERS_H
#define LS_DAEMON_FIELD_NUMBERS_H

#include "daemon/field_source.h"

/** Fill every number of the field, once its pictures are known. LS_ERR_INVALID: the take's
 * calibration does not fit its rig or is no calibration of a field; LS_ERR_NOMEM. */
LS_MUST_CHECK enum ls_err ls_field_numbers_fill(struct ls_field_source *source,
                                                struct ls_diag *diag);

void ls_field_numbers_free(struct ls_field_source *source);

#endif
