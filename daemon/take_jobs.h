/*
 * take_jobs: the jobs on take folders: list, show, verify, slate.
 * Layer: daemon. Threads: made on ls-main, stepped on ls-serve. Ownership: @storage is (transfer
 * none) and outlives the job; jobs are (transfer full).
 */
#ifndef LS_DAEMON_TAKE_JOBS_H
#define LS_DAEMON_TAKE_JOBS_H

#include "daemon/job.h"
#include "proto/lightstage.pb-c.h"

#include <stdint.h>

/** TakeListReply frames, oldest take first. */
struct ls_job *ls_take_list_job(uint32_t request, const char *storage);

/** One TakeShowReply with take.json as payload. */
struct ls_job *ls_take_show_job(uint32_t request, const char *storage, const char *take);

/** One TakeVerifyReply, after reading every published file. */
struct ls_job *ls_take_verify_job(uint32_t request, const char *storage, const char *take);

/** One TakeSlateReply, after writing the slate if the request has one. LS_ERR_INVALID: that could
 * not be written down; the folder is looked at by the job. *job: (transfer full). */
LS_MUST_CHECK enum ls_err ls_take_slate_job(uint32_t request, const char *storage,
                                            const Lightstage__TakeSlate *message,
                                            struct ls_job **job, struct ls_diag *diag);

#endif
