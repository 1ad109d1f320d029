/*
 * picture_region: the rectangle of pixels a request asks for.
 * Layer: daemon. Threads: any. Ownership: none.
 */
#ifndef LS_DAEMON_PICTURE_REGION_H
#define LS_DAEMON_PICTURE_REGION_H

#include "core/demosaic.h"
#include "core/error.h"
#include "proto/lightstage.pb-c.h"

/** As asked; all zero (or NULL) = the whole picture. */
struct ls_demosaic_region ls_picture_region_of(const Lightstage__Region *region);

/** Make "the whole" explicit. LS_ERR_LIMIT: not inside @width x @height. */
LS_MUST_CHECK enum ls_err ls_picture_region_check(struct ls_demosaic_region *region, uint32_t width,
                                                  uint32_t height, struct ls_diag *diag);

#endif
