#include "clients/take_text.h"

#include "clients/command.h"

#include <stdio.h>
#include <string.h>

const char *ls_take_state_word(enum lightstage_take_state state)
{
    switch (state) {
    case LIGHTSTAGE_TAKE_NONE:
        return "none";
    case LIGHTSTAGE_TAKE_PREPARING:
        return "preparing";
    case LIGHTSTAGE_TAKE_RUNNING:
        return "running";
    case LIGHTSTAGE_TAKE_COMPLETE:
        return "complete";
    case LIGHTSTAGE_TAKE_INCOMPLETE:
        return "incomplete";
    case LIGHTSTAGE_TAKE_ABORTED:
        return "aborted";
    case LIGHTSTAGE_TAKE_FAILED:
        return "failed";
    default:
        return "unknown";
    }
}

static void add_progress(json_t *out, const struct lightstage_take_status *s)
{
    json_object_set_new(out, "steps_planned", json_integer(s->steps_planned));
    json_object_set_new(out, "steps_bound", json_integer(s->steps_bound));
    json_object_set_new(out, "conditions_planned", json_integer(s->conditions_planned));
    json_object_set_new(out, "conditions_stored", json_integer(s->conditions_stored));
    json_object_set_new(out, "shots_lost", json_integer(s->shots_lost));
    json_object_set_new(out, "shots_repaired", json_integer(s->shots_repaired));
    json_object_set_new(out, "frames_per_second", json_real(s->frames_per_second));
}

static void add_report(json_t *out, const struct lightstage_take_status *s)
{
    json_object_set_new(out, "take_seconds", json_real(s->seconds));
    json_object_set_new(out, "residual_max_us", json_real(s->residual_max_us));
    json_object_set_new(out, "residual_rms_us", json_real(s->residual_rms_us));
    json_object_set_new(out, "missing_conditions", json_integer(s->missing_conditions));
    json_object_set_new(out, "repaired", json_string(s->repaired));
}

json_t *ls_take_status_json(const struct lightstage_take_status *status)
{
    json_t *out = json_pack("{ss ss ss ss}", "state", ls_take_state_word(status->state), "id",
                            status->id, "token", status->token, "message", status->message);
    if (out)
        add_progress(out, status);
    if (out && status->repaired && status->state != LIGHTSTAGE_TAKE_NONE)
        add_report(out, status);
    if (out && status->drift_text)
        json_object_set_new(out, "drift",
                            json_pack("{sf sf sb ss}", "change", status->drift, "error",
                                      status->drift_error, "alarm", status->drift_alarm, "text",
                                      status->drift_text));
    return out;
}

void ls_take_status_print(const struct lightstage_take_status *status)
{
    ls_say("take         %s%s%s\n", ls_take_state_word(status->state), status->id[0] ? ": " : "",
           status->id);
    if (status->state == LIGHTSTAGE_TAKE_NONE)
        return;
    printf("             %u of %u conditions stored, %u shots lost, %u shot again\n",
           status->conditions_stored, status->conditions_planned, status->shots_lost,
           status->shots_repaired);
    if (status->drift_text)
        ls_say("             %s\n", status->drift_text);
    if (status->repaired && status->repaired[0])
        ls_say("             repaired: %s\n", status->repaired);
    if (status->message[0] && strcmp(status->message, ls_take_state_word(status->state)) != 0)
        ls_say("             %s\n", status->message);
}
