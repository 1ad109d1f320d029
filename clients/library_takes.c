/* Status, takes and blank. */
#include "clients/library.h"

#include <stdlib.h>
#include <string.h>

struct lightstage_take_status ls_library_take_status(const Lightstage__TakeStatus *t)
{
    struct lightstage_take_status status = {
        .state = (enum lightstage_take_state)t->state,
        .id = t->id,
        .token = t->token,
        .message = t->message,
    };
    if (t->progress) {
        status.steps_planned = t->progress->steps_planned;
        status.steps_bound = t->progress->steps_bound;
        status.conditions_planned = t->progress->conditions_planned;
        status.conditions_stored = t->progress->conditions_stored;
        status.shots_lost = t->progress->shots_lost;
        status.shots_repaired = t->progress->shots_repaired;
        status.frames_per_second = t->progress->frames_per_second;
    }
    if (t->report) {
        status.repaired = t->report->repaired;
        status.frames_per_second = t->report->frames_per_second;
        status.seconds = t->report->seconds;
        status.residual_max_us = t->report->residual_max_us;
        status.residual_rms_us = t->report->residual_rms_us;
        status.missing_conditions = t->report->missing_conditions;
    }
    if (t->drift) {
        status.drift_text = t->drift->text;
        status.drift = t->drift->change;
        status.drift_error = t->drift->error;
        status.drift_alarm = t->drift->alarm;
    }
    return status;
}

/* ---- status ---- */

/* The status and the take in it, then its cameras and where they are. */
struct status {
    struct lightstage_status status; /* first: what the caller holds */
    struct lightstage_take_status take;
};

static void fill_cameras(struct lightstage_status *status, struct lightstage_camera_status *cameras,
                         const Lightstage__StatusReply *reply)
{
    const struct lightstage_camera_status **at = (void *)(cameras + reply->n_cameras);
    for (size_t i = 0; i < reply->n_cameras; i++) {
        const Lightstage__CameraStatus *c = reply->cameras[i];
        cameras[i] = (struct lightstage_camera_status){
            .connected = c->connected,
            .packet_socket = c->packet_socket,
            .name = c->name,
            .model = c->model,
            .serial = c->serial,
            .unverified = c->unverified,
        };
        at[i] = &cameras[i];
    }
    status->n_cameras = reply->n_cameras;
    status->cameras = at;
}

static void fill_lights(struct lightstage_status *status, const Lightstage__LightsStatus *lights)
{
    status->lights_serial = status->lights_state = "";
    if (!lights)
        return;
    status->lights_connected = lights->connected;
    status->lights_serial = lights->serial;
    status->lights_state = lights->state;
    status->temperature_c = lights->temperature_c;
    status->n_faults = lights->n_faults;
    status->faults = (const char *const *)lights->faults;
    status->n_now = lights->n_now;
    status->now = (const char *const *)lights->now;
    status->missed_triggers = lights->missed_triggers;
}

static void *make_status(const struct ls_reply *reply, struct lightstage_error *error)
{
    const Lightstage__StatusReply *r = (const Lightstage__StatusReply *)reply->message;
    struct status *own = ls_library_keep(
        reply,
        sizeof *own + r->n_cameras * (sizeof(struct lightstage_camera_status) + sizeof(void *)),
        error);
    if (!own)
        return NULL;
    struct lightstage_status *s = &own->status;
    fill_lights(s, r->lights);
    fill_cameras(s, (struct lightstage_camera_status *)(own + 1), r);
    s->disk_free_bytes = r->disk_free_bytes;
    s->calibration = r->calibration;
    s->privileges = r->privileges;
    s->connections = r->connections;
    s->stalled_closed = r->stalled_closed;
    s->events_skipped = r->events_skipped;
    s->credit_waits = r->credit_waits;
    if (r->take) {
        own->take = ls_library_take_status(r->take);
        s->take = &own->take;
    }
    return own;
}

uint32_t lightstage_status(struct lightstage *stage, struct lightstage_status **out,
                           struct lightstage_error *error)
{
    Lightstage__Status body = LIGHTSTAGE__STATUS__INIT;
    return ls_library_ask(stage, LS_MESSAGE_STATUS, &body.base, NULL, 0, make_status, out, error);
}

void lightstage_status_free(struct lightstage_status *status)
{
    ls_library_release(status);
}

/* ---- takes ---- */

struct started {
    struct lightstage_started started; /* first: what the caller holds */
    struct lightstage_take_status take;
};

static void *make_started(const struct ls_reply *reply, struct lightstage_error *error)
{
    const Lightstage__TakeStartReply *r = (const Lightstage__TakeStartReply *)reply->message;
    struct started *own = ls_library_keep(reply, sizeof *own, error);
    if (!own)
        return NULL;
    own->take = (struct lightstage_take_status){.id = "", .token = "", .message = ""};
    if (r->take)
        own->take = ls_library_take_status(r->take);
    own->started = (struct lightstage_started){.already = r->already, .take = &own->take};
    return own;
}

void lightstage_started_free(struct lightstage_started *started)
{
    ls_library_release(started);
}

static uint32_t ask_start(struct lightstage *stage, uint16_t type, const ProtobufCMessage *body,
                          const char *plan, struct lightstage_started **out,
                          struct lightstage_error *error)
{
    struct lightstage_started *unwanted = NULL;
    uint32_t number = ls_library_ask(stage, type, body, plan, plan ? strlen(plan) : 0, make_started,
                                     out ? out : &unwanted, error);
    lightstage_started_free(unwanted);
    return number;
}

uint32_t lightstage_take_start(struct lightstage *stage, const char *name, const char *token,
                               const char *plan, struct lightstage_started **out,
                               struct lightstage_error *error)
{
    Lightstage__TakeStart body = LIGHTSTAGE__TAKE_START__INIT;
    body.name = (char *)name;
    body.token = (char *)token;
    return ask_start(stage, LS_MESSAGE_TAKE_START, &body.base, plan, out, error);
}

uint32_t lightstage_take_resume(struct lightstage *stage, const char *take, const char *token,
                                struct lightstage_started **out, struct lightstage_error *error)
{
    Lightstage__TakeResume body = LIGHTSTAGE__TAKE_RESUME__INIT;
    body.take = (char *)take;
    body.token = (char *)token;
    return ask_start(stage, LS_MESSAGE_TAKE_RESUME, &body.base, NULL, out, error);
}

uint32_t lightstage_take_abort_begin(struct lightstage *stage, uint32_t *request,
                                     struct lightstage_error *error)
{
    Lightstage__TakeAbort body = LIGHTSTAGE__TAKE_ABORT__INIT;
    return ls_library_begin(stage, LS_MESSAGE_TAKE_ABORT, &body.base, NULL, 0, NULL, NULL, 0,
                            request, error);
}

uint32_t lightstage_take_abort(struct lightstage *stage, struct lightstage_error *error)
{
    uint32_t request = 0;
    uint32_t number = lightstage_take_abort_begin(stage, &request, error);
    return number ? number : lightstage_wait(stage, request, error);
}

uint32_t lightstage_blank(struct lightstage *stage, struct lightstage_error *error)
{
    Lightstage__Blank body = LIGHTSTAGE__BLANK__INIT;
    return ls_library_call(stage, LS_MESSAGE_BLANK, &body.base, NULL, 0, NULL, NULL, 0, error);
}

struct progress_call {
    lightstage_on_progress *callback;
    void *user;
};

static uint32_t take_progress(const struct ls_reply *reply, void *user,
                              struct lightstage_error *error)
{
    const struct progress_call *call = user;
    const struct lightstage_take_status status =
        ls_library_take_status((const Lightstage__TakeStatus *)reply->message);
    return ls_library_stopped(call->callback(&status, call->user), error);
}

uint32_t lightstage_take_progress_begin(struct lightstage *stage, const char *token,
                                        lightstage_on_progress *callback, void *user,
                                        uint32_t *request, struct lightstage_error *error)
{
    Lightstage__TakeProgress body = LIGHTSTAGE__TAKE_PROGRESS__INIT;
    const struct progress_call call = {callback, user};
    if (token)
        body.token = (char *)token;
    return ls_library_begin(stage, LS_MESSAGE_TAKE_PROGRESS, &body.base, NULL, 0, take_progress,
                            &call, sizeof call, request, error);
}

uint32_t lightstage_take_progress(struct lightstage *stage, const char *token,
                                  lightstage_on_progress *callback, void *user,
                                  struct lightstage_error *error)
{
    uint32_t request = 0;
    uint32_t number = lightstage_take_progress_begin(stage, token, callback, user, &request, error);
    return number ? number : lightstage_wait(stage, request, error);
}

static uint32_t take_text(const struct ls_reply *reply, void *user, struct lightstage_error *error)
{
    char **out = *(char ***)user;
    char *text = malloc(reply->payload_bytes + 1);
    if (!text)
        return ls_library_fail(error, LIGHTSTAGE_NO_MEMORY, "out of memory");
    memcpy(text, reply->payload_bytes ? (const char *)reply->payload : "", reply->payload_bytes);
    text[reply->payload_bytes] = 0;
    *out = text;
    return 0;
}

uint32_t lightstage_take_show(struct lightstage *stage, const char *take, char **out,
                              struct lightstage_error *error)
{
    Lightstage__TakeShow body = LIGHTSTAGE__TAKE_SHOW__INIT;
    body.take = (char *)take;
    return ls_library_call(stage, LS_MESSAGE_TAKE_SHOW, &body.base, NULL, 0, take_text, &out,
                           sizeof out, error);
}

void lightstage_text_free(char *text)
{
    free(text);
}
