/*
 * sequencer: ls-seq, which makes the controller fire one program as fast as frames find room.
 * Layer: daemon. Threads: run blocks its caller and works on a thread of its own, SCHED_FIFO if the
 * process may; abort is an atomic of the caller's. Ownership: everything is (transfer none).
 *
 * Load, arm, then until every camera has a verdict on every step: grant credit, poll step events,
 * pass them on to the cameras' threads. Between arm and the end nothing of ours allocates, locks or
 * writes text; sentences are written once it is over. Whatever ends it, LEDs are dark on return, or
 * the sentence says that they may be lit.
 *
 * Stepwise (a camera without line trigger or timestamps): one step is granted, the cameras without
 * a line are triggered once it is lit, and the next grant, which ends a held step, waits for every
 * camera's frame or its patience.
 * A held step whose event comes before that went dark by itself: nothing is triggered in it any
 * more, its event is marked as clipped, and it is shot again. When a camera bound by order has lost
 * it, nothing is triggered for a whole patience.
 *
 * Hot. When the controller says that its dome is hot, nothing more is granted until it has not said
 * so for a second: the take pauses in the dark.
 */
#ifndef LS_DAEMON_SEQUENCER_H
#define LS_DAEMON_SEQUENCER_H

#include "core/error.h"
#include "daemon/camera_thread.h"
#include "daemon/clock.h"
#include "daemon/config.h"
#include "daemon/flashing.h"
#include "daemon/metrics.h"
#include "daemon/ring.h"
#include "drivers/camera.h"
#include "drivers/lights.h"

#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>

struct ls_sequencer_camera {
    const char *name;
    struct ls_camera *camera;
    struct ls_camera_thread *thread;
    const struct ls_ring *ring;
    bool by_time;                 /* bound by time, else by order */
    bool software;                /* triggered by us once a step is lit */
    bool timed;                   /* exposure is a register, else the pulse's width */
    double asked_us, exposure_us; /* timed: written to the register before, and what it holds */
    uint64_t min_interval_us;     /* software: triggers closer than this are missed */
    uint64_t triggered_ns;        /* software: host time of the last one */
    double offset_us;             /* not timed: added by the sensor to the pulse */
};

struct ls_sequencer {
    struct ls_lights *lights;
    uint32_t n_cameras;
    struct ls_sequencer_camera cameras[LS_MAX_CAMERAS];
    bool stepwise;
    bool live; /* subject */
    const struct ls_config *config;
    struct ls_flashing *flashing; /* live and not allowed to flash: what it has seen; else NULL */
    uint64_t burst_ns;            /* live: when the last burst began, of this or earlier programs */
    uint64_t patience_us;         /* host time a step may go without its frame, stepwise */
    uint64_t stall_us;    /* without any step event while some are granted: the controller hangs */
    uint64_t cooling_us;  /* the dome may be hot for so long, then the take ends */
    _Atomic bool cooling; /* it is: nothing is granted. Any thread */
    sem_t *heard;         /* the cameras' threads': as in their configuration */
    struct ls_clock *controller; /* against the host, ns; status reads are added as they come */
    struct ls_metrics *metrics;  /* counted into */
    const _Atomic bool *abort;
    const _Atomic int *failure; /* enum ls_err of another stage: stop; LS_OK = go on */
    bool maybe_lit;             /* result: the blank after the last program failed */
    /* results, added up over programs */
    uint64_t first_us, last_us; /* of the pulses, controller clock, of this and earlier programs */
    double pulse_seconds;       /* sum over programs: first to last pulse */
    uint32_t fired;             /* pulses */
    double cooled_seconds;      /* nothing was granted, for heat */
    int32_t hottest_c;
};

/**
 * Run @program to its end. @program->n_steps is at most the cameras' threads' max_steps.
 * Errors: LS_ERR_ABORTED (asked to), LS_ERR_STATE (another stage failed: its error is the one to
 * report), LS_ERR_REFUSED (interlock or another latched fault; a live subject saw flashes),
 * LS_ERR_LIMIT (too hot for too long), LS_ERR_GONE, LS_ERR_TIMEOUT (link or controller),
 * LS_ERR_MISMATCH (controller restarted; events lost), those of ls_lights_load.
 */
LS_MUST_CHECK enum ls_err ls_sequencer_run(struct ls_sequencer *sequencer,
                                           const struct ls_program *program, struct ls_diag *diag);

/** Names of latched faults, comma-separated, into @text. */
void ls_sequencer_fault_names(uint32_t faults, char *text, size_t size);

#endif
