#include "daemon/take_reply.h"

static void fill_progress(Lightstage__Progress *out, const struct ls_capture_progress *in)
{
    lightstage__progress__init(out);
    out->steps_planned = in->steps_planned;
    out->steps_bound = in->steps_bound;
    out->conditions_planned = in->conditions_planned;
    out->conditions_stored = in->conditions_stored;
    out->shots_lost = in->shots_lost;
    out->shots_repaired = in->shots_repaired;
    out->frames_per_second = in->frames_per_second;
}

static void fill_drift(Lightstage__Drift *out, struct ls_drift_seen *in)
{
    lightstage__drift__init(out);
    out->change = in->drift.change;
    out->error = in->drift.error;
    out->alarm = in->alarm;
    out->text = in->text;
}

static void fill_report(Lightstage__Report *out, struct ls_capture_report *in)
{
    lightstage__report__init(out);
    out->seconds = in->seconds;
    out->frames_per_second = in->frames_per_second;
    out->residual_max_us = in->residual_max_us;
    out->residual_rms_us = in->residual_rms_us;
    out->missing_conditions = in->missing_conditions;
    out->repaired = in->repaired;
}

bool ls_take_ended(const struct ls_take_status *status)
{
    return status->state != LS_TAKE_PREPARING && status->state != LS_TAKE_RUNNING;
}

static Lightstage__TakeState state_of(enum ls_take_state state)
{
    switch (state) {
    case LS_TAKE_NONE:
        return LIGHTSTAGE__TAKE_STATE__NONE;
    case LS_TAKE_PREPARING:
        return LIGHTSTAGE__TAKE_STATE__PREPARING;
    case LS_TAKE_RUNNING:
        return LIGHTSTAGE__TAKE_STATE__RUNNING;
    case LS_TAKE_COMPLETE:
        return LIGHTSTAGE__TAKE_STATE__COMPLETE;
    case LS_TAKE_INCOMPLETE:
        return LIGHTSTAGE__TAKE_STATE__INCOMPLETE;
    case LS_TAKE_ABORTED:
        return LIGHTSTAGE__TAKE_STATE__ABORTED;
    case LS_TAKE_FAILED:
        return LIGHTSTAGE__TAKE_STATE__FAILED;
    }
    return LIGHTSTAGE__TAKE_STATE__FAILED;
}

void ls_take_reply_fill(struct ls_take_reply *reply, struct ls_take_status *status)
{
    lightstage__take_status__init(&reply->status);
    reply->status.state = state_of(status->state);
    reply->status.id = status->id;
    reply->status.token = status->token;
    reply->status.message = status->message;
    reply->status.progress = &reply->progress;
    fill_progress(&reply->progress, &status->progress);
    if (status->progress.drift.known) {
        reply->status.drift = &reply->drift;
        fill_drift(&reply->drift, &status->progress.drift);
    }
    if (!ls_take_ended(status))
        return;
    reply->status.report = &reply->report;
    fill_report(&reply->report, &status->report);
}
