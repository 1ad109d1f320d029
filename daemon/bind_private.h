/*
 * bind_private: a binding's state, for the files it is made of: bind.c (what is fed and what comes
 * out), bind_time.c and bind_order.c (the two ways to decide a frame).
 * Layer: daemon. Threads, ownership: bind.h. Everything here is RT-safe.
 */
#ifndef LS_DAEMON_BIND_PRIVATE_H
#define LS_DAEMON_BIND_PRIVATE_H

#include "daemon/bind.h"

struct ls_bind_step {
    struct ls_step_event event;
    double exposure_us;
    bool fired, told;
    unsigned char outcome, reason;
};

struct ls_bind_undecided {
    struct ls_camera_frame frame;
    double mapped_us, slack_us;
};

struct ls_bind_anchor {
    bool valid;
    int64_t step; /* before step 0 after arming again */
    uint64_t frame_id;
    uint32_t counter;
};

struct ls_bind {
    struct ls_bind_config config;
    uint32_t max_steps, max_frames;
    uint32_t n_steps;
    uint32_t n_seen;    /* steps below this have an event or were skipped */
    uint32_t n_told;    /* steps below this came out of ls_bind_next */
    uint32_t n_patient; /* steps below this are settled */
    uint32_t settled;
    uint32_t open; /* by order: the step frames belong to, or NO_STEP */
    bool suspect, late_seen;
    int64_t due; /* by order: triggers without a frame, by id; below 0: frames without a trigger */
    uint64_t until_us;
    uint64_t placed_us; /* by time: until_us when the anchor was last moved, in this program */
    struct ls_bind_anchor anchor;
    struct ls_bind_step *steps;
    struct ls_bind_undecided *frames; /* ring */
    uint32_t first, n_frames;
};

/* bind.c */

/** The verdict on a step that is open; of others the first one stands. */
void ls_bind_settle(struct ls_bind *bind, uint32_t step, enum ls_bind_outcome outcome,
                    enum ls_bind_reason reason);

/** The same for all steps below @end. */
void ls_bind_settle_before(struct ls_bind *bind, int64_t end, enum ls_bind_outcome outcome,
                           enum ls_bind_reason reason);

/** @frame showed @step: what comes is counted from there. */
void ls_bind_move_anchor(struct ls_bind *bind, int64_t step, const struct ls_camera_frame *frame);

/** Is the frame no newer than the anchor? */
bool ls_bind_is_stale(const struct ls_bind *bind, const struct ls_camera_frame *frame);

/** LS_BIND_FINE, LS_BIND_CLIPPED or LS_BIND_EXPOSURE. */
enum ls_bind_reason ls_bind_check_exposure(const struct ls_bind *bind,
                                           const struct ls_bind_step *step,
                                           const struct ls_camera_frame *frame);

/** Verdict: the frame is discarded. */
void ls_bind_tell_frame(struct ls_bind_verdict *verdict, const struct ls_camera_frame *frame,
                        enum ls_bind_reason reason);

/** Verdict: the frame is the step's, which is settled so. */
void ls_bind_tell_bound(struct ls_bind *bind, uint32_t step, const struct ls_camera_frame *frame,
                        double residual_us, struct ls_bind_verdict *verdict);

/* bind_time.c */

/** False: events up to the frame's time are still to come. */
bool ls_bind_decide_by_time(struct ls_bind *bind, const struct ls_bind_undecided *pending,
                            struct ls_bind_verdict *verdict);

/* bind_order.c; it has the public functions that are by order, too */

/** False: the open step has not fired yet. */
bool ls_bind_decide_by_order(struct ls_bind *bind, const struct ls_bind_undecided *pending,
                             struct ls_bind_verdict *verdict);

#endif
