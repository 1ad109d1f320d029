/*
 * ratio_maps: the stable ratios F/V of a whole picture, for several spectra in one pass.
 * Layer: daemon. Threads: any. Ownership: the maps made are the caller's, free().
 *
 * LeGendre, Yu and Debevec, Eq. 1, as core/promote.h does it. Works in bands of rows, so that the
 * memory beside the maps themselves stays near 600 rows of every spectrum; the result does not
 * depend on the bands.
 */
#ifndef LS_DAEMON_RATIO_MAPS_H
#define LS_DAEMON_RATIO_MAPS_H

#include "core/error.h"
#include "core/field.h"

#include <stdint.h>

/**
 * maps[s], for each s of @spectra, becomes [height][width][n_channels]; an older map is kept and
 * its spectrum left out. Errors: LS_ERR_NOMEM, those of core/promote.h; maps made until then stay
 * NULL.
 */
LS_MUST_CHECK enum ls_err ls_ratio_maps_make(const struct ls_field *field, const uint32_t *spectra,
                                             uint32_t n, float **maps, struct ls_diag *diag);

#endif
