/*
 * tilesum: what the journal says of a picture's decoded tiles: checksum, maximum, invalid count.
 * Layer: daemon. Threads: any. Ownership: the ls_published owns the arrays made here.
 */
#ifndef LS_DAEMON_TILESUM_H
#define LS_DAEMON_TILESUM_H

#include "core/exr.h"
#include "daemon/journal.h"

/**
 * Fill width, height, is_float, n_tiles, tile_crc, tile_max, tile_invalid and validity_crc of
 * @published from @mosaic; the rest is left alone. Error: LS_ERR_NOMEM.
 */
LS_MUST_CHECK enum ls_err ls_tilesum(const struct ls_exr_mosaic *mosaic,
                                     struct ls_published *published);

#endif
