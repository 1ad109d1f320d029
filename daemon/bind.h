/*
 * bind: which frame of one camera shows which fired step. Pure logic, no clock and no device.
 * Layer: daemon. Threads: one at a time (ls-cam-N). Ownership: the ls_bind owns its tables, frames
 * are copied; a frame's slot is the caller's again when it comes out of ls_bind_next.
 *
 * Feed step events and frames in whatever order they arrive (events among themselves in step
 * order, frames among themselves as the driver delivers them) and take out verdicts. Every step
 * comes out exactly once: bound, missing or ambiguous. Every frame comes out exactly once: with the
 * step it is bound to, or discarded.
 *
 * By time. A frame is decided once all events up to its time plus the window are known; one near no
 * step waits for a later event, or `event_delay_us`. It belongs
 * to a step when its time, mapped to the controller's clock, lies within `window_us` (a quarter of
 * the smallest pulse spacing) of exactly one fired step. That is then cross-checked against the
 * last frame with a place (the *anchor*): with ds the step delta, di the frame-id delta and dc the
 * trigger-counter delta,
 *     1 <= di <= ds  and  dc == di :
 * of the ds - 1 steps between, di - 1 lost their frame on the way and ds - di never fired the
 * camera; all of them are missing. The chunk exposure must be the step's within the tolerance, the
 * residual must not stand out of what the clocks' fit allows, the controller must not have clipped
 * the pulse, and no frame without a step may have come between. On any disagreement the frame's
 * step and all since the anchor's are ambiguous, and the frame becomes the new anchor.
 *
 * By order (camera without timestamps, driven one step at a time): the frame that follows the
 * opening of a step is that step's if di == 1 (and dc == 1). After an opened step without a frame
 * the order is lost (*suspect*): what comes late is collected and discarded, the next steps wait
 * out their patience and are ambiguous or missing, until the frame ids have grown by as much as
 * steps were opened since, or a quiet time has passed: a whole patience in which nothing was
 * triggered. The last frame seen is the new anchor.
 *
 * A step is missing when a later one is bound, or when `patience_us` after its start nothing came:
 * by time, after its start or after the last frame with a place came, since frames that still come,
 * in their order, tell that its own may be on its way. A frame that comes later still is discarded.
 */
#ifndef LS_DAEMON_BIND_H
#define LS_DAEMON_BIND_H

#include "core/error.h"
#include "drivers/camera.h"
#include "drivers/lights.h"

#include <stdbool.h>
#include <stdint.h>

enum { LS_BIND_NO_SLOT = 0xffffffffu, LS_BIND_NO_STEP = 0xffffffffu };

struct ls_bind_config {
    bool by_time;          /* else by order */
    bool has_counter;      /* frames carry a trigger counter */
    bool has_exposure;     /* frames carry their measured exposure */
    double window_us;      /* by time: a quarter of the smallest pulse spacing */
    double tight_us;       /* by time: largest residual the clocks explain, <= window_us */
    double event_delay_us; /* by time: how late the controller may report a step */
    double patience_us;    /* after a pulse's start or a frame, on the controller's clock */
    double exposure_tolerance_us, exposure_tolerance; /* allowed: sum of absolute and relative */
};

enum ls_bind_outcome {
    LS_BIND_OPEN, /* nothing known yet */
    LS_BIND_BOUND,
    LS_BIND_MISSING,   /* fired, no frame */
    LS_BIND_AMBIGUOUS, /* something disagreed: shoot again */
};

/** Why a step was not bound or a frame was discarded; counted, not printed. */
enum ls_bind_reason {
    LS_BIND_FINE,
    LS_BIND_LOST,       /* frame incomplete */
    LS_BIND_STALE,      /* frame older than the anchor, or of a step settled already */
    LS_BIND_NO_PULSE,   /* frame at a time when no step fired */
    LS_BIND_TWO_PULSES, /* frame near more than one step */
    LS_BIND_IDS,        /* frame-id or trigger-counter delta disagrees */
    LS_BIND_EXPOSURE,   /* measured exposure disagrees */
    LS_BIND_RESIDUAL,   /* time off by more than the clocks explain */
    LS_BIND_CLIPPED,    /* the controller clipped the pulse */
    LS_BIND_SUSPECT,    /* an unexplained frame came before */
    LS_BIND_NO_FRAME,   /* step: patience ended, or a later step was bound */
    LS_BIND_NO_EVENT,   /* step: the controller's event was lost */
    LS_BIND_REASONS
};

/** "frame incomplete", ...; never NULL. RT-safe. */
const char *ls_bind_reason_name(enum ls_bind_reason reason);

/** A verdict on a step, on a frame, or on both. */
struct ls_bind_verdict {
    uint32_t step;                /* controller step, or LS_BIND_NO_STEP: the frame alone */
    enum ls_bind_outcome outcome; /* of the step */
    enum ls_bind_reason reason;
    uint32_t slot;                /* of the frame, or LS_BIND_NO_SLOT: the step alone */
    struct ls_camera_frame frame; /* valid if there is a slot */
    struct ls_step_event event;   /* valid if bound */
    double residual_us;           /* bound by time: frame - pulse, controller clock */
};

struct ls_bind;

/** Room for programs of up to @max_steps and @max_frames undecided frames (the ring's slots). */
LS_MUST_CHECK enum ls_err ls_bind_create(const struct ls_bind_config *config, uint32_t max_steps,
                                         uint32_t max_frames, struct ls_bind **out);

/** A new program of @n_steps (<= max_steps) was armed: steps count from 0 again, the anchor stays
 * (it lies before step 0 now). Flush undecided frames first. RT-safe. */
void ls_bind_arm(struct ls_bind *bind, uint32_t n_steps);

/** A frame whose place is known: it showed the pulse just before step 0. RT-safe. */
void ls_bind_anchor(struct ls_bind *bind, const struct ls_camera_frame *frame);

/**
 * A fired step, with the exposure it asked of this camera (0 = not known). Steps skipped since the
 * last event are ambiguous at once: their events were lost. LS_ERR_MISMATCH if the step is out of
 * the program or not after the last one. RT-safe.
 */
LS_MUST_CHECK enum ls_err ls_bind_event(struct ls_bind *bind, const struct ls_step_event *event,
                                        double exposure_us);

/** Every step that fired up to @us, controller clock, has been fed. RT-safe. */
void ls_bind_until(struct ls_bind *bind, uint64_t us);

/** By order: @step is lit and the camera is being triggered; later frames are its. RT-safe. */
void ls_bind_open(struct ls_bind *bind, uint32_t step);

/** By order: @step gets no frame any more, although its event may be still to come: its patience
 * is over, or it was never opened because its light went off too early. RT-safe. */
void ls_bind_expire(struct ls_bind *bind, uint32_t step);

/** By order: is the order lost? RT-safe. */
bool ls_bind_suspect(const struct ls_bind *bind);

/** By order: nothing was triggered for so long that no frame is on its way: the order is known
 * again. RT-safe. */
void ls_bind_quiet(struct ls_bind *bind);

/** A frame from the driver; @mapped_us: its timestamp on the controller's clock (by time only).
 * @slack_us: how far the clocks may have parted since they were last compared, added to
 * config.tight_us. LS_ERR_FULL: more than max_frames undecided. RT-safe. */
LS_MUST_CHECK enum ls_err ls_bind_frame(struct ls_bind *bind, const struct ls_camera_frame *frame,
                                        double mapped_us, double slack_us);

/** The next verdict; false when nothing can be said yet. RT-safe. */
bool ls_bind_next(struct ls_bind *bind, struct ls_bind_verdict *verdict);

/** Give up the oldest undecided frame, to take its slot back; false if there is none. RT-safe. */
bool ls_bind_flush(struct ls_bind *bind, struct ls_bind_verdict *verdict);

/** RT-safe. */
enum ls_bind_outcome ls_bind_outcome(const struct ls_bind *bind, uint32_t step);

/** Steps with a verdict, which ls_bind_next may still have to hand out. RT-safe. */
uint32_t ls_bind_settled(const struct ls_bind *bind);

/** Frames fed and not decided. RT-safe. */
uint32_t ls_bind_pending(const struct ls_bind *bind);

/** NULL is allowed. */
void ls_bind_destroy(struct ls_bind *bind);

#endif
