/*
 * calibrate_residuals: how well a calibration's measurements agree with each other, and remarks
 * where that is not well enough.
 * Layer: clients. Threads: the main thread. Ownership: the caller's.
 */
#ifndef LS_CLIENTS_CALIBRATE_RESIDUALS_H
#define LS_CLIENTS_CALIBRATE_RESIDUALS_H

#include "clients/calibrate_result.h"

/** Add a sentence; beyond LS_CALIBRATE_REMARKS it is dropped. */
void ls_calibrate_remark(struct ls_calibrate_remarks *remarks, const char *fmt, ...)
    LS_PRINTF(2, 3);

/** The residuals of @calibration, filled from @measured already. Errors: those of
 * ls_calibration_put_residual. */
LS_MUST_CHECK enum ls_err ls_calibrate_residuals(const struct ls_calibrate_measured *measured,
                                                 struct ls_calibration *calibration,
                                                 struct ls_calibrate_remarks *remarks,
                                                 struct ls_diag *diag);

#endif
