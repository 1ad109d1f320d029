#include "daemon/bind.h"

#include <assert.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

struct step {
    struct ls_step_event event;
    double exposure_us;
    bool fired, told;
    unsigned char outcome, reason;
};

struct pending {
    struct ls_camera_frame frame;
    double mapped_us, slack_us;
};

struct anchor {
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
    struct anchor anchor;
    struct step *steps;
    struct pending *frames; /* ring */
    uint32_t first, n_frames;
};

const char *ls_bind_reason_name(enum ls_bind_reason reason)
{
    static const char *const names[LS_BIND_REASONS] = {
        [LS_BIND_FINE] = "fine",
        [LS_BIND_LOST] = "frame incomplete",
        [LS_BIND_STALE] = "frame too late or twice",
        [LS_BIND_NO_PULSE] = "frame without a pulse",
        [LS_BIND_TWO_PULSES] = "frame near two pulses",
        [LS_BIND_IDS] = "ids or trigger counter disagree",
        [LS_BIND_EXPOSURE] = "measured exposure disagrees",
        [LS_BIND_RESIDUAL] = "time disagrees",
        [LS_BIND_CLIPPED] = "pulse clipped by the controller",
        [LS_BIND_SUSPECT] = "follows an unexplained frame",
        [LS_BIND_NO_FRAME] = "no frame",
        [LS_BIND_NO_EVENT] = "step event lost",
    };
    return (unsigned)reason < LS_BIND_REASONS ? names[reason] : "unknown";
}

static void settle(struct ls_bind *bind, uint32_t step, enum ls_bind_outcome outcome,
                   enum ls_bind_reason reason)
{
    struct step *s = &bind->steps[step];
    if (s->outcome != LS_BIND_OPEN)
        return;
    s->outcome = (unsigned char)outcome;
    s->reason = (unsigned char)reason;
    bind->settled++;
}

static void settle_before(struct ls_bind *bind, int64_t end, enum ls_bind_outcome outcome,
                          enum ls_bind_reason reason)
{
    for (; (int64_t)bind->n_patient < end; bind->n_patient++)
        settle(bind, bind->n_patient, outcome, reason);
}

enum ls_err ls_bind_create(const struct ls_bind_config *config, uint32_t max_steps,
                           uint32_t max_frames, struct ls_bind **out)
{
    struct ls_bind *bind = calloc(1, sizeof *bind);
    if (!bind)
        return LS_ERR_NOMEM;
    bind->config = *config;
    bind->max_steps = max_steps;
    bind->max_frames = max_frames;
    bind->open = LS_BIND_NO_STEP;
    bind->steps = calloc(max_steps ? max_steps : 1, sizeof *bind->steps);
    bind->frames = calloc(max_frames ? max_frames : 1, sizeof *bind->frames);
    if (!bind->steps || !bind->frames) {
        ls_bind_destroy(bind);
        return LS_ERR_NOMEM;
    }
    *out = bind;
    return LS_OK;
}

void ls_bind_arm(struct ls_bind *bind, uint32_t n_steps)
{
    assert(n_steps <= bind->max_steps && bind->n_frames == 0);
    bind->anchor.step -= bind->n_steps;
    memset(bind->steps, 0, n_steps * sizeof *bind->steps);
    bind->n_steps = n_steps;
    bind->n_seen = bind->n_told = bind->n_patient = bind->settled = 0;
    bind->open = LS_BIND_NO_STEP;
    bind->until_us = bind->placed_us = 0;
    bind->late_seen = false;
}

void ls_bind_anchor(struct ls_bind *bind, const struct ls_camera_frame *frame)
{
    bind->anchor = (struct anchor){
        .valid = true, .step = -1, .frame_id = frame->frame_id, .counter = frame->trigger_counter};
    bind->suspect = false;
    bind->due = 0;
}

enum ls_err ls_bind_event(struct ls_bind *bind, const struct ls_step_event *event,
                          double exposure_us)
{
    if (event->step >= bind->n_steps || event->step < bind->n_seen)
        return LS_ERR_MISMATCH;
    for (uint32_t i = bind->n_seen; i < event->step; i++)
        settle(bind, i, LS_BIND_AMBIGUOUS, LS_BIND_NO_EVENT);
    struct step *step = &bind->steps[event->step];
    step->event = *event;
    step->exposure_us = exposure_us;
    step->fired = true;
    bind->n_seen = event->step + 1;
    return LS_OK;
}

void ls_bind_until(struct ls_bind *bind, uint64_t us)
{
    if (us > bind->until_us)
        bind->until_us = us;
}

void ls_bind_open(struct ls_bind *bind, uint32_t step)
{
    if (step >= bind->n_steps)
        return;
    bind->open = step;
    bind->due++;
}

void ls_bind_quiet(struct ls_bind *bind)
{
    bind->due = 0;
    bind->late_seen = false;
    bind->suspect = !bind->anchor.valid;
}

bool ls_bind_suspect(const struct ls_bind *bind)
{
    return bind->suspect;
}

/* By order: the step is over; without a frame, or with frames of unknown order. */
void ls_bind_expire(struct ls_bind *bind, uint32_t step)
{
    if (step >= bind->n_steps || bind->steps[step].outcome != LS_BIND_OPEN)
        return;
    if (step != bind->open) {
        bool clipped = bind->steps[step].event.flags & LS_EVENT_CLIPPED;
        settle(bind, step, LS_BIND_MISSING, clipped ? LS_BIND_CLIPPED : LS_BIND_NO_FRAME);
    } else if (bind->late_seen) {
        bind->suspect = bind->due != 0;
        bind->late_seen = false;
        settle(bind, step, LS_BIND_AMBIGUOUS, LS_BIND_SUSPECT);
    } else {
        bind->suspect = true;
        settle(bind, step, LS_BIND_MISSING, LS_BIND_NO_FRAME);
    }
}

enum ls_err ls_bind_frame(struct ls_bind *bind, const struct ls_camera_frame *frame,
                          double mapped_us, double slack_us)
{
    if (bind->n_frames == bind->max_frames)
        return LS_ERR_FULL;
    bind->frames[(bind->first + bind->n_frames++) % bind->max_frames] =
        (struct pending){.frame = *frame, .mapped_us = mapped_us, .slack_us = slack_us};
    return LS_OK;
}

static void pop_frame(struct ls_bind *bind)
{
    bind->first = (bind->first + 1) % bind->max_frames;
    bind->n_frames--;
}

static void move_anchor(struct ls_bind *bind, int64_t step, const struct ls_camera_frame *frame)
{
    bind->anchor = (struct anchor){.valid = true,
                                   .step = step,
                                   .frame_id = frame->frame_id,
                                   .counter = frame->trigger_counter};
    if (bind->config.by_time)
        bind->placed_us = bind->until_us;
}

/* First seen step that fired at or after @us; n_seen if none. Skipped ones carry no time. */
static uint32_t first_at(const struct ls_bind *bind, double us)
{
    uint32_t i = bind->n_seen;
    while (i > 0 && (!bind->steps[i - 1].fired || (double)bind->steps[i - 1].event.us >= us))
        i--;
    return i;
}

/* How many steps fired within the window of @us; the last of them in *step. */
static unsigned near(const struct ls_bind *bind, double us, uint32_t *step)
{
    unsigned n = 0;
    double end = us + bind->config.window_us;
    for (uint32_t i = first_at(bind, us - bind->config.window_us); i < bind->n_seen; i++) {
        const struct step *s = &bind->steps[i];
        if (!s->fired)
            continue;
        if ((double)s->event.us > end)
            break;
        *step = i;
        n++;
    }
    return n;
}

static enum ls_bind_reason check_exposure(const struct ls_bind *bind, const struct step *step,
                                          const struct ls_camera_frame *frame)
{
    if (step->event.flags & LS_EVENT_CLIPPED)
        return LS_BIND_CLIPPED;
    if (!bind->config.has_exposure || step->exposure_us <= 0)
        return LS_BIND_FINE;
    double allowed =
        bind->config.exposure_tolerance_us + bind->config.exposure_tolerance * step->exposure_us;
    bool match = fabs(frame->chunk_exposure_us - step->exposure_us) <= allowed;
    return match ? LS_BIND_FINE : LS_BIND_EXPOSURE;
}

static bool deltas_agree(const struct ls_bind *bind, int64_t step,
                         const struct ls_camera_frame *frame)
{
    if (!bind->anchor.valid)
        return false;
    int64_t ds = step - bind->anchor.step;
    int64_t di = (int64_t)(frame->frame_id - bind->anchor.frame_id);
    uint32_t dc = frame->trigger_counter - bind->anchor.counter;
    if (di < 1 || di > ds)
        return false;
    return !bind->config.has_counter || dc == di;
}

static enum ls_bind_reason cross_check(const struct ls_bind *bind, uint32_t step,
                                       const struct pending *pending)
{
    const struct step *s = &bind->steps[step];
    if (bind->suspect)
        return LS_BIND_SUSPECT;
    if (!deltas_agree(bind, step, &pending->frame))
        return LS_BIND_IDS;
    if (fabs(pending->mapped_us - (double)s->event.us) > bind->config.tight_us + pending->slack_us)
        return LS_BIND_RESIDUAL;
    return check_exposure(bind, s, &pending->frame);
}

static void tell_frame(struct ls_bind_verdict *verdict, const struct ls_camera_frame *frame,
                       enum ls_bind_reason reason)
{
    *verdict = (struct ls_bind_verdict){.step = LS_BIND_NO_STEP,
                                        .outcome = LS_BIND_OPEN,
                                        .reason = reason,
                                        .slot = frame->slot,
                                        .frame = *frame};
}

static void tell_bound(struct ls_bind *bind, uint32_t step, const struct ls_camera_frame *frame,
                       double residual_us, struct ls_bind_verdict *verdict)
{
    settle(bind, step, LS_BIND_BOUND, LS_BIND_FINE);
    bind->steps[step].told = true;
    *verdict = (struct ls_bind_verdict){.step = step,
                                        .outcome = LS_BIND_BOUND,
                                        .slot = frame->slot,
                                        .frame = *frame,
                                        .event = bind->steps[step].event,
                                        .residual_us = residual_us};
}

/* The frame's time is that of one step, still open. */
static void place(struct ls_bind *bind, uint32_t step, const struct pending *pending,
                  struct ls_bind_verdict *verdict)
{
    enum ls_bind_reason reason = cross_check(bind, step, pending);
    if (reason == LS_BIND_FINE) {
        settle_before(bind, step, LS_BIND_MISSING, LS_BIND_NO_FRAME);
        tell_bound(bind, step, &pending->frame,
                   pending->mapped_us - (double)bind->steps[step].event.us, verdict);
    } else {
        settle_before(bind, (int64_t)step + 1, LS_BIND_AMBIGUOUS, reason);
        tell_frame(verdict, &pending->frame, reason);
    }
    bind->suspect = false;
    move_anchor(bind, step, &pending->frame);
}

/* A frame of a step that was settled without it: too late to be used, still good for the deltas. */
static void place_late(struct ls_bind *bind, uint32_t step, const struct pending *pending,
                       struct ls_bind_verdict *verdict)
{
    bool bound = bind->steps[step].outcome == LS_BIND_BOUND;
    if (bound || bind->suspect || !deltas_agree(bind, step, &pending->frame))
        bind->suspect = true;
    else
        move_anchor(bind, step, &pending->frame);
    tell_frame(verdict, &pending->frame, LS_BIND_STALE);
}

static void place_between(struct ls_bind *bind, uint32_t last, const struct pending *pending,
                          struct ls_bind_verdict *verdict)
{
    settle_before(bind, (int64_t)last + 1, LS_BIND_AMBIGUOUS, LS_BIND_TWO_PULSES);
    bind->suspect = true;
    tell_frame(verdict, &pending->frame, LS_BIND_TWO_PULSES);
}

static bool is_stale(const struct ls_bind *bind, const struct ls_camera_frame *frame)
{
    return bind->anchor.valid && (int64_t)(frame->frame_id - bind->anchor.frame_id) <= 0;
}

/* Can no event at @us or before still come? */
static bool events_passed(const struct ls_bind *bind, double us)
{
    if (bind->n_seen > 0 && (double)bind->steps[bind->n_seen - 1].event.us > us)
        return true;
    return (double)bind->until_us > us + bind->config.event_delay_us;
}

static bool decide_by_time(struct ls_bind *bind, const struct pending *pending,
                           struct ls_bind_verdict *verdict)
{
    double end_us = pending->mapped_us + bind->config.window_us;
    uint32_t step = 0;
    unsigned n = near(bind, pending->mapped_us, &step);
    if (n > 0 ? (double)bind->until_us < end_us : !events_passed(bind, end_us))
        return false;
    if (is_stale(bind, &pending->frame)) {
        tell_frame(verdict, &pending->frame, LS_BIND_STALE);
    } else if (n == 0) {
        bind->suspect = true;
        tell_frame(verdict, &pending->frame, LS_BIND_NO_PULSE);
    } else if (n > 1) {
        place_between(bind, step, pending, verdict);
    } else if (bind->steps[step].outcome != LS_BIND_OPEN) {
        place_late(bind, step, pending, verdict);
    } else {
        place(bind, step, pending, verdict);
    }
    return true;
}

/* The order was lost: collect, anchor on what comes, and let the step's patience end. */
static void collect(struct ls_bind *bind, const struct ls_camera_frame *frame,
                    struct ls_bind_verdict *verdict)
{
    if (bind->anchor.valid)
        bind->due -= (int64_t)(frame->frame_id - bind->anchor.frame_id);
    move_anchor(bind, bind->open == LS_BIND_NO_STEP ? bind->anchor.step : bind->open, frame);
    bind->late_seen = bind->open != LS_BIND_NO_STEP;
    tell_frame(verdict, frame, LS_BIND_SUSPECT);
}

static bool decide_by_order(struct ls_bind *bind, const struct pending *pending,
                            struct ls_bind_verdict *verdict)
{
    const struct ls_camera_frame *frame = &pending->frame;
    uint32_t step = bind->open;
    if (is_stale(bind, frame)) {
        tell_frame(verdict, frame, LS_BIND_STALE);
        return true;
    }
    if (step == LS_BIND_NO_STEP || bind->steps[step].outcome != LS_BIND_OPEN)
        bind->suspect = true;
    if (bind->suspect || !bind->anchor.valid) {
        bind->suspect = true;
        collect(bind, frame, verdict);
        return true;
    }
    if (!bind->steps[step].fired)
        return false;
    int64_t di = (int64_t)(frame->frame_id - bind->anchor.frame_id);
    uint32_t dc = frame->trigger_counter - bind->anchor.counter;
    enum ls_bind_reason reason = di != 1 || bind->due != 1 || (bind->config.has_counter && dc != 1)
                                     ? LS_BIND_IDS
                                     : check_exposure(bind, &bind->steps[step], frame);
    if (reason == LS_BIND_FINE) {
        tell_bound(bind, step, frame, 0, verdict);
    } else {
        bind->suspect = bind->due != 1;
        settle_before(bind, (int64_t)step + 1, LS_BIND_AMBIGUOUS, reason);
        tell_frame(verdict, frame, reason);
    }
    move_anchor(bind, step, frame);
    bind->due = 0;
    return true;
}

static bool decide_frame(struct ls_bind *bind, struct ls_bind_verdict *verdict)
{
    if (bind->n_frames == 0)
        return false;
    const struct pending *pending = &bind->frames[bind->first];
    bool decided = true;
    if (pending->frame.status != LS_FRAME_OK)
        tell_frame(verdict, &pending->frame, LS_BIND_LOST);
    else if (bind->config.by_time)
        decided = decide_by_time(bind, pending, verdict);
    else
        decided = decide_by_order(bind, pending, verdict);
    if (decided)
        pop_frame(bind);
    return decided;
}

static void lose_patience(struct ls_bind *bind)
{
    while (bind->n_patient < bind->n_seen) {
        const struct step *step = &bind->steps[bind->n_patient];
        uint64_t from_us = step->event.us > bind->placed_us ? step->event.us : bind->placed_us;
        bool over = (double)bind->until_us > (double)from_us + bind->config.patience_us;
        if (step->outcome == LS_BIND_OPEN && !over)
            return;
        if (bind->config.by_time)
            settle(bind, bind->n_patient, LS_BIND_MISSING, LS_BIND_NO_FRAME);
        else
            ls_bind_expire(bind, bind->n_patient);
        bind->n_patient++;
    }
}

/* Steps settled without a frame come out in order; bound ones came out with their frame. */
static bool tell_step(struct ls_bind *bind, struct ls_bind_verdict *verdict)
{
    while (bind->n_told < bind->n_steps) {
        struct step *step = &bind->steps[bind->n_told];
        if (step->outcome == LS_BIND_OPEN)
            return false;
        uint32_t index = bind->n_told++;
        if (step->told)
            continue;
        step->told = true;
        *verdict = (struct ls_bind_verdict){.step = index,
                                            .outcome = (enum ls_bind_outcome)step->outcome,
                                            .reason = (enum ls_bind_reason)step->reason,
                                            .slot = LS_BIND_NO_SLOT};
        return true;
    }
    return false;
}

bool ls_bind_next(struct ls_bind *bind, struct ls_bind_verdict *verdict)
{
    if (decide_frame(bind, verdict))
        return true;
    lose_patience(bind);
    return tell_step(bind, verdict);
}

bool ls_bind_flush(struct ls_bind *bind, struct ls_bind_verdict *verdict)
{
    if (bind->n_frames == 0)
        return false;
    tell_frame(verdict, &bind->frames[bind->first].frame, LS_BIND_STALE);
    pop_frame(bind);
    return true;
}

enum ls_bind_outcome ls_bind_outcome(const struct ls_bind *bind, uint32_t step)
{
    return (enum ls_bind_outcome)bind->steps[step].outcome;
}

uint32_t ls_bind_settled(const struct ls_bind *bind)
{
    return bind->settled;
}

uint32_t ls_bind_pending(const struct ls_bind *bind)
{
    return bind->n_frames;
}

void ls_bind_destroy(struct ls_bind *bind)
{
    if (!bind)
        return;
    free(bind->steps);
    free(bind->frames);
    free(bind);
}
