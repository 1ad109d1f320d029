#include "daemon/requests.h"

#include "daemon/condition_job.h"
#include "daemon/fetch_job.h"
#include "daemon/live.h"
#include "daemon/metrics_reply.h"
#include "daemon/relight_job.h"
#include "daemon/rig_requests.h"
#include "daemon/take_jobs.h"
#include "daemon/take_reply.h"
#include "daemon/takedir.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static struct ls_engine *engine_of(const struct ls_call *call)
{
    return ls_session_service(call->session)->engine;
}

static void answer(const struct ls_call *call, const ProtobufCMessage *body)
{
    ls_session_reply(call->session, call->id, call->type | LS_MESSAGE_REPLY, body, NULL, 0, true);
}

static void fail(const struct ls_call *call, enum ls_err err, enum ls_proto_context about,
                 const struct ls_diag *diag)
{
    ls_session_fail(call->session, call->id, err, about, diag);
}

static void bad_argument(const struct ls_call *call, const char *text)
{
    ls_session_error(call->session, call->id, LS_PROTO_BAD_ARGUMENT, text);
}

/* ---- state of the rig ---- */

static void handle_metrics(const struct ls_call *call)
{
    struct ls_service *service = ls_session_service(call->session);
    struct ls_metrics_reply *reply = ls_metrics_reply_create(ls_engine_metrics(service->engine),
                                                             ls_engine_config(service->engine));
    reply->message.connections = service->n_sessions;
    reply->message.stalled_closed = service->stalled_closed;
    reply->message.events_skipped = service->events_skipped;
    reply->message.pictures_skipped = service->pictures_skipped;
    reply->message.credit_waits = service->credit_waits;
    reply->message.take_running = !ls_take_ended(&service->take);
    answer(call, &reply->message.base);
    ls_metrics_reply_free(reply);
}

static void fill_rig_camera(Lightstage__RigCamera *out, struct ls_config_camera *in)
{
    lightstage__rig_camera__init(out);
    out->name = in->name ? in->name : out->name;
    out->n_position_m = out->n_look_at_m = 3;
    out->position_m = in->position_m;
    out->look_at_m = in->look_at_m;
    out->focal_length_mm = in->focal_length_mm;
    out->sensor_width_mm = in->sensor_width_mm;
    out->sensor_height_mm = in->sensor_height_mm;
}

static float *rig_positions(const struct ls_config *config)
{
    float *out = malloc((size_t)config->n_lights * 3 * sizeof *out + 1);
    for (uint32_t i = 0; out && i < config->n_lights; i++)
        memcpy(out + 3 * (size_t)i, config->lights[i].position_m, 3 * sizeof *out);
    return out;
}

static void handle_rig(const struct ls_call *call)
{
    const struct ls_config *config = ls_engine_config(engine_of(call));
    struct ls_config_camera copies[LS_MAX_CAMERAS];
    Lightstage__RigCamera cameras[LS_MAX_CAMERAS], *camera_pointers[LS_MAX_CAMERAS];
    Lightstage__RigChannel channels[LS_MAX_CHANNELS], *channel_pointers[LS_MAX_CHANNELS];
    Lightstage__RigReply body = LIGHTSTAGE__RIG_REPLY__INIT;
    float *positions = rig_positions(config);
    if (!positions) {
        fail(call, LS_ERR_NOMEM, LS_PROTO_ABOUT_REQUEST, NULL);
        return;
    }
    for (uint32_t i = 0; i < config->n_channels; i++) {
        lightstage__rig_channel__init(&channels[i]);
        channels[i].name = config->channels[i].name;
        channels[i].polariser = config->channels[i].polariser;
        channel_pointers[i] = &channels[i];
    }
    for (uint32_t i = 0; i < config->n_cameras; i++) {
        copies[i] = config->cameras[i];
        fill_rig_camera(&cameras[i], &copies[i]);
        camera_pointers[i] = &cameras[i];
    }
    body.name = config->rig_name ? config->rig_name : body.name;
    body.n_lights = config->n_lights;
    body.n_channels = config->n_channels;
    body.channels = channel_pointers;
    body.n_cameras = config->n_cameras;
    body.cameras = camera_pointers;
    ls_session_reply(call->session, call->id, call->type | LS_MESSAGE_REPLY, &body.base,
                     (uint8_t *)positions, (size_t)config->n_lights * 3 * sizeof *positions, true);
}

/* ---- takes ---- */

static void handle_take_abort(const struct ls_call *call)
{
    Lightstage__TakeAbortReply body = LIGHTSTAGE__TAKE_ABORT_REPLY__INIT;
    struct ls_diag diag = {0};
    enum ls_err err = ls_engine_abort(engine_of(call), &diag);
    if (err)
        fail(call, err, LS_PROTO_ABOUT_RIG, &diag);
    else
        answer(call, &body.base);
}

static void handle_take_progress(const struct ls_call *call)
{
    const Lightstage__TakeProgress *progress = (const Lightstage__TakeProgress *)call->message;
    const struct ls_take_status *take = &ls_session_service(call->session)->take;
    if (progress->token[0] && strcmp(progress->token, take->token) != 0)
        ls_session_error(call->session, call->id, LS_PROTO_NOT_FOUND,
                         "the take of that token neither runs nor was the last one to run");
    else if (!ls_session_subscribe(call->session, call->id))
        ls_session_error(call->session, call->id, LS_PROTO_TOO_MANY,
                         "this connection follows the take already");
}

static void handle_events(const struct ls_call *call)
{
    if (!ls_session_follow_events(call->session, call->id,
                                  (const Lightstage__Events *)call->message))
        ls_session_error(call->session, call->id, LS_PROTO_TOO_MANY,
                         "this connection is told of events already");
}

static void handle_take_list(const struct ls_call *call)
{
    ls_session_run(call->session,
                   ls_take_list_job(call->id, ls_session_service(call->session)->config.storage));
}

static void handle_take_show(const struct ls_call *call)
{
    const Lightstage__TakeShow *show = (const Lightstage__TakeShow *)call->message;
    ls_session_run(
        call->session,
        ls_take_show_job(call->id, ls_session_service(call->session)->config.storage, show->take));
}

static void handle_take_verify(const struct ls_call *call)
{
    const Lightstage__TakeVerify *verify = (const Lightstage__TakeVerify *)call->message;
    const struct ls_take_status *take = &ls_session_service(call->session)->take;
    if (take->id[0] && !ls_take_ended(take) && strcmp(take->id, verify->take) == 0) {
        ls_session_error(call->session, call->id, LS_PROTO_BUSY,
                         "this take is running; verify it when it has ended");
        return;
    }
    ls_session_run(call->session,
                   ls_take_verify_job(call->id, ls_session_service(call->session)->config.storage,
                                      verify->take));
}

static void handle_take_slate(const struct ls_call *call)
{
    struct ls_job *job = NULL;
    struct ls_diag diag = {0};
    enum ls_err err = ls_take_slate_job(call->id, ls_session_service(call->session)->config.storage,
                                        (const Lightstage__TakeSlate *)call->message, &job, &diag);
    if (err)
        fail(call, err, LS_PROTO_ABOUT_REQUEST, &diag);
    else
        ls_session_run(call->session, job);
}

/* ---- pictures ---- */

/* 0: it is not counted. */
static void run_with_credit(const struct ls_call *call, struct ls_job *job, uint64_t credit)
{
    job->counts_credit = credit > 0;
    job->credit = credit;
    ls_session_run(call->session, job);
}

static void handle_fetch(const struct ls_call *call)
{
    struct ls_job *job = NULL;
    struct ls_diag diag = {0};
    const Lightstage__Fetch *fetch = (const Lightstage__Fetch *)call->message;
    const struct ls_service *service = ls_session_service(call->session);
    struct ls_tiles tiles;
    enum ls_err err =
        ls_tiles_read(fetch, call->payload, call->payload_bytes, service->stored,
                      ls_session_passes_fds(call->session) ? service->memfds : NULL, &tiles, &diag);
    if (!err)
        err = fetch->n_conditions
                  ? ls_condition_job_create(call->id, service->config.storage, fetch, &tiles, &job,
                                            &diag)
                  : ls_fetch_job_create(call->id, service->fields, fetch, &tiles, &job, &diag);
    ls_tiles_finish(&tiles);
    if (err)
        fail(call, err, LS_PROTO_ABOUT_REQUEST, &diag);
    else
        run_with_credit(call, job, fetch->credit_bytes);
}

static void handle_relight(const struct ls_call *call)
{
    const Lightstage__Relight *relight = (const Lightstage__Relight *)call->message;
    struct ls_job *job = NULL;
    struct ls_diag diag = {0};
    enum ls_err err =
        ls_relight_job_create(call->id, ls_session_service(call->session)->fields, relight,
                              call->payload, call->payload_bytes, &job, &diag);
    if (err)
        fail(call, err, LS_PROTO_ABOUT_REQUEST, &diag);
    else
        run_with_credit(call, job, relight->credit_bytes);
}

/* ---- the live view ---- */

/* The number of a channel by its name, -1 of none; false: there is no such. */
static bool find_channel(const struct ls_config *config, const char *name, int32_t *channel)
{
    *channel = -1;
    for (uint32_t i = 0; i < config->n_channels; i++)
        if (strcmp(config->channels[i].name, name) == 0)
            *channel = (int32_t)i;
    return !name[0] || *channel >= 0;
}

static void handle_preview(const struct ls_call *call)
{
    const Lightstage__Preview *in = (const Lightstage__Preview *)call->message;
    struct ls_service *service = ls_session_service(call->session);
    const struct ls_config *config = ls_engine_config(service->engine);
    struct ls_framing_wish wish = {in->camera, in->exposure_us, -1, in->level};
    struct ls_diag diag = {0};
    bool frames = in->exposure_us != 0;
    ls_live_look(service); /* who has lost the live view learns it before another gets it */
    if (in->camera >= config->n_cameras || !find_channel(config, in->channel, &wish.channel)) {
        bad_argument(call, "no such camera or channel; see rig");
        return;
    }
    if (ls_session_watches(call->session)) {
        ls_session_error(call->session, call->id, LS_PROTO_TOO_MANY,
                         "this connection looks already");
        return;
    }
    if (!frames && in->channel[0]) {
        bad_argument(call, "steady light without an exposure: expected exposure_us above 0");
        return;
    }
    enum ls_err err = frames ? ls_engine_frame(service->engine, &wish, &diag) : LS_OK;
    if (err) {
        fail(call, err, LS_PROTO_ABOUT_REQUEST, &diag);
        return;
    }
    ls_session_watch(call->session, call->id, in->camera, frames);
    ls_live_begin(service);
}

static void handle_ring(const struct ls_call *call)
{
    const Lightstage__Ring *in = (const Lightstage__Ring *)call->message;
    Lightstage__RingReply body = LIGHTSTAGE__RING_REPLY__INIT;
    struct ls_service *service = ls_session_service(call->session);
    struct ls_ring_view view;
    struct ls_diag diag = {0};
    if (in->camera >= ls_engine_config(service->engine)->n_cameras) {
        bad_argument(call, "no such camera; see rig");
        return;
    }
    enum ls_err err =
        ls_session_passes_fds(call->session)
            ? ls_preview_ring(ls_engine_preview(service->engine), in->camera, &view, &diag)
            : ls_fail(&diag, LS_ERR_UNSUPPORTED,
                      "a ring is handed over on a Unix socket only; ask for a preview");
    if (err) {
        fail(call, err, LS_PROTO_ABOUT_REQUEST, &diag);
        return;
    }
    body.take = service->take.id;
    body.slots = view.slots;
    body.stride = view.stride;
    body.payload_bytes = view.payload_bytes;
    body.index_at = view.index_at;
    body.bytes = view.bytes;
    body.width = view.width;
    body.height = view.height;
    body.pixel_format = view.pixel_format;
    ls_session_reply_fd(call->session, call->id, call->type | LS_MESSAGE_REPLY, &body.base,
                        view.fd);
}

/* ---- the rest ---- */

static void handle_credit(const struct ls_call *call)
{
    const Lightstage__Credit *credit = (const Lightstage__Credit *)call->message;
    Lightstage__CreditReply body = LIGHTSTAGE__CREDIT_REPLY__INIT;
    body.found = ls_session_credit(call->session, credit->request, credit->bytes);
    answer(call, &body.base);
}

static void handle_cancel(const struct ls_call *call)
{
    const Lightstage__Cancel *cancel = (const Lightstage__Cancel *)call->message;
    Lightstage__CancelReply body = LIGHTSTAGE__CANCEL_REPLY__INIT;
    body.found = cancel->request != 0 && ls_session_cancel(call->session, cancel->request);
    answer(call, &body.base);
}

/* ---- who may ask for what ---- */

static bool always(const struct ls_call *call)
{
    return true;
}

static bool if_slate_is_written(const struct ls_call *call)
{
    return ((const Lightstage__TakeSlate *)call->message)->write != NULL;
}

static bool if_camera_is_driven(const struct ls_call *call)
{
    return ((const Lightstage__Preview *)call->message)->exposure_us != 0;
}

static const struct {
    uint16_t type;
    void (*handle)(const struct ls_call *call);
    bool (*takes_operator)(const struct ls_call *call); /* NULL: readers may */
} handlers[] = {
    {LS_MESSAGE_STATUS, ls_handle_status, NULL},
    {LS_MESSAGE_METRICS, handle_metrics, NULL},
    {LS_MESSAGE_RIG, handle_rig, NULL},
    {LS_MESSAGE_PREFLIGHT, ls_handle_preflight, always},
    {LS_MESSAGE_TAKE_START, ls_handle_take_start, always},
    {LS_MESSAGE_TAKE_PROGRESS, handle_take_progress, NULL},
    {LS_MESSAGE_TAKE_ABORT, handle_take_abort, always},
    {LS_MESSAGE_TAKE_RESUME, ls_handle_take_resume, always},
    {LS_MESSAGE_TAKE_LIST, handle_take_list, NULL},
    {LS_MESSAGE_TAKE_SHOW, handle_take_show, NULL},
    {LS_MESSAGE_TAKE_VERIFY, handle_take_verify, NULL},
    {LS_MESSAGE_TAKE_SLATE, handle_take_slate, if_slate_is_written},
    {LS_MESSAGE_PREVIEW, handle_preview, if_camera_is_driven},
    {LS_MESSAGE_FETCH, handle_fetch, NULL},
    {LS_MESSAGE_RELIGHT, handle_relight, NULL},
    {LS_MESSAGE_BLANK, ls_handle_blank, always},
    {LS_MESSAGE_CANCEL, handle_cancel, NULL},
    {LS_MESSAGE_CREDIT, handle_credit, NULL},
    {LS_MESSAGE_RING, handle_ring, always},
    {LS_MESSAGE_EVENTS, handle_events, NULL},
};

static void turn_down(const struct ls_call *call)
{
    const struct ls_peer *peer = ls_session_peer(call->session);
    char who[96], text[192];
    ls_peer_describe(peer, who, sizeof who);
    if (ls_session_first_refusal(call->session)) /* a flood of them must not fill the log */
        g_message("%s, a reader, asked for %s", who, ls_message_name(call->type));
    snprintf(text, sizeof text, "%s is a reader here, and this %s takes an operator", who,
             ls_message_name(call->type));
    ls_session_error(call->session, call->id, LS_PROTO_NOT_ALLOWED, text);
}

void ls_request_handle(struct ls_session *session, uint16_t type, uint32_t request,
                       const ProtobufCMessage *message, const uint8_t *payload,
                       size_t payload_bytes)
{
    const struct ls_call call = {session, type, request, message, payload, payload_bytes};
    bool operates = ls_session_peer(session)->role == LS_ROLE_OPERATOR;
    for (size_t i = 0; i < G_N_ELEMENTS(handlers); i++) {
        if (handlers[i].type != type)
            continue;
        if (!operates && handlers[i].takes_operator && handlers[i].takes_operator(&call))
            turn_down(&call);
        else
            handlers[i].handle(&call);
    }
}
