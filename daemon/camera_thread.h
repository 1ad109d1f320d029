/*
 * camera_thread: ls-cam-N, which takes one camera's frames and binds them to steps.
 * Layer: daemon. Threads: create, start, stop and destroy on one normal thread; tell and the
 * counters on ls-seq (counters on any). Ownership: camera, ring and inlet are (transfer none) and
 * outlive it.
 *
 * Runs SCHED_FIFO if the process may. While it runs it allocates nothing, takes no lock of ours
 * and writes no text: it learns of steps through a lock-free queue and an atomic, and hands bound
 * frames on through another queue and a semaphore.
 */
#ifndef LS_DAEMON_CAMERA_THREAD_H
#define LS_DAEMON_CAMERA_THREAD_H

#include "core/error.h"
#include "daemon/bind.h"
#include "daemon/clock.h"
#include "daemon/metrics.h"
#include "daemon/queue.h"
#include "daemon/ring.h"
#include "drivers/camera.h"

#include <semaphore.h>
#include <stdbool.h>
#include <stdint.h>

/** A bound frame on its way to the merge stage; its slot is in the HANDED state. */
struct ls_bound_frame {
    uint32_t step; /* controller step since arm */
    struct ls_camera_frame frame;
    struct ls_step_event event;
    double exposure_us; /* as used: pulse + offset, or the register */
    double residual_us;
    uint64_t pulse_ns; /* start of the pulse, host CLOCK_MONOTONIC_RAW */
};

enum ls_camera_message_kind {
    LS_CAMERA_ARMED,   /* step = number of steps of the new program */
    LS_CAMERA_FIRED,   /* event, exposure_us, pulse_ns */
    LS_CAMERA_OPENED,  /* by order: step is lit */
    LS_CAMERA_EXPIRED, /* by order: step gets no frame any more */
    LS_CAMERA_QUIET,   /* by order: no frame is on its way */
};

struct ls_camera_message {
    enum ls_camera_message_kind kind;
    uint32_t step;
    struct ls_step_event event;
    double exposure_us;
    uint64_t pulse_ns; /* start of the pulse, host CLOCK_MONOTONIC_RAW */
};

struct ls_camera_thread_config {
    uint32_t index;
    struct ls_camera *camera; /* started */
    struct ls_ring *ring;
    struct ls_bind_config bind;
    uint32_t max_steps;
    struct ls_clock clock;         /* camera -> controller ns; by time only */
    struct ls_camera_frame anchor; /* of the last warm-up pulse */
    struct ls_queue *inlet;        /* of struct ls_bound_frame, room for every slot */
    sem_t *work;                   /* posted once per bound frame */
    sem_t *heard;                  /* posted once per LS_CAMERA_ARMED dealt with, and when there is
                                      room again after a message found none */
    struct ls_camera_metrics *metrics; /* counted into */
    uint32_t window;                   /* before any frame was bound */
    int rt_priority;                   /* 0 = normal */
};

struct ls_camera_counts {
    uint32_t programs;        /* LS_CAMERA_ARMED messages dealt with */
    uint32_t settled;         /* steps of this program with a verdict */
    uint32_t pending;         /* frames here and not decided */
    uint32_t window;          /* steps that may be under way: daemon/credit.h */
    bool suspect;             /* by order: the order is lost */
    uint32_t bound, unusable; /* verdicts since start: bound; missing or ambiguous */
    enum ls_err failure;      /* LS_ERR_GONE, LS_ERR_BUG ...: the thread has ended */
};

/** Largest and root-mean-square residual of frames bound by time. */
struct ls_camera_residuals {
    double max_us, sum_squares_us2;
    uint64_t n;
};

/** Steps that ended unbound and frames that were discarded, by reason, since start. */
struct ls_camera_reasons {
    uint32_t steps[LS_BIND_REASONS], frames[LS_BIND_REASONS];
};

struct ls_camera_thread;

LS_MUST_CHECK enum ls_err ls_camera_thread_create(const struct ls_camera_thread_config *config,
                                                  struct ls_camera_thread **out,
                                                  struct ls_diag *diag);

LS_MUST_CHECK enum ls_err ls_camera_thread_start(struct ls_camera_thread *thread,
                                                 struct ls_diag *diag);

/** False: the queue is full; try again when `heard` is posted. RT-safe. */
bool ls_camera_thread_tell(struct ls_camera_thread *thread,
                           const struct ls_camera_message *message);

/** Every event up to controller time @us has been told. RT-safe. */
void ls_camera_thread_until(struct ls_camera_thread *thread, uint64_t us);

/** RT-safe. */
void ls_camera_thread_counts(const struct ls_camera_thread *thread, struct ls_camera_counts *out);

/** How a step of this program ended. After it settled and before the next LS_CAMERA_ARMED. */
enum ls_bind_outcome ls_camera_thread_outcome(const struct ls_camera_thread *thread, uint32_t step);

/** When ls_camera_thread_outcome may be asked. */
struct ls_camera_reasons ls_camera_thread_reasons(const struct ls_camera_thread *thread);

/** Wake the thread, wait for it to end. The camera is still started. Idempotent. */
void ls_camera_thread_stop(struct ls_camera_thread *thread);

/** After stop. */
struct ls_camera_residuals ls_camera_thread_residuals(const struct ls_camera_thread *thread);

/** The camera's clock against the controller's in ns, as last fitted; no pairs of a camera bound by
 * order. After stop. */
struct ls_clock ls_camera_thread_clock(const struct ls_camera_thread *thread);

/** Stops first. NULL is allowed. */
void ls_camera_thread_destroy(struct ls_camera_thread *thread);

#endif
