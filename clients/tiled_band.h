/*
 * tiled_band: tiles of a fetch, put together to the rows that they are cut from.
 * Layer: clients. Threads: the main thread. Ownership: owns the rows; see finish.
 */
#ifndef LS_CLIENTS_TILED_BAND_H
#define LS_CLIENTS_TILED_BAND_H

#include "clients/lightstage.h"
#include "core/demosaic.h"
#include "core/error.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct ls_tiled_band {
    struct ls_demosaic_region region; /* asked for, of full-size pixels; the caller's to fill */
    uint32_t level;
    uint8_t *rows; /* [height][width][components] of the region, in the level's pixels */
    size_t room;
};

/**
 * Put @tile in its place; what stays away is 0. *there: @band is to be used, until the next call:
 * it comes with the first tile of a picture, with its report and without rows, and with the last
 * one, with all of them (both: a picture of one tile). Errors: LS_ERR_INVALID (no tile of the
 * region), LS_ERR_LIMIT, LS_ERR_NOMEM.
 */
LS_MUST_CHECK enum ls_err ls_tiled_band_take(struct ls_tiled_band *t,
                                             const struct lightstage_tile *tile, bool *there,
                                             struct lightstage_band *band, struct ls_diag *diag);

/** Zeroed is allowed. */
void ls_tiled_band_finish(struct ls_tiled_band *t);

#endif
