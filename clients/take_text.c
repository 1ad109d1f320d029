#include "clients/take_text.h"

#include "clients/command.h"

#include <stdio.h>
#include <string.h>

const char *ls_take_state_word(Lightstage__TakeState state)
{
    switch (state) {
    case LIGHTSTAGE__TAKE_STATE__NONE:
        return "none";
    case LIGHTSTAGE__TAKE_STATE__PREPARING:
        return "preparing";
    case LIGHTSTAGE__TAKE_STATE__RUNNING:
        return "running";
    case LIGHTSTAGE__TAKE_STATE__COMPLETE:
        return "complete";
    case LIGHTSTAGE__TAKE_STATE__INCOMPLETE:
        return "incomplete";
    case LIGHTSTAGE__TAKE_STATE__ABORTED:
        return "aborted";
    case LIGHTSTAGE__TAKE_STATE__FAILED:
        return "failed";
    default:
        return "unknown";
    }
}

static void add_progress(json_t *out, const Lightstage__Progress *p)
{
    json_object_set_new(out, "steps_planned", json_integer(p->steps_planned));
    json_object_set_new(out, "steps_bound", json_integer(p->steps_bound));
    json_object_set_new(out, "conditions_planned", json_integer(p->conditions_planned));
    json_object_set_new(out, "conditions_stored", json_integer(p->conditions_stored));
    json_object_set_new(out, "shots_lost", json_integer(p->shots_lost));
    json_object_set_new(out, "shots_repaired", json_integer(p->shots_repaired));
    json_object_set_new(out, "frames_per_second", json_real(p->frames_per_second));
}

static void add_report(json_t *out, const Lightstage__Report *r)
{
    json_object_set_new(out, "take_seconds", json_real(r->seconds));
    json_object_set_new(out, "frames_per_second", json_real(r->frames_per_second));
    json_object_set_new(out, "residual_max_us", json_real(r->residual_max_us));
    json_object_set_new(out, "residual_rms_us", json_real(r->residual_rms_us));
    json_object_set_new(out, "missing_conditions", json_integer(r->missing_conditions));
    json_object_set_new(out, "repaired", json_string(r->repaired));
}

json_t *ls_take_status_json(const Lightstage__TakeStatus *status)
{
    json_t *out = json_pack("{ss ss ss ss}", "state", ls_take_state_word(status->state), "id",
                            status->id, "token", status->token, "message", status->message);
    if (out && status->progress)
        add_progress(out, status->progress);
    if (out && status->report && status->state != LIGHTSTAGE__TAKE_STATE__NONE)
        add_report(out, status->report);
    if (out && status->drift)
        json_object_set_new(out, "drift",
                            json_pack("{sf sf sb ss}", "change", status->drift->change, "error",
                                      status->drift->error, "alarm", status->drift->alarm, "text",
                                      status->drift->text));
    return out;
}

void ls_take_status_print(const Lightstage__TakeStatus *status)
{
    const Lightstage__Progress *p = status->progress;
    printf("take         %s%s%s\n", ls_take_state_word(status->state), status->id[0] ? ": " : "",
           ls_clean(status->id));
    if (status->state == LIGHTSTAGE__TAKE_STATE__NONE)
        return;
    if (p)
        printf("             %u of %u conditions stored, %u shots lost, %u shot again\n",
               p->conditions_stored, p->conditions_planned, p->shots_lost, p->shots_repaired);
    if (status->drift)
        printf("             %s\n", ls_clean(status->drift->text));
    if (status->report && status->report->repaired[0])
        printf("             repaired: %s\n", ls_clean(status->report->repaired));
    if (status->message[0] && strcmp(status->message, ls_take_state_word(status->state)) != 0)
        printf("             %s\n", ls_clean(status->message));
}
