#include "daemon/rig_requests.h"

#include "daemon/take_reply.h"
#include "daemon/takedir.h"

#include <string.h>

/* A client's request, while the engine has it. */
struct asked {
    struct ls_request request;
    struct ls_pending pending;
    struct ls_session *session;
    uint16_t type;
    char token[64]; /* of start and resume */
};

static struct ls_engine *engine_of(const struct ls_call *call)
{
    return ls_session_service(call->session)->engine;
}

static void drop(struct ls_pending *pending, bool cancelled)
{
    struct asked *asked = (struct asked *)((char *)pending - offsetof(struct asked, pending));
    bool harmless = asked->type == LS_MESSAGE_STATUS || asked->type == LS_MESSAGE_PREFLIGHT;
    ls_engine_withdraw(&asked->request, cancelled || harmless);
    g_free(asked);
}

/* NULL: the client has too many, and was told. */
static struct asked *ask(const struct ls_call *call, void (*done)(struct ls_request *request))
{
    struct asked *asked = g_new0(struct asked, 1);
    asked->request.done = done;
    asked->pending = (struct ls_pending){call->id, drop};
    asked->session = call->session;
    asked->type = call->type;
    if (ls_session_wait(call->session, &asked->pending))
        return asked;
    g_free(asked);
    return NULL;
}

/* It was answered: by an error, or what the caller now makes of it, and then frees. */
static bool went_well(struct asked *asked, enum ls_proto_context about)
{
    ls_session_waited(asked->session, &asked->pending);
    if (asked->request.err)
        ls_session_fail(asked->session, asked->pending.request, asked->request.err, about,
                        &asked->request.diag);
    return !asked->request.err;
}

static void reply(const struct asked *asked, const ProtobufCMessage *body)
{
    ls_session_reply(asked->session, asked->pending.request, asked->type | LS_MESSAGE_REPLY, body,
                     NULL, 0, true);
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

static void fill_cameras(Lightstage__CameraStatus *cameras, Lightstage__CameraStatus **pointers,
                         const struct ls_config *config, struct ls_devices *devices)
{
    for (uint32_t i = 0; i < config->n_cameras; i++) {
        pointers[i] = &cameras[i];
        lightstage__camera_status__init(&cameras[i]);
        cameras[i].connected = devices->cameras[i].connected;
        if (config->cameras[i].name)
            cameras[i].name = config->cameras[i].name;
        cameras[i].model = devices->cameras[i].model;
        cameras[i].serial = devices->cameras[i].serial;
        cameras[i].unverified = devices->cameras[i].unverified;
        cameras[i].packet_socket = devices->cameras[i].packet_socket;
    }
}

static void reply_status(struct asked *asked)
{
    const struct ls_service *service = ls_session_service(asked->session);
    const struct ls_config *config = ls_engine_config(service->engine);
    struct ls_engine_status *status = &asked->request.status;
    struct ls_take_reply take;
    char *faults[FAULTS], *now[NOWS];
    Lightstage__LightsStatus lights;
    Lightstage__CameraStatus cameras[LS_MAX_CAMERAS], *pointers[LS_MAX_CAMERAS];
    Lightstage__StatusReply body = LIGHTSTAGE__STATUS_REPLY__INIT;

    fill_lights(&lights, status, faults, now);
    ls_take_reply_fill(&take, &status->take);
    fill_cameras(cameras, pointers, config, &status->devices);
    body.lights = &lights;
    body.take = &take.status;
    body.n_cameras = config->n_cameras;
    body.cameras = pointers;
    body.privileges = status->privileges;
    body.disk_free_bytes = status->disk_free_bytes;
    body.calibration = status->calibration;
    body.connections = service->n_sessions;
    body.stalled_closed = service->stalled_closed;
    body.events_skipped = service->events_skipped;
    body.credit_waits = service->credit_waits;
    reply(asked, &body.base);
}

static void on_status(struct ls_request *request)
{
    struct asked *asked = (struct asked *)request;
    if (went_well(asked, LS_PROTO_ABOUT_RIG))
        reply_status(asked);
    g_free(asked);
}

void ls_handle_status(const struct ls_call *call)
{
    struct asked *asked = ask(call, on_status);
    if (asked)
        ls_engine_status(engine_of(call), &asked->request);
}

/* ---- takes ---- */

static void bad_argument(const struct ls_call *call, const char *text)
{
    ls_session_error(call->session, call->id, LS_PROTO_BAD_ARGUMENT, text);
}

/* The payload as text. (transfer full), or NULL after answering. */
static char *plan_text(const struct ls_call *call)
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

static bool token_ok(const struct ls_call *call, const char *token)
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

static void on_preflight(struct ls_request *request)
{
    struct asked *asked = (struct asked *)request;
    struct ls_preflight *found = &request->preflight;
    Lightstage__PreflightReply body = LIGHTSTAGE__PREFLIGHT_REPLY__INIT;
    body.conditions = found->conditions;
    body.steps = found->steps;
    body.shots = found->shots;
    body.seconds = found->seconds;
    body.bytes = found->bytes;
    body.disk_free_bytes = found->disk_free_bytes;
    body.dark_noise_share = found->dark_noise_share;
    body.warnings = found->warnings;
    body.energy_j = found->energy_j;
    body.peak_current_a = found->peak_current_a;
    body.led_duty = found->led_duty;
    body.bracket = (char *)found->bracket;
    if (went_well(asked, about_plan(request->err)))
        reply(asked, &body.base);
    g_free(asked);
}

void ls_handle_preflight(const struct ls_call *call)
{
    char *text = plan_text(call);
    struct asked *asked = text ? ask(call, on_preflight) : NULL;
    if (asked)
        ls_engine_preflight(engine_of(call), text, &asked->request);
    g_free(text);
}

static void reply_started(const struct asked *asked)
{
    const struct ls_service *service = ls_session_service(asked->session);
    char who[96];
    struct ls_take_status status = service->take;
    struct ls_take_reply take;
    Lightstage__TakeStartReply body = LIGHTSTAGE__TAKE_START_REPLY__INIT;
    ls_peer_describe(ls_session_peer(asked->session), who, sizeof who);
    if (!asked->request.already)
        g_message("take started by %s", who);
    ls_take_reply_fill(&take, &status);
    body.already = asked->request.already;
    if (strcmp(status.token, asked->token) == 0)
        body.take = &take.status;
    reply(asked, &body.base);
}

/* Of a take on disk all but limits is what it holds. */
static enum ls_proto_context about_take(const struct asked *asked)
{
    enum ls_err err = asked->request.err;
    bool stored = asked->type == LS_MESSAGE_TAKE_RESUME && err == LS_ERR_INVALID;
    return stored ? LS_PROTO_ABOUT_STORAGE : about_plan(err);
}

static void on_started(struct ls_request *request)
{
    struct asked *asked = (struct asked *)request;
    bool changed = asked->type == LS_MESSAGE_TAKE_RESUME && request->err == LS_ERR_MISMATCH;
    if (changed) {
        ls_session_waited(asked->session, &asked->pending);
        ls_session_error(asked->session, asked->pending.request, LS_PROTO_RIG_CHANGED,
                         request->diag.text);
    } else if (went_well(asked, about_take(asked))) {
        reply_started(asked);
    }
    g_free(asked);
}

/* Start or resume. */
static struct asked *ask_for_take(const struct ls_call *call, const char *token)
{
    struct asked *asked = token_ok(call, token) ? ask(call, on_started) : NULL;
    if (asked)
        g_strlcpy(asked->token, token, sizeof asked->token);
    return asked;
}

void ls_handle_take_start(const struct ls_call *call)
{
    const Lightstage__TakeStart *start = (const Lightstage__TakeStart *)call->message;
    if (!ls_takedir_name_ok(start->name, 64)) {
        bad_argument(call, "the name of a take: expected 1 to 64 letters, digits, - or _");
        return;
    }
    char *text = plan_text(call);
    struct asked *asked = text ? ask_for_take(call, start->token) : NULL;
    if (asked)
        ls_engine_start(engine_of(call), start->name, text, start->token, &asked->request);
    g_free(text);
}

void ls_handle_take_resume(const struct ls_call *call)
{
    const Lightstage__TakeResume *resume = (const Lightstage__TakeResume *)call->message;
    if (!ls_takedir_id_ok(resume->take)) {
        ls_session_error(call->session, call->id, LS_PROTO_NOT_FOUND,
                         "that is not the name of a take; see take list");
        return;
    }
    struct asked *asked = ask_for_take(call, resume->token);
    if (asked)
        ls_engine_resume(engine_of(call), resume->take, resume->token, &asked->request);
}

/* ---- dark ---- */

static void on_blank(struct ls_request *request)
{
    struct asked *asked = (struct asked *)request;
    Lightstage__BlankReply body = LIGHTSTAGE__BLANK_REPLY__INIT;
    if (went_well(asked, LS_PROTO_ABOUT_RIG))
        reply(asked, &body.base);
    g_free(asked);
}

void ls_handle_blank(const struct ls_call *call)
{
    struct asked *asked = ask(call, on_blank);
    if (asked)
        ls_engine_blank(engine_of(call), &asked->request);
}
