#include "daemon/bind_private.h"

#include <math.h>

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
        const struct ls_bind_step *s = &bind->steps[i];
        if (!s->fired)
            continue;
        if ((double)s->event.us > end)
            break;
        *step = i;
        n++;
    }
    return n;
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
                                       const struct ls_bind_undecided *pending)
{
    const struct ls_bind_step *s = &bind->steps[step];
    if (bind->suspect)
        return LS_BIND_SUSPECT;
    if (!deltas_agree(bind, step, &pending->frame))
        return LS_BIND_IDS;
    if (fabs(pending->mapped_us - (double)s->event.us) > bind->config.tight_us + pending->slack_us)
        return LS_BIND_RESIDUAL;
    return ls_bind_check_exposure(bind, s, &pending->frame);
}

/* The frame's time is that of one step, still open. */
static void place(struct ls_bind *bind, uint32_t step, const struct ls_bind_undecided *pending,
                  struct ls_bind_verdict *verdict)
{
    enum ls_bind_reason reason = cross_check(bind, step, pending);
    if (reason == LS_BIND_FINE) {
        ls_bind_settle_before(bind, step, LS_BIND_MISSING, LS_BIND_NO_FRAME);
        ls_bind_tell_bound(bind, step, &pending->frame,
                           pending->mapped_us - (double)bind->steps[step].event.us, verdict);
    } else {
        ls_bind_settle_before(bind, (int64_t)step + 1, LS_BIND_AMBIGUOUS, reason);
        ls_bind_tell_frame(verdict, &pending->frame, reason);
    }
    bind->suspect = false;
    ls_bind_move_anchor(bind, step, &pending->frame);
}

/* A frame of a step that was settled without it: too late to be used, still good for the deltas. */
static void place_late(struct ls_bind *bind, uint32_t step, const struct ls_bind_undecided *pending,
                       struct ls_bind_verdict *verdict)
{
    bool bound = bind->steps[step].outcome == LS_BIND_BOUND;
    if (bound || bind->suspect || !deltas_agree(bind, step, &pending->frame))
        bind->suspect = true;
    else
        ls_bind_move_anchor(bind, step, &pending->frame);
    ls_bind_tell_frame(verdict, &pending->frame, LS_BIND_STALE);
}

static void place_between(struct ls_bind *bind, uint32_t last,
                          const struct ls_bind_undecided *pending, struct ls_bind_verdict *verdict)
{
    ls_bind_settle_before(bind, (int64_t)last + 1, LS_BIND_AMBIGUOUS, LS_BIND_TWO_PULSES);
    bind->suspect = true;
    ls_bind_tell_frame(verdict, &pending->frame, LS_BIND_TWO_PULSES);
}

/* Can no event at @us or before still come? */
static bool events_passed(const struct ls_bind *bind, double us)
{
    if (bind->n_seen > 0 && (double)bind->steps[bind->n_seen - 1].event.us > us)
        return true;
    return (double)bind->until_us > us + bind->config.event_delay_us;
}

bool ls_bind_decide_by_time(struct ls_bind *bind, const struct ls_bind_undecided *pending,
                            struct ls_bind_verdict *verdict)
{
    double end_us = pending->mapped_us + bind->config.window_us;
    uint32_t step = 0;
    unsigned n = near(bind, pending->mapped_us, &step);
    if (n > 0 ? (double)bind->until_us < end_us : !events_passed(bind, end_us))
        return false;
    if (ls_bind_is_stale(bind, &pending->frame)) {
        ls_bind_tell_frame(verdict, &pending->frame, LS_BIND_STALE);
    } else if (n == 0) {
        bind->suspect = true;
        ls_bind_tell_frame(verdict, &pending->frame, LS_BIND_NO_PULSE);
    } else if (n > 1) {
        place_between(bind, step, pending, verdict);
    } else if (bind->steps[step].outcome != LS_BIND_OPEN) {
        place_late(bind, step, pending, verdict);
    } else {
        place(bind, step, pending, verdict);
    }
    return true;
}
