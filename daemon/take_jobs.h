/*
 * take_jobs: the jobs that read take folders: list, show, verify.
 * Layer: daemon. Threads: made on ls-main, stepped on ls-serve. Ownership: @storage is (transfer
 * none) and outlives the job; jobs are (transfer full).
 */
#ifndef LS_DAEMON_TAKE_JOBS_H
#define LS_DAEMON_TAKE_JOBS_H

#include "daemon/job.h"

#include <stdint.h>

/** TakeListReply frames, oldest take first. */
struct ls_job *ls_take_list_job(uint32_t request, const char *storage);

/** One TakeShowReply with take.json as payload. */
struct ls_job *ls_take_show_job(uint32_t request, const char *storage, const char *take);

/** One TakeVerifyReply, after reading every published file. */
struct ls_job *ls_take_verify_job(uint32_t request, const char *storage, const char *take);

#endif
