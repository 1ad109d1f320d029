/*
 * merge_private: the merge stage, seen by its parts: merge_stage.c (its life, its threads and what
 * others may ask), merge_camera.c (one camera's side of it), merge_choice.c (which job is next),
 * merge_work.c (a job done; those of lights), merge_darks.c (those of darks and watches),
 * merge_books.c (tickets, counts, pictures handed to the store).
 * Layer: daemon. Threads: jobs run on merge threads without the lock; what they share is guarded by
 * `lock` unless it says otherwise. Ownership: the stage owns all of it.
 */
#ifndef LS_DAEMON_MERGE_PRIVATE_H
#define LS_DAEMON_MERGE_PRIVATE_H

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

/** What to do next; chosen with everything claimed that the job needs. */
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

/** The condition of a plan step. */
static inline const struct ls_plan_condition *ls_merge_condition(const struct ls_merge_stage *stage,
                                                                 uint32_t plan_step)
{
    const struct ls_plan *plan = stage->config.setup->plan;
    return &plan->conditions[plan->steps[plan_step].condition];
}

/* ---- merge_camera.c ---- */

/** Room for a camera's frames, and what earlier runs of the take have left of it. Errors:
 * ls_merge_stage_create. */
LS_MUST_CHECK enum ls_err ls_merge_camera_init(struct ls_merge_stage *stage, uint32_t index,
                                               struct ls_diag *diag);

/** Zeroed cameras are allowed. */
void ls_merge_camera_finish(struct ls_merge_camera *camera);

/* ---- merge_choice.c ---- */

/** The next job; false: nothing can be done now. Under the lock. */
bool ls_merge_choose(struct ls_merge_stage *stage, struct ls_merge_job *job);

/* ---- merge_work.c ---- */

/** Errors are latched. */
void ls_merge_do(struct ls_merge_stage *stage, const struct ls_merge_job *job);

/* ---- merge_darks.c ---- */

/** Fold in the frame of a dark or a watch; the last one's mean is published. */
LS_MUST_CHECK enum ls_err ls_merge_dark(struct ls_merge_stage *stage,
                                        const struct ls_merge_job *job, struct ls_diag *diag);

/* ---- merge_books.c ---- */

/** Latch the first error. Takes the lock. */
void ls_merge_fail(struct ls_merge_stage *stage, enum ls_err err, const struct ls_diag *diag);

/** The job's slot of the ring goes back to the driver. */
void ls_merge_give_back(struct ls_merge_stage *stage, const struct ls_merge_job *job);

/** The frame's ticket, also in *ticket, and, if the plan keeps them, its bytes go to the store. */
LS_MUST_CHECK enum ls_err ls_merge_record(struct ls_merge_stage *stage,
                                          const struct ls_merge_job *job, const void *raw,
                                          uint32_t crc, struct ls_ticket *ticket,
                                          struct ls_diag *diag);

/** The frame is in. Under the lock. */
void ls_merge_count_in(struct ls_merge_stage *stage, const struct ls_merge_job *job);

/** Merged now: since its latest frame, whose pulse began at @pulse_ns. */
struct ls_picture_times ls_merge_count_merged(const struct ls_merge_stage *stage, uint32_t camera,
                                              uint64_t pulse_ns, uint64_t arrived_ns);

/** Hand a picture to the store, with its attributes. @mosaic: its pixels; the rest is filled in. */
LS_MUST_CHECK enum ls_err ls_merge_publish(struct ls_merge_stage *stage, uint32_t camera,
                                           uint32_t condition, double longest_exposure_s,
                                           struct ls_exr_mosaic *mosaic,
                                           const struct ls_picture_times *times,
                                           struct ls_diag *diag);

/** The picture is published. Takes the lock. */
void ls_merge_count_published(struct ls_merge_stage *stage, uint32_t camera, uint32_t condition);

#endif
