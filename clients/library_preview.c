/* What a camera sees, as it goes. */
#include "clients/library.h"

struct preview_call {
    lightstage_on_preview *callback;
    void *user;
};

static uint32_t take_preview(const struct ls_reply *reply, void *user,
                             struct lightstage_error *error)
{
    const Lightstage__PreviewReply *r = (const Lightstage__PreviewReply *)reply->message;
    const struct preview_call *call = user;
    const struct lightstage_view view = {
        .rgb = reply->payload,
        .camera = r->camera,
        .width = r->width,
        .height = r->height,
        .bin = r->bin,
        .frame_id = r->frame_id,
        .skipped = r->skipped,
        .exposure_us = r->exposure_us,
        .focus = r->focus,
        .n_clip = r->n_clip,
        .clip = r->clip,
    };
    if (r->width > 65536 || r->height > 65536 ||
        reply->payload_bytes != (size_t)3 * r->width * r->height)
        return ls_library_fail(error, LIGHTSTAGE_STRANGE,
                               "the daemon sent pixels that do not fit the picture");
    return ls_library_stopped(call->callback(&view, call->user), error);
}

uint32_t lightstage_preview_begin(struct lightstage *stage,
                                  const struct lightstage_preview *preview,
                                  lightstage_on_preview *callback, void *user, uint32_t *request,
                                  struct lightstage_error *error)
{
    Lightstage__Preview body = LIGHTSTAGE__PREVIEW__INIT;
    struct lightstage_preview p;
    const struct preview_call call = {callback, user};
    uint32_t number = ls_library_take_in(&p, sizeof p, preview, error);
    if (number)
        return number;
    body.camera = p.camera;
    body.exposure_us = p.exposure_us;
    body.channel = (char *)(p.channel ? p.channel : "");
    body.level = p.level;
    return ls_library_begin(stage, LS_MESSAGE_PREVIEW, &body.base, NULL, 0, take_preview, &call,
                            sizeof call, request, error);
}

uint32_t lightstage_preview(struct lightstage *stage, const struct lightstage_preview *preview,
                            lightstage_on_preview *callback, void *user,
                            struct lightstage_error *error)
{
    uint32_t request = 0;
    uint32_t number = lightstage_preview_begin(stage, preview, callback, user, &request, error);
    return number ? number : lightstage_wait(stage, request, error);
}
