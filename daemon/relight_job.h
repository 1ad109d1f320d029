/*
 * relight_job: a picture under new light, computed and sent tile row by tile row.
 * Layer: daemon. Threads: made on ls-main, stepped on ls-serve. Ownership: the cache outlives it.
 *
 * Each tile row of the field is read once: the rows that the demosaic of the next band needs again
 * are kept. The result is bit-identical to relighting the whole picture at once.
 */
#ifndef LS_DAEMON_RELIGHT_JOB_H
#define LS_DAEMON_RELIGHT_JOB_H

#include "daemon/field_cache.h"
#include "daemon/job.h"
#include "proto/lightstage.pb-c.h"

#include <stddef.h>
#include <stdint.h>

/** @payload: the weights, copied. Errors: LS_ERR_INVALID (sizes that do not fit each other, a
 * weight that is not finite). *out: (transfer full). */
LS_MUST_CHECK enum ls_err ls_relight_job_create(uint32_t request, struct ls_field_cache *cache,
                                                const Lightstage__Relight *relight,
                                                const uint8_t *payload, size_t payload_bytes,
                                                struct ls_job **out, struct ls_diag *diag);

#endif
