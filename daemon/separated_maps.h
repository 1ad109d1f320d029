/*
 * separated_maps: what the diffuse part and metals are promoted by, over a whole picture.
 * Layer: daemon. Threads: any. Ownership: all arrays are the caller's.
 *
 * The stable ratio of core/separate.h's remainder: what the photographed sphere shows beyond white
 * highlights, over the rest of the field. In bands of rows; the result does not depend on them.
 */
#ifndef LS_DAEMON_SEPARATED_MAPS_H
#define LS_DAEMON_SEPARATED_MAPS_H

#include "daemon/job.h"
#include "daemon/separation.h"

#include <stdint.h>

/** maps[q] of spectrum spectra[q], [height][width][n_channels], all in one pass over the pictures.
 * No more bands once @asker (or NULL) is cancelled: LS_ERR_ABORTED. Other errors: those of
 * core/separated.h and core/promote.h, LS_ERR_NOMEM. */
LS_MUST_CHECK enum ls_err ls_separated_maps_make(const struct ls_field_source *source,
                                                 const struct ls_separation *separation,
                                                 const uint32_t *spectra, uint32_t n,
                                                 const struct ls_job *asker, float **maps,
                                                 struct ls_diag *diag);

#endif
