#include "daemon/live.h"

#include "daemon/session.h"

enum { LOOK_MS = 100 };

static void look_at(struct ls_service *service, uint32_t camera)
{
    struct ls_preview *preview = ls_engine_preview(service->engine);
    const struct ls_preview_picture *picture = ls_preview_take(preview, camera);
    bool wanted = false;
    for (GList *l = service->sessions, *next; l; l = next) {
        next = l->next;
        if (picture)
            ls_session_picture(l->data, camera, picture);
    }
    for (GList *l = service->sessions; l; l = l->next)
        wanted |= ls_session_wants_picture(l->data, camera);
    if (wanted)
        ls_preview_want(preview, camera);
}

static void tell_ended(struct ls_service *service)
{
    for (GList *l = service->sessions, *next; l; l = next) {
        next = l->next;
        if (ls_session_frames(l->data) && !ls_engine_framing(service->engine))
            ls_session_framing_ended(l->data);
    }
}

void ls_live_look(struct ls_service *service)
{
    uint32_t n_cameras = ls_engine_config(service->engine)->n_cameras;
    for (uint32_t i = 0; i < n_cameras; i++)
        look_at(service, i);
    tell_ended(service);
}

static gboolean on_time(gpointer data)
{
    struct ls_service *service = data;
    bool any = false;
    ls_live_look(service);
    for (GList *l = service->sessions; l; l = l->next)
        any |= ls_session_watches(l->data);
    if (!any)
        service->looking = 0;
    return any ? G_SOURCE_CONTINUE : G_SOURCE_REMOVE;
}

void ls_live_begin(struct ls_service *service)
{
    if (!service->looking)
        service->looking = g_timeout_add(LOOK_MS, on_time, service);
}

void ls_live_end(struct ls_service *service)
{
    if (service->looking)
        g_source_remove(service->looking);
    service->looking = 0;
}
