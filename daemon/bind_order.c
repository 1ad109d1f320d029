#include "daemon/bind_private.h"

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

/* Without a frame, or with frames of unknown order. */
void ls_bind_expire(struct ls_bind *bind, uint32_t step)
{
    if (step >= bind->n_steps || bind->steps[step].outcome != LS_BIND_OPEN)
        return;
    if (step != bind->open) {
        bool clipped = bind->steps[step].event.flags & LS_EVENT_CLIPPED;
        ls_bind_settle(bind, step, LS_BIND_MISSING, clipped ? LS_BIND_CLIPPED : LS_BIND_NO_FRAME);
    } else if (bind->late_seen) {
        bind->suspect = bind->due != 0;
        bind->late_seen = false;
        ls_bind_settle(bind, step, LS_BIND_AMBIGUOUS, LS_BIND_SUSPECT);
    } else {
        bind->suspect = true;
        ls_bind_settle(bind, step, LS_BIND_MISSING, LS_BIND_NO_FRAME);
    }
}

/* The order was lost: collect, anchor on what comes, and let the step's patience end. */
static void collect(struct ls_bind *bind, const struct ls_camera_frame *frame,
                    struct ls_bind_verdict *verdict)
{
    if (bind->anchor.valid)
        bind->due -= (int64_t)(frame->frame_id - bind->anchor.frame_id);
    ls_bind_move_anchor(bind, bind->open == LS_BIND_NO_STEP ? bind->anchor.step : bind->open,
                        frame);
    bind->late_seen = bind->open != LS_BIND_NO_STEP;
    ls_bind_tell_frame(verdict, frame, LS_BIND_SUSPECT);
}

bool ls_bind_decide_by_order(struct ls_bind *bind, const struct ls_bind_undecided *pending,
                             struct ls_bind_verdict *verdict)
{
    const struct ls_camera_frame *frame = &pending->frame;
    uint32_t step = bind->open;
    if (ls_bind_is_stale(bind, frame)) {
        ls_bind_tell_frame(verdict, frame, LS_BIND_STALE);
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
                                     : ls_bind_check_exposure(bind, &bind->steps[step], frame);
    if (reason == LS_BIND_FINE) {
        ls_bind_tell_bound(bind, step, frame, 0, verdict);
    } else {
        bind->suspect = bind->due != 1;
        ls_bind_settle_before(bind, (int64_t)step + 1, LS_BIND_AMBIGUOUS, reason);
        ls_bind_tell_frame(verdict, frame, reason);
    }
    ls_bind_move_anchor(bind, step, frame);
    bind->due = 0;
    return true;
}
