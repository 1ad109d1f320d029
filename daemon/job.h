/*
 * job: an answer too long for ls-main, made one frame at a time on ls-serve threads.
 * Layer: daemon. Threads: stated per function. Ownership: a job belongs to its session while it
 * waits and to the thread that steps it while it is stepped.
 *
 * A step makes at most one frame and returns; the thread sends it, and goes on for a few frames
 * while the client takes them. So a stalled client holds a parked job and one frame, never a
 * thread. Nor does a job that needs what another is making: its step says so with LS_ERR_BUSY, and
 * it is stepped again once that is there (ls_job_wake_others).
 */
#ifndef LS_DAEMON_JOB_H
#define LS_DAEMON_JOB_H

#include "core/error.h"
#include "daemon/outbox.h"

#include <glib.h>
#include <stdbool.h>
#include <stdint.h>

struct ls_job;

struct ls_job_ops {
    const char *name;
    /** ls-serve. Make the next frame, or none (leave @chunk zero) to be called again; set *last
     * with the last frame, which carries LS_FRAME_LAST. LS_ERR_BUSY: wait, @chunk left zero. Any
     * other error ends the job; what it left in @chunk is freed. Long steps look at
     * ls_job_cancelled now and then. */
    enum ls_err (*step)(struct ls_job *job, struct ls_chunk *chunk, bool *last,
                        struct ls_diag *diag);
    /** Any thread, once, when nobody steps it. */
    void (*destroy)(struct ls_job *job);
};

/** First member of every kind of job. */
struct ls_job {
    const struct ls_job_ops *ops;
    uint32_t request;
    const char *take;         /* it is of, (transfer none); NULL: of none */
    int cancelled;            /* atomic */
    bool counts_credit;       /* else it may always send */
    uint64_t credit;          /* atomic: bytes of payload it may still send */
    struct ls_job_pool *pool; /* that steps it; NULL: a thread of its own may block */
};

/** Any thread. A waiting job ends. */
void ls_job_cancel(struct ls_job *job);
bool ls_job_cancelled(const struct ls_job *job);

/** Any thread that steps @job: what others of its pool wait for may be there. Wakes them all; who
 * has nothing to go on with says LS_ERR_BUSY again. NULL is allowed. */
void ls_job_wake_others(const struct ls_job *job);

/** Any thread. May it send a frame? With any credit left it may: the last one may be longer. */
bool ls_job_may_send(const struct ls_job *job);

/** It sends @bytes of payload. True: that was the last of its credit. */
bool ls_job_use_credit(struct ls_job *job, uint64_t bytes);

/** Its client gives it @bytes more. */
void ls_job_give_credit(struct ls_job *job, uint64_t bytes);

/** What a step came to. */
struct ls_job_result {
    enum ls_err err;
    bool last;
    struct ls_chunk chunk;
    struct ls_diag diag;
};

/** Called on ls-serve with each frame that is made (transfer full). True: the job may go on. */
typedef bool ls_job_send(void *user, struct ls_job *job, struct ls_chunk *chunk);

/** Called on ls-main with the result; takes the chunk, if nobody has sent it. */
typedef void ls_job_done(void *user, struct ls_job *job, struct ls_job_result *result);

/** The ls-serve threads. */
struct ls_job_pool;

/** Start @n_threads threads that report to the default main context. (transfer full). */
struct ls_job_pool *ls_job_pool_create(unsigned n_threads);

/** ls-main. Step @job on some thread, again for as long as it waits, then call @done with @user.
 * With
 * @send (else NULL) frames are sent by the thread, and while that is true up to eight steps are
 * made. A job cancelled while it waits ends with LS_ERR_ABORTED. */
void ls_job_pool_step(struct ls_job_pool *pool, struct ls_job *job, ls_job_send *send,
                      ls_job_done *done, void *user);

/** ls-main. Finish what is queued (jobs should be cancelled first), report it, end the threads;
 * who waits ends with LS_ERR_ABORTED. NULL is allowed. */
void ls_job_pool_destroy(struct ls_job_pool *pool);

#endif
