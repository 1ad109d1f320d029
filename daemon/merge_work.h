/*
 * merge_work: what one merge thread does with one frame or one band; the inside of merge_stage.
 * Layer: daemon. Threads: jobs run on merge threads without the lock; what they share is guarded by
 * `lock` unless it says otherwise. Ownership: the stage owns all of it.
 */
#ifndef LS_DAEMON_MERGE_WORK_H
#define LS_DAEMON_MERGE_WORK_H

#include "daemon/accumulator.h"
#include "daemon/dark_stage.h"
#include "daemon/kept.h"
#include "daemon/merge_stage.h"

#include <pthread.h>

enum ls_shot_state { LS_SHOT_OPEN, LS_SHOT_CLAIMED, LS_SHOT_IN };

/** One camera's side of the stage. */
struct ls_merge_camera {
    const struct ls_pixel_format *format;
    uint32_t width, height;
    size_t payload_bytes;
    struct ls_queue inlet;
    struct ls_bound_frame held; /* taken from the inlet, waiting for an accumulator */
    bool holds;
    struct ls_accumulators pool;
    struct ls_dark_stage darks;
    struct {
        bool under_way;
        uint32_t condition, adding; /* frames being folded in, the closing of the sum included */
    } watch;
    uint8_t *shots;            /* enum ls_shot_state per plan step */
    struct ls_kept_shot *kept; /* per plan step, where brackets wait on disk; else NULL */
    uint8_t *published;        /* per condition */
    uint32_t *darks_in;        /* per condition: frames folded in */
};

struct ls_merge_stage {
    struct ls_merge_stage_config config;
    uint32_t n_cameras, n_threads;
    struct ls_merge_camera cameras[LS_MAX_CAMERAS];
    pthread_mutex_t lock;
    pthread_cond_t idle; /* busy fell to 0 */
    sem_t work;
    uint32_t busy; /* jobs running */
    bool stopping;
    const uint32_t *plan_steps; /* of the program under way */
    uint32_t n_program;
    uint16_t *attempts;    /* per plan step: times fired in this run */
    uint8_t *cameras_in;   /* per plan step: cameras with its frame */
    uint8_t *cameras_have; /* per condition: cameras that published it */
    uint8_t *lost;         /* per shot: tried and not had */
    uint16_t *repaired;    /* per condition: shots lost, then had */
    _Atomic uint32_t steps_bound, conditions_stored, shots_in, repairs;
    _Atomic int failure;
    struct ls_diag diag;
    pthread_t *threads;
    uint32_t n_running;
};

/** What to do next; made by the scheduler with everything claimed that the job needs. */
struct ls_merge_job {
    enum {
        LS_JOB_NONE,
        LS_JOB_DISCARD,
        LS_JOB_DARK,
        LS_JOB_WATCH,
        LS_JOB_KEEP, /* on disk, until its bracket is complete */
        LS_JOB_COPY,
        LS_JOB_BAND
    } kind;
    uint32_t camera, plan_step;
    struct ls_bound_frame bound;        /* not of a band */
    struct ls_accumulator *accumulator; /* COPY, BAND */
    uint32_t band;
};

/** Latch the first error. Takes the lock. */
void ls_merge_fail(struct ls_merge_stage *stage, enum ls_err err, const struct ls_diag *diag);

void ls_merge_do(struct ls_merge_stage *stage, const struct ls_merge_job *job);

#endif
