#include "daemon/session_private.h"

#include "daemon/take_reply.h"

#include <stdlib.h>
#include <string.h>

bool ls_session_is_idle(const struct ls_session *session)
{
    return ls_traffic_waiting(&session->traffic) == 0;
}

/* ---- progress of the take ---- */

static void send_event(struct ls_session *session)
{
    struct ls_take_status status = session->service->take;
    struct ls_take_reply reply;
    bool ended = ls_take_ended(&status);
    uint32_t request = session->subscription;
    session->event_pending = false;
    if (ended)
        session->subscription = 0;
    ls_take_reply_fill(&reply, &status);
    ls_session_reply(session, request, LS_MESSAGE_TAKE_PROGRESS | LS_MESSAGE_REPLY,
                     &reply.status.base, NULL, 0, ended);
}

void ls_session_catch_up(struct ls_session *session)
{
    if (session->event_pending && ls_session_is_idle(session))
        send_event(session);
    ls_session_tell_events(session);
}

bool ls_session_subscribe(struct ls_session *session, uint32_t request)
{
    if (session->subscription)
        return false;
    session->subscription = request;
    send_event(session);
    return true;
}

void ls_session_take_event(struct ls_session *session)
{
    ls_session_events_moved(session);
    if (!session->subscription || session->closing)
        return;
    if (ls_session_is_idle(session)) {
        send_event(session);
        return;
    }
    if (session->event_pending)
        session->service->events_skipped++;
    session->event_pending = true;
}

/* ---- pictures of what cameras see ---- */

static void end_preview(struct ls_session *session)
{
    if (session->preview.frames)
        (void)ls_engine_frame_end(session->service->engine, NULL);
    session->preview.request = 0;
    session->preview.frames = false;
}

bool ls_session_watch(struct ls_session *session, uint32_t request, uint32_t camera, bool frames)
{
    if (session->preview.request)
        return false;
    session->preview.request = request;
    session->preview.camera = camera;
    session->preview.frames = frames;
    session->preview.skipped = 0;
    return true;
}

bool ls_session_watches(const struct ls_session *session)
{
    return session->preview.request != 0;
}

bool ls_session_frames(const struct ls_session *session)
{
    return session->preview.frames;
}

static bool looks_at(const struct ls_session *session, uint32_t camera)
{
    return session->preview.request && session->preview.camera == camera;
}

bool ls_session_wants_picture(const struct ls_session *session, uint32_t camera)
{
    return looks_at(session, camera) && ls_session_is_idle(session);
}

void ls_session_picture(struct ls_session *session, uint32_t camera,
                        const struct ls_preview_picture *picture)
{
    Lightstage__PreviewReply body = LIGHTSTAGE__PREVIEW_REPLY__INIT;
    size_t n = (size_t)picture->width * picture->height * 3;
    double clip[3];
    if (!looks_at(session, camera))
        return;
    uint8_t *rgb = ls_session_is_idle(session) ? malloc(n) : NULL;
    if (!rgb) {
        session->preview.skipped++;
        session->service->pictures_skipped++;
        return;
    }
    memcpy(rgb, picture->rgb, n);
    memcpy(clip, picture->figures.clip, sizeof clip);
    body.camera = camera;
    body.width = picture->width;
    body.height = picture->height;
    body.bin = picture->bin;
    body.frame_id = picture->frame_id;
    body.exposure_us = picture->exposure_us;
    body.focus = picture->figures.focus;
    body.clip = clip;
    body.n_clip = picture->figures.n_colours;
    body.skipped = session->preview.skipped;
    ls_session_reply(session, session->preview.request, LS_MESSAGE_PREVIEW | LS_MESSAGE_REPLY,
                     &body.base, rgb, n, false);
}

void ls_session_framing_ended(struct ls_session *session)
{
    struct ls_diag why = {{0}};
    uint32_t request = session->preview.request;
    enum ls_err err = ls_engine_frame_end(session->service->engine, &why);
    session->preview.frames = false;
    session->preview.request = 0;
    ls_session_fail(session, request, err ? err : LS_ERR_GONE, LS_PROTO_ABOUT_RIG, &why);
}

/* ---- their end ---- */

unsigned ls_session_streams(const struct ls_session *session)
{
    return (session->subscription != 0) + (session->preview.request != 0) +
           (session->events.request != 0);
}

static void end_subscription(struct ls_session *session)
{
    session->subscription = 0;
    session->event_pending = false;
}

void ls_session_end_streams(struct ls_session *session)
{
    end_subscription(session);
    end_preview(session);
    session->events.request = 0;
}

bool ls_session_cancel_stream(struct ls_session *session, uint32_t request)
{
    if (session->subscription == request)
        end_subscription(session);
    else if (session->preview.request == request)
        end_preview(session);
    else if (session->events.request == request)
        session->events.request = 0;
    else
        return false;
    ls_session_error(session, request, LS_PROTO_CANCELLED, "cancelled by the client");
    return true;
}
