/*
 * gains_system: the measurements behind ls_gains_solve in logarithms, and the levels of cameras and
 * colours. Private to core/gains*.c.
 * Layer: core. Threads: a system belongs to one. Ownership: its arrays are ls_gains_solve's.
 */
#ifndef LS_CORE_GAINS_SYSTEM_H
#define LS_CORE_GAINS_SYSTEM_H

#include "core/calibration.h"
#include "core/gains.h"

enum { LS_GAINS_LEVELS = LS_CALIBRATION_MAX_CAMERAS * 3 };

/** The measurements of every light; j = camera * n_colours + colour. */
struct ls_gains_system {
    const struct ls_gains_input *in;
    uint32_t n, m;   /* lights, cameras x colours */
    double *y, *var; /* [light * m + j]; var = 0: not measured */
    double *w;       /* weights in the common fit */
    double *x;       /* [light] ln g */
    double *sigma;   /* [light] of ln g */
    uint8_t *flags;
    double level[LS_GAINS_LEVELS], level_var[LS_GAINS_LEVELS];
    double chi2;
    uint32_t n_taken; /* factors of colours that were taken out of y */
    int dof;
};

/** Fill y, var, w and the flag of dead lights. LS_ERR_INVALID: nothing is lit; LS_ERR_NOMEM. */
LS_MUST_CHECK enum ls_err ls_gains_gather(struct ls_gains_system *system, struct ls_diag *diag);

/** Solve level[], the first one 0, those never measured NaN. LS_ERR_INVALID: nothing is measured
 * well, or cameras share no light; LS_ERR_NOMEM. */
LS_MUST_CHECK enum ls_err ls_gains_levels(struct ls_gains_system *system, struct ls_diag *diag);

/** Sum of a light's weights. */
double ls_gains_row_weight(const struct ls_gains_system *system, uint32_t light);

#endif
