/*
 * merge_stage: ls-merge-N, from bound frames to published pictures.
 * Layer: daemon. Threads: create, arm, start, drain, stop and destroy on one normal thread, the
 * inlet's producer is ls-cam-N, the rest as stated. Ownership: everything in the configuration is
 * (transfer none) and outlives the stage.
 *
 * A frame is copied out of the ring into its condition's accumulator and checksummed on the way,
 * the slot goes back to the driver, then ticket and (with keep_raw) bytes go to the store. When the
 * last exposure of a condition is in, its rows are merged by all threads in bands, converted to
 * half and published. Darks are summed instead, and their mean is published as floats and kept. So
 * are watches, one at a time per camera, but their mean is not kept: it is compared with the
 * dark's, and what has drifted is an alarm in the journal.
 *
 * Accumulators are a bounded pool per camera. A condition with a shot missing keeps its accumulator
 * until another condition needs it: then it is given up whole and must be shot again whole; so is a
 * watch with a shot missing when the next one begins. When
 * every accumulator is being merged, frames wait in the ring, and credit slows the lights.
 *
 * Where the frames of a bracket are whole rounds apart (daemon/bracket.h), only the last of them
 * gets an accumulator: the others are kept as raw frames in the take's folder, nothing of them
 * stays in memory, and they are read again when the last is in.
 */
#ifndef LS_DAEMON_MERGE_STAGE_H
#define LS_DAEMON_MERGE_STAGE_H

#include "core/error.h"
#include "daemon/camera_thread.h"
#include "daemon/capture.h"
#include "daemon/dark_stage.h"
#include "daemon/queue.h"
#include "daemon/ring.h"

#include <semaphore.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>

struct ls_kept_shot;

struct ls_merge_stage_config {
    const struct ls_capture_setup *setup;
    struct ls_ring *const *rings;    /* per camera */
    const uint32_t *first_attempt;   /* per shot: attempts made before this run; NULL = 0 */
    const struct ls_kept_shot *kept; /* per shot: on disk since an earlier run; NULL = none */
    int64_t utc_s;
    uint64_t memory_bytes; /* for accumulators of all cameras; 0 = 1 GiB. At least 2 per camera */
};

struct ls_merge_stage;

/** Errors: LS_ERR_UNSUPPORTED (pixel format), LS_ERR_INVALID (a camera's constants), LS_ERR_NOMEM.
 */
LS_MUST_CHECK enum ls_err ls_merge_stage_create(const struct ls_merge_stage_config *config,
                                                struct ls_merge_stage **out, struct ls_diag *diag);

LS_MUST_CHECK enum ls_err ls_merge_stage_start(struct ls_merge_stage *stage, struct ls_diag *diag);

/** Where ls-cam-N puts bound frames, and what it posts. */
struct ls_queue *ls_merge_stage_inlet(struct ls_merge_stage *stage, uint32_t camera);
sem_t *ls_merge_stage_work(struct ls_merge_stage *stage);

/** The next program: controller step i is plan step @plan_steps[i] (transfer none, until the next
 * arm), and that is one more attempt of each. Call while drained. */
void ls_merge_stage_arm(struct ls_merge_stage *stage, const uint32_t *plan_steps, uint32_t n);

/** Wait until everything handed in is dealt with and every complete condition is published, or the
 * stage failed. */
void ls_merge_stage_drain(struct ls_merge_stage *stage);

/** Does a camera still need this plan step? While drained. */
bool ls_merge_stage_wants(const struct ls_merge_stage *stage, uint32_t plan_step);

/** Is the picture published? While drained. */
bool ls_merge_stage_has(const struct ls_merge_stage *stage, uint32_t condition, uint32_t camera);

/** How an exposure's dark of a camera came out; NULL while it is not published. While drained. */
const struct ls_dark_exposure *ls_merge_stage_dark(const struct ls_merge_stage *stage,
                                                   uint32_t camera, uint32_t exposure);

/** LS_OK, or the first error of the stage (store, memory, clipped black); it has stopped taking
 * frames. Any thread. RT-safe. */
const _Atomic int *ls_merge_stage_failure(const struct ls_merge_stage *stage);

/** The sentence to ls_merge_stage_failure. After stop. */
void ls_merge_stage_explain(const struct ls_merge_stage *stage, struct ls_diag *diag);

struct ls_merge_stage_counts {
    uint32_t steps_bound;       /* plan steps with a frame of every camera */
    uint32_t conditions_stored; /* of every camera */
    uint32_t shots;             /* frames accepted, repeated ones included */
    uint32_t repaired;          /* accepted frames of shots that had been lost before */
};

/** Any thread. */
void ls_merge_stage_counts(const struct ls_merge_stage *stage, struct ls_merge_stage_counts *out);

/** A shot was fired and gave no usable frame. While drained. */
void ls_merge_stage_lost(struct ls_merge_stage *stage, uint32_t plan_step, uint32_t camera);

/** Shots of @condition that were lost and then had. While drained. */
uint32_t ls_merge_stage_repaired(const struct ls_merge_stage *stage, uint32_t condition);

/** End the threads; what is unmerged is dropped. Idempotent. */
void ls_merge_stage_stop(struct ls_merge_stage *stage);

/** Stops first. NULL is allowed. */
void ls_merge_stage_destroy(struct ls_merge_stage *stage);

#endif
