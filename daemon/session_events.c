#include "daemon/session_private.h"

#include "daemon/take_reply.h"

#include <string.h>

enum { PICTURES_PER_FRAME = 256 }; /* of at most 150 bytes each */

struct frame {
    Lightstage__EventsReply body;
    struct ls_take_status status;
    struct ls_take_reply progress;
    char take[128];
    struct ls_event_picture pictures[PICTURES_PER_FRAME];
    Lightstage__Published published[PICTURES_PER_FRAME], *published_at[PICTURES_PER_FRAME];
    struct ls_alarm alarms[LS_ALARM_KINDS];
    Lightstage__Alarm told[LS_ALARM_KINDS], *told_at[LS_ALARM_KINDS];
};

static void add_progress(struct ls_session *session, struct frame *frame)
{
    if (!session->events.moved)
        return;
    session->events.moved = false;
    frame->status = session->service->take;
    ls_take_reply_fill(&frame->progress, &frame->status);
    frame->body.progress = &frame->progress.status;
}

static void add_pictures(struct ls_session *session, struct ls_events *events, struct frame *frame)
{
    bool missed = false;
    size_t n = ls_events_read(events, &session->events.cursor, frame->take, frame->pictures,
                              PICTURES_PER_FRAME, &missed);
    for (size_t i = 0; i < n; i++) {
        struct ls_event_picture *in = &frame->pictures[i];
        Lightstage__Published *out = frame->published_at[i] = &frame->published[i];
        lightstage__published__init(out);
        out->condition = in->condition;
        out->camera = in->camera;
        out->single_light = in->light >= 0;
        out->light = in->light >= 0 ? (uint32_t)in->light : 0;
        out->channel = in->channel;
    }
    frame->body.missed = missed;
    frame->body.n_published = n;
    frame->body.published = frame->published_at;
    if (n > 0)
        frame->body.take = frame->take;
}

static void add_alarms(struct ls_session *session, struct ls_events *events, struct frame *frame)
{
    size_t n = 0;
    for (; n < LS_ALARM_KINDS &&
           ls_events_read_alarm(events, &session->events.cursor, &frame->alarms[n]);
         n++) {
        Lightstage__Alarm *out = frame->told_at[n] = &frame->told[n];
        lightstage__alarm__init(out);
        out->kind = (Lightstage__AlarmKind)frame->alarms[n].kind;
        out->active = frame->alarms[n].active;
        out->take = frame->alarms[n].take;
        out->text = frame->alarms[n].text;
    }
    frame->body.n_alarms = n;
    frame->body.alarms = frame->told_at;
}

/* What there is to tell, in one frame; false: nothing. */
static bool send_frame(struct ls_session *session)
{
    struct ls_events *events = ls_engine_events(session->service->engine);
    g_autofree struct frame *frame = g_new(struct frame, 1);
    lightstage__events_reply__init(&frame->body);
    add_progress(session, frame);
    if (session->events.published)
        add_pictures(session, events, frame);
    if (session->events.alarms)
        add_alarms(session, events, frame);
    if (!frame->body.progress && !frame->body.n_published && !frame->body.missed &&
        !frame->body.n_alarms)
        return false;
    ls_session_reply(session, session->events.request, LS_MESSAGE_EVENTS | LS_MESSAGE_REPLY,
                     &frame->body.base, NULL, 0, false);
    return true;
}

void ls_session_tell_events(struct ls_session *session)
{
    ls_session_hold(session);
    while (session->open && !session->closing && session->events.request &&
           ls_session_is_idle(session) && send_frame(session)) {
    }
    ls_session_release(session);
}

bool ls_session_follow_events(struct ls_session *session, uint32_t request,
                              const Lightstage__Events *wish)
{
    bool all = !wish->progress && !wish->published && !wish->alarms;
    if (session->events.request)
        return false;
    memset(&session->events, 0, sizeof session->events);
    session->events.request = request;
    session->events.progress = session->events.moved = all || wish->progress;
    session->events.published = all || wish->published;
    session->events.alarms = all || wish->alarms;
    ls_session_tell_events(session);
    return true;
}

void ls_session_events_moved(struct ls_session *session)
{
    if (!session->events.request || !session->events.progress)
        return;
    session->service->events_skipped += session->events.moved;
    session->events.moved = true;
    ls_session_tell_events(session);
}
