#include "daemon/requests.h"

#include "daemon/condition_job.h"
#include "daemon/fetch_job.h"
#include "daemon/live.h"
#include "daemon/metrics_reply.h"
#include "daemon/relight_job.h"
#include "daemon/take_jobs.h"
#include "daemon/take_reply.h"
#include "daemon/takedir.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* One request on its way to its answer. */
struct call {
    struct ls_session *session;
    uint16_t type;
    uint32_t id;
    const ProtobufCMessage *message;
    const uint8_t *payload;
    size_t payload_bytes;
};

static struct ls_engine *engine_of(const struct call *call)
{
    return ls_session_service(call->session)->engine;
}

static void answer(const struct call *call, const ProtobufCMessage *body)
{
    ls_session_reply(call->session, call->id, call->type | LS_MESSAGE_REPLY, body, NULL, 0, true);
}

static void fail(const struct call *call, enum ls_err err, enum ls_proto_context about,
                 const struct ls_diag *diag)
{
    ls_session_fail(call->session, call->id, err, about, diag);
}

static void bad_argument(const struct call *call, const char *text)
{
    ls_session_error(call->session, call->id, LS_PROTO_BAD_ARGUMENT, text);
}

/* ---- state of the rig ---- */

static const char *lights_state_name(enum ls_lights_state state)
{
    static const char *const names[] = {"idle", "loaded", "armed", "done", "fault"};
    return (unsigned)state < G_N_ELEMENTS(names) ? names[state] : "unknown";
}

enum { FAULTS = 8, NOWS = 4 };

static size_t fault_names(uint32_t faults, char *out[FAULTS])
{
    static const char *const names[] = {"interlock",      "e-stop",    "over-temperature",
                                        "over-current",   "over-duty", "heartbeat",
                                        "program memory", "over-power"};
    size_t n = 0;
    for (size_t i = 0; i < G_N_ELEMENTS(names); i++)
        if (faults & (1u << i))
            out[n++] = (char *)names[i];
    return n;
}

static size_t now_names(const struct ls_lights_status *lights, char *out[NOWS])
{
    size_t n = 0;
    if (lights->interlock_open)
        out[n++] = (char *)"interlock open";
    if (lights->estop_pressed)
        out[n++] = (char *)"e-stop pressed";
    if (lights->hot)
        out[n++] = (char *)"hot";
    if (lights->work_light)
        out[n++] = (char *)"work light";
    return n;
}

static void fill_lights(Lightstage__LightsStatus *out, struct ls_engine_status *status,
                        char *faults[FAULTS], char *now[NOWS])
{
    lightstage__lights_status__init(out);
    out->connected = status->devices.lights_connected;
    out->serial = status->devices.lights_serial;
    out->state = (char *)lights_state_name(status->devices.lights.state);
    out->n_faults = fault_names(status->devices.lights.faults, faults);
    out->faults = faults;
    out->n_now = now_names(&status->devices.lights, now);
    out->now = now;
    out->temperature_c = status->devices.lights.temperature_c;
    out->missed_triggers = status->devices.lights.missed_triggers;
}

static void handle_status(const struct call *call)
{
    struct ls_service *service = ls_session_service(call->session);
    const struct ls_config *config = ls_engine_config(service->engine);
    struct ls_engine_status status = {0};
    struct ls_take_reply take;
    char *faults[FAULTS], *now[NOWS];
    Lightstage__LightsStatus lights;
    Lightstage__CameraStatus cameras[LS_MAX_CAMERAS], *pointers[LS_MAX_CAMERAS];
    Lightstage__StatusReply body = LIGHTSTAGE__STATUS_REPLY__INIT;

    ls_engine_status(service->engine, &status);
    fill_lights(&lights, &status, faults, now);
    ls_take_reply_fill(&take, &status.take);
    body.lights = &lights;
    body.take = &take.status;
    for (uint32_t i = 0; i < status.n_cameras && i < LS_MAX_CAMERAS; i++) {
        pointers[body.n_cameras++] = &cameras[i];
        lightstage__camera_status__init(&cameras[i]);
        cameras[i].connected = status.devices.cameras[i].connected;
        if (i < config->n_cameras && config->cameras[i].name)
            cameras[i].name = config->cameras[i].name;
        cameras[i].model = status.devices.cameras[i].model;
        cameras[i].serial = status.devices.cameras[i].serial;
        cameras[i].unverified = status.devices.cameras[i].unverified;
        cameras[i].packet_socket = status.devices.cameras[i].packet_socket;
    }
    body.cameras = pointers;
    body.privileges = status.privileges;
    body.disk_free_bytes = status.disk_free_bytes;
    body.calibration = status.calibration;
    body.connections = service->n_sessions;
    body.stalled_closed = service->stalled_closed;
    body.events_skipped = service->events_skipped;
    answer(call, &body.base);
}

static void handle_metrics(const struct call *call)
{
    struct ls_service *service = ls_session_service(call->session);
    struct ls_metrics_reply *reply = ls_metrics_reply_create(ls_engine_metrics(service->engine),
                                                             ls_engine_config(service->engine));
    reply->message.connections = service->n_sessions;
    reply->message.stalled_closed = service->stalled_closed;
    reply->message.events_skipped = service->events_skipped;
    reply->message.pictures_skipped = service->pictures_skipped;
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

static void handle_rig(const struct call *call)
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

/* The payload as text. (transfer full), or NULL after answering. */
static char *plan_text(const struct call *call)
{
    if (call->payload_bytes == 0) {
        bad_argument(call, "the payload is empty, expected the text of a plan");
        return NULL;
    }
    if (memchr(call->payload, '\0', call->payload_bytes)) {
        bad_argument(call, "the plan holds a NUL byte, expected text");
        return NULL;
    }
    return g_strndup((const char *)call->payload, call->payload_bytes);
}

static bool token_ok(const struct call *call, const char *token)
{
    size_t n = strlen(token);
    bool ok = n >= 1 && n <= 63;
    for (size_t i = 0; i < n; i++)
        ok = ok && token[i] > ' ' && token[i] <= '~';
    if (!ok)
        bad_argument(call, "the token: expected 1 to 63 printable characters without spaces");
    return ok;
}

/* What of a plan was wrong: limits and settings are the rig's, the rest is the plan's text. */
static enum ls_proto_context about_plan(enum ls_err err)
{
    return err == LS_ERR_LIMIT || err == LS_ERR_MISMATCH ? LS_PROTO_ABOUT_RIG
                                                         : LS_PROTO_ABOUT_REQUEST;
}

static void handle_preflight(const struct call *call)
{
    struct ls_preflight found = {0};
    struct ls_diag diag = {0};
    Lightstage__PreflightReply body = LIGHTSTAGE__PREFLIGHT_REPLY__INIT;
    char *text = plan_text(call);
    if (!text)
        return;
    enum ls_err err = ls_engine_preflight(engine_of(call), text, &found, &diag);
    g_free(text);
    if (err) {
        fail(call, err, about_plan(err), &diag);
        return;
    }
    body.conditions = found.conditions;
    body.steps = found.steps;
    body.shots = found.shots;
    body.seconds = found.seconds;
    body.bytes = found.bytes;
    body.disk_free_bytes = found.disk_free_bytes;
    body.dark_noise_share = found.dark_noise_share;
    body.warnings = found.warnings;
    body.energy_j = found.energy_j;
    body.peak_current_a = found.peak_current_a;
    body.led_duty = found.led_duty;
    answer(call, &body.base);
}

/* From here to the engine's first report, the take of this token is being prepared. */
static void expect_take(struct ls_service *service, const char *token)
{
    if (strcmp(service->take.token, token) == 0 && !ls_take_ended(&service->take))
        return;
    memset(&service->take, 0, sizeof service->take);
    service->take.state = LS_TAKE_PREPARING;
    g_strlcpy(service->take.token, token, sizeof service->take.token);
}

static void answer_started(const struct call *call, const char *token, bool already)
{
    struct ls_service *service = ls_session_service(call->session);
    const struct ls_peer *peer = ls_session_peer(call->session);
    struct ls_take_status status = service->take;
    struct ls_take_reply take;
    Lightstage__TakeStartReply body = LIGHTSTAGE__TAKE_START_REPLY__INIT;
    if (!already)
        g_message("take started by uid %u, pid %d", peer->uid, peer->pid);
    ls_take_reply_fill(&take, &status);
    body.already = already;
    if (strcmp(status.token, token) == 0)
        body.take = &take.status;
    answer(call, &body.base);
}

static void handle_take_start(const struct call *call)
{
    const Lightstage__TakeStart *start = (const Lightstage__TakeStart *)call->message;
    struct ls_service *service = ls_session_service(call->session);
    struct ls_diag diag = {0};
    bool already = false;
    if (!ls_takedir_name_ok(start->name, 64)) {
        bad_argument(call, "the name of a take: expected 1 to 64 letters, digits, - or _");
        return;
    }
    char *text = token_ok(call, start->token) ? plan_text(call) : NULL;
    if (!text)
        return;
    struct ls_take_status before = service->take;
    expect_take(service, start->token);
    enum ls_err err =
        ls_engine_start(service->engine, start->name, text, start->token, &already, &diag);
    g_free(text);
    if ((err || already) && service->take.state == LS_TAKE_PREPARING && !service->take.id[0])
        service->take = before;
    if (err)
        fail(call, err, about_plan(err), &diag);
    else
        answer_started(call, start->token, already);
}

static void handle_take_resume(const struct call *call)
{
    const Lightstage__TakeResume *resume = (const Lightstage__TakeResume *)call->message;
    struct ls_service *service = ls_session_service(call->session);
    struct ls_diag diag = {0};
    if (!token_ok(call, resume->token))
        return;
    if (!ls_takedir_id_ok(resume->take)) {
        ls_session_error(call->session, call->id, LS_PROTO_NOT_FOUND,
                         "that is not the name of a take; see take list");
        return;
    }
    struct ls_take_status before = service->take;
    expect_take(service, resume->token);
    enum ls_err err = ls_engine_resume(service->engine, resume->take, resume->token, &diag);
    bool launched = service->take.id[0] != 0; /* the engine has told where it stands */
    if (!launched)
        service->take = before;
    if (err == LS_ERR_MISMATCH)
        ls_session_error(call->session, call->id, LS_PROTO_RIG_CHANGED, diag.text);
    else if (err)
        fail(call, err, about_plan(err), &diag);
    else
        answer_started(call, resume->token, !launched);
}

static void handle_take_abort(const struct call *call)
{
    Lightstage__TakeAbortReply body = LIGHTSTAGE__TAKE_ABORT_REPLY__INIT;
    struct ls_diag diag = {0};
    enum ls_err err = ls_engine_abort(engine_of(call), &diag);
    if (err)
        fail(call, err, LS_PROTO_ABOUT_RIG, &diag);
    else
        answer(call, &body.base);
}

static void handle_take_progress(const struct call *call)
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

static void handle_take_list(const struct call *call)
{
    ls_session_run(call->session,
                   ls_take_list_job(call->id, ls_session_service(call->session)->config.storage));
}

static void handle_take_show(const struct call *call)
{
    const Lightstage__TakeShow *show = (const Lightstage__TakeShow *)call->message;
    ls_session_run(
        call->session,
        ls_take_show_job(call->id, ls_session_service(call->session)->config.storage, show->take));
}

static void handle_take_verify(const struct call *call)
{
    const Lightstage__TakeVerify *verify = (const Lightstage__TakeVerify *)call->message;
    ls_session_run(call->session,
                   ls_take_verify_job(call->id, ls_session_service(call->session)->config.storage,
                                      verify->take));
}

static void handle_take_slate(const struct call *call)
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

static void handle_fetch(const struct call *call)
{
    struct ls_job *job = NULL;
    struct ls_diag diag = {0};
    const Lightstage__Fetch *fetch = (const Lightstage__Fetch *)call->message;
    const struct ls_service *service = ls_session_service(call->session);
    enum ls_err err =
        fetch->n_conditions
            ? ls_condition_job_create(call->id, service->config.storage, fetch, &job, &diag)
            : ls_fetch_job_create(call->id, service->fields, fetch, &job, &diag);
    if (err)
        fail(call, err, LS_PROTO_ABOUT_REQUEST, &diag);
    else
        ls_session_run(call->session, job);
}

static void handle_relight(const struct call *call)
{
    struct ls_job *job = NULL;
    struct ls_diag diag = {0};
    enum ls_err err = ls_relight_job_create(call->id, ls_session_service(call->session)->fields,
                                            (const Lightstage__Relight *)call->message,
                                            call->payload, call->payload_bytes, &job, &diag);
    if (err)
        fail(call, err, LS_PROTO_ABOUT_REQUEST, &diag);
    else
        ls_session_run(call->session, job);
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

static void handle_preview(const struct call *call)
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

/* ---- the rest ---- */

static void handle_blank(const struct call *call)
{
    Lightstage__BlankReply body = LIGHTSTAGE__BLANK_REPLY__INIT;
    struct ls_diag diag = {0};
    enum ls_err err = ls_engine_blank(engine_of(call), &diag);
    if (err)
        fail(call, err, LS_PROTO_ABOUT_RIG, &diag);
    else
        answer(call, &body.base);
}

static void handle_cancel(const struct call *call)
{
    const Lightstage__Cancel *cancel = (const Lightstage__Cancel *)call->message;
    Lightstage__CancelReply body = LIGHTSTAGE__CANCEL_REPLY__INIT;
    body.found = cancel->request != 0 && ls_session_cancel(call->session, cancel->request);
    answer(call, &body.base);
}

static const struct {
    uint16_t type;
    void (*handle)(const struct call *call);
} handlers[] = {
    {LS_MESSAGE_STATUS, handle_status},
    {LS_MESSAGE_METRICS, handle_metrics},
    {LS_MESSAGE_RIG, handle_rig},
    {LS_MESSAGE_PREFLIGHT, handle_preflight},
    {LS_MESSAGE_TAKE_START, handle_take_start},
    {LS_MESSAGE_TAKE_PROGRESS, handle_take_progress},
    {LS_MESSAGE_TAKE_ABORT, handle_take_abort},
    {LS_MESSAGE_TAKE_RESUME, handle_take_resume},
    {LS_MESSAGE_TAKE_LIST, handle_take_list},
    {LS_MESSAGE_TAKE_SHOW, handle_take_show},
    {LS_MESSAGE_TAKE_VERIFY, handle_take_verify},
    {LS_MESSAGE_TAKE_SLATE, handle_take_slate},
    {LS_MESSAGE_PREVIEW, handle_preview},
    {LS_MESSAGE_FETCH, handle_fetch},
    {LS_MESSAGE_RELIGHT, handle_relight},
    {LS_MESSAGE_BLANK, handle_blank},
    {LS_MESSAGE_CANCEL, handle_cancel},
};

void ls_request_handle(struct ls_session *session, uint16_t type, uint32_t request,
                       const ProtobufCMessage *message, const uint8_t *payload,
                       size_t payload_bytes)
{
    const struct call call = {session, type, request, message, payload, payload_bytes};
    for (size_t i = 0; i < G_N_ELEMENTS(handlers); i++)
        if (handlers[i].type == type)
            handlers[i].handle(&call);
}
