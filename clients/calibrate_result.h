/*
 * calibrate_result: measurements and what they cannot say, put together as a calibration.
 * Layer: clients. Threads: the main thread. Ownership: as stated.
 */
#ifndef LS_CLIENTS_CALIBRATE_RESULT_H
#define LS_CLIENTS_CALIBRATE_RESULT_H

#include "clients/calibrate_grey.h"
#include "clients/calibrate_probe.h"
#include "core/calibration.h"

/** What was measured. Chrome and gloss may be NULL. */
struct ls_calibrate_measured {
    const struct ls_calibrate_take *grey_take, *chrome_take, *gloss_take;
    const struct ls_grey *grey;
    const struct ls_chrome *chrome;
    const struct ls_gloss *gloss;
};

enum { LS_CALIBRATE_REMARKS = 32 };

/** Sentences about what is not as it should be. */
struct ls_calibrate_remarks {
    uint32_t n;
    char text[LS_CALIBRATE_REMARKS][240];
};

/**
 * A calibration of what was measured; camera constants, spectra, chart and M are those of @base
 * (NULL: the constants of the take's rig, and nothing else), which is left as it was. Residuals and
 * provenance are filled in. Errors: LS_ERR_MISMATCH (the base is of another rig or camera),
 * LS_ERR_NOMEM, those of core. *out: (transfer full).
 */
LS_MUST_CHECK enum ls_err ls_calibrate_result(const struct ls_calibrate_measured *measured,
                                              const struct ls_calibration *base,
                                              struct ls_calibration **out,
                                              struct ls_calibrate_remarks *remarks,
                                              struct ls_diag *diag);

#endif
