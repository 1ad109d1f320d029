/*
 * condition_job: the pictures of a take by the names the plan gave them, as they are stored.
 * Layer: daemon. Threads: made on ls-main, stepped on ls-serve. Ownership: @storage is (transfer
 * none) and outlives the job.
 */
#ifndef LS_DAEMON_CONDITION_JOB_H
#define LS_DAEMON_CONDITION_JOB_H

#include "core/error.h"
#include "daemon/job.h"
#include "daemon/tiles.h"
#include "proto/lightstage.pb-c.h"

/**
 * FetchReply frames, the pictures of @fetch's `conditions` one after the other; any kind of light,
 * ungained, on the mosaic. Errors now: LS_ERR_INVALID, LS_ERR_LIMIT, LS_ERR_UNSUPPORTED (the rest
 * of the request asks for something else). @tiles: as ls_fetch_job_create. Of its steps:
 * LS_ERR_NOT_FOUND (take, camera, a name that is not in the plan, a dark), LS_ERR_STATE (not
 * photographed yet), those of ls_picture_map_open. (transfer full).
 */
LS_MUST_CHECK enum ls_err ls_condition_job_create(uint32_t request, const char *storage,
                                                  const Lightstage__Fetch *fetch,
                                                  struct ls_tiles *tiles, struct ls_job **out,
                                                  struct ls_diag *diag);

#endif
