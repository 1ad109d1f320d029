/*
 * fetch_job: pictures of the field, band by band: as stored, with gains, promoted, demosaiced.
 * Layer: daemon. Threads: made on ls-main, stepped on ls-serve. Ownership: the cache outlives it.
 */
#ifndef LS_DAEMON_FETCH_JOB_H
#define LS_DAEMON_FETCH_JOB_H

#include "daemon/field_cache.h"
#include "daemon/job.h"
#include "daemon/tiles.h"
#include "proto/lightstage.pb-c.h"

#include <stdint.h>

/** Checks what can be checked without the take: LS_ERR_INVALID, LS_ERR_UNSUPPORTED (a promoted
 * mosaic: ratios are formed after demosaicing; a promoted estimate or full sphere). @tiles: what
 * ls_tiles_read made of the request; its content is taken over and zeroed. *out: (transfer full).
 */
LS_MUST_CHECK enum ls_err ls_fetch_job_create(uint32_t request, struct ls_field_cache *cache,
                                              const Lightstage__Fetch *fetch,
                                              struct ls_tiles *tiles, struct ls_job **out,
                                              struct ls_diag *diag);

#endif
