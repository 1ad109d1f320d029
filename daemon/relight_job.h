/*
 * relight_job: pictures under new light, computed in one pass and sent tile row by tile row.
 * Layer: daemon. Threads: made on ls-main, stepped on ls-serve. Ownership: the cache outlives it.
 */
#ifndef LS_DAEMON_RELIGHT_JOB_H
#define LS_DAEMON_RELIGHT_JOB_H

#include "daemon/field_cache.h"
#include "daemon/job.h"
#include "proto/lightstage.pb-c.h"

#include <stddef.h>
#include <stdint.h>

/** @payload: the weights, copied. Errors: LS_ERR_INVALID (sizes that do not fit each other, a
 * weight that is not finite), LS_ERR_LIMIT (more rows than
 * LS_RENDER_MAX_TERMS), those of ls_promotion_read. *out: (transfer full). */
LS_MUST_CHECK enum ls_err ls_relight_job_create(uint32_t request, struct ls_field_cache *cache,
                                                const Lightstage__Relight *relight,
                                                const uint8_t *payload, size_t payload_bytes,
                                                struct ls_job **out, struct ls_diag *diag);

#endif
