#include "daemon/bind_private.h"

#include <assert.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

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

void ls_bind_settle(struct ls_bind *bind, uint32_t step, enum ls_bind_outcome outcome,
                    enum ls_bind_reason reason)
{
    struct ls_bind_step *s = &bind->steps[step];
    if (s->outcome != LS_BIND_OPEN)
        return;
    s->outcome = (unsigned char)outcome;
    s->reason = (unsigned char)reason;
    bind->settled++;
}

void ls_bind_settle_before(struct ls_bind *bind, int64_t end, enum ls_bind_outcome outcome,
                           enum ls_bind_reason reason)
{
    for (; (int64_t)bind->n_patient < end; bind->n_patient++)
        ls_bind_settle(bind, bind->n_patient, outcome, reason);
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
    bind->anchor = (struct ls_bind_anchor){
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
        ls_bind_settle(bind, i, LS_BIND_AMBIGUOUS, LS_BIND_NO_EVENT);
    struct ls_bind_step *step = &bind->steps[event->step];
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

enum ls_err ls_bind_frame(struct ls_bind *bind, const struct ls_camera_frame *frame,
                          double mapped_us, double slack_us)
{
    if (bind->n_frames == bind->max_frames)
        return LS_ERR_FULL;
    bind->frames[(bind->first + bind->n_frames++) % bind->max_frames] =
        (struct ls_bind_undecided){.frame = *frame, .mapped_us = mapped_us, .slack_us = slack_us};
    return LS_OK;
}

static void pop_frame(struct ls_bind *bind)
{
    bind->first = (bind->first + 1) % bind->max_frames;
    bind->n_frames--;
}

void ls_bind_move_anchor(struct ls_bind *bind, int64_t step, const struct ls_camera_frame *frame)
{
    bind->anchor = (struct ls_bind_anchor){.valid = true,
                                           .step = step,
                                           .frame_id = frame->frame_id,
                                           .counter = frame->trigger_counter};
    if (bind->config.by_time)
        bind->placed_us = bind->until_us;
}

enum ls_bind_reason ls_bind_check_exposure(const struct ls_bind *bind,
                                           const struct ls_bind_step *step,
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

void ls_bind_tell_frame(struct ls_bind_verdict *verdict, const struct ls_camera_frame *frame,
                        enum ls_bind_reason reason)
{
    *verdict = (struct ls_bind_verdict){.step = LS_BIND_NO_STEP,
                                        .outcome = LS_BIND_OPEN,
                                        .reason = reason,
                                        .slot = frame->slot,
                                        .frame = *frame};
}

void ls_bind_tell_bound(struct ls_bind *bind, uint32_t step, const struct ls_camera_frame *frame,
                        double residual_us, struct ls_bind_verdict *verdict)
{
    ls_bind_settle(bind, step, LS_BIND_BOUND, LS_BIND_FINE);
    bind->steps[step].told = true;
    *verdict = (struct ls_bind_verdict){.step = step,
                                        .outcome = LS_BIND_BOUND,
                                        .slot = frame->slot,
                                        .frame = *frame,
                                        .event = bind->steps[step].event,
                                        .residual_us = residual_us};
}

bool ls_bind_is_stale(const struct ls_bind *bind, const struct ls_camera_frame *frame)
{
    return bind->anchor.valid && (int64_t)(frame->frame_id - bind->anchor.frame_id) <= 0;
}

static bool decide_frame(struct ls_bind *bind, struct ls_bind_verdict *verdict)
{
    if (bind->n_frames == 0)
        return false;
    const struct ls_bind_undecided *pending = &bind->frames[bind->first];
    bool decided = true;
    if (pending->frame.status != LS_FRAME_OK)
        ls_bind_tell_frame(verdict, &pending->frame, LS_BIND_LOST);
    else if (bind->config.by_time)
        decided = ls_bind_decide_by_time(bind, pending, verdict);
    else
        decided = ls_bind_decide_by_order(bind, pending, verdict);
    if (decided)
        pop_frame(bind);
    return decided;
}

static void lose_patience(struct ls_bind *bind)
{
    while (bind->n_patient < bind->n_seen) {
        const struct ls_bind_step *step = &bind->steps[bind->n_patient];
        uint64_t from_us = step->event.us > bind->placed_us ? step->event.us : bind->placed_us;
        bool over = (double)bind->until_us > (double)from_us + bind->config.patience_us;
        if (step->outcome == LS_BIND_OPEN && !over)
            return;
        if (bind->config.by_time)
            ls_bind_settle(bind, bind->n_patient, LS_BIND_MISSING, LS_BIND_NO_FRAME);
        else
            ls_bind_expire(bind, bind->n_patient);
        bind->n_patient++;
    }
}

/* Steps settled without a frame come out in order; bound ones came out with their frame. */
static bool tell_step(struct ls_bind *bind, struct ls_bind_verdict *verdict)
{
    while (bind->n_told < bind->n_steps) {
        struct ls_bind_step *step = &bind->steps[bind->n_told];
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
    ls_bind_tell_frame(verdict, &bind->frames[bind->first].frame, LS_BIND_STALE);
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
