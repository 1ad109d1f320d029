/* What happens on the stage, as it does. */
#include "clients/library.h"

struct events_call {
    struct lightstage_listener listener;
    void *user;
};

static int tell_pictures(const struct events_call *call, const Lightstage__EventsReply *r)
{
    int stop = 0;
    for (size_t i = 0; i < r->n_published && !stop; i++) {
        const Lightstage__Published *p = r->published[i];
        const struct lightstage_published published = {
            .take = r->take,
            .condition = p->condition,
            .channel = p->channel,
            .camera = p->camera,
            .light = p->light,
            .single_light = p->single_light,
        };
        stop = call->listener.published(&published, call->user);
    }
    return stop;
}

static int tell_alarms(const struct events_call *call, const Lightstage__EventsReply *r)
{
    int stop = 0;
    for (size_t i = 0; i < r->n_alarms && !stop; i++) {
        const Lightstage__Alarm *a = r->alarms[i];
        const struct lightstage_alarm alarm = {
            .kind = (enum lightstage_alarm_kind)a->kind,
            .active = a->active,
            .text = a->text,
            .take = a->take,
        };
        stop = call->listener.alarm(&alarm, call->user);
    }
    return stop;
}

static uint32_t take_events(const struct ls_reply *reply, void *user,
                            struct lightstage_error *error)
{
    const Lightstage__EventsReply *r = (const Lightstage__EventsReply *)reply->message;
    const struct events_call *call = user;
    int stop = 0;
    if (r->progress && call->listener.progress) {
        const struct lightstage_take_status status = ls_library_take_status(r->progress);
        stop = call->listener.progress(&status, call->user);
    }
    if (r->missed && call->listener.missed && !stop)
        stop = call->listener.missed(call->user);
    if (call->listener.published && !stop)
        stop = tell_pictures(call, r);
    if (call->listener.alarm && !stop)
        stop = tell_alarms(call, r);
    return ls_library_stopped(stop, error);
}

uint32_t lightstage_events_begin(struct lightstage *stage,
                                 const struct lightstage_listener *listener, void *user,
                                 uint32_t *request, struct lightstage_error *error)
{
    Lightstage__Events body = LIGHTSTAGE__EVENTS__INIT;
    struct events_call call = {.user = user};
    uint32_t number = ls_library_take_in(&call.listener, sizeof call.listener, listener, error);
    if (number)
        return number;
    body.progress = call.listener.progress != NULL;
    body.published = call.listener.published != NULL || call.listener.missed != NULL;
    body.alarms = call.listener.alarm != NULL;
    if (!body.progress && !body.published && !body.alarms)
        return ls_library_fail(error, LIGHTSTAGE_BAD_ARGUMENT, "nobody listens: set a callback");
    return ls_library_begin(stage, LS_MESSAGE_EVENTS, &body.base, NULL, 0, take_events, &call,
                            sizeof call, request, error);
}

uint32_t lightstage_events(struct lightstage *stage, const struct lightstage_listener *listener,
                           void *user, struct lightstage_error *error)
{
    uint32_t request = 0;
    uint32_t number = lightstage_events_begin(stage, listener, user, &request, error);
    return number ? number : lightstage_wait(stage, request, error);
}
