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
    return status;
}

/* ---- status ---- */

struct status {
    struct lightstage_status status; /* first: what the caller holds */
    ProtobufCMessage *message;       /* all strings are its */
    struct lightstage_take_status take;
    struct lightstage_camera_status *cameras;
    const struct lightstage_camera_status **pointers;
};

void lightstage_status_free(struct lightstage_status *status)
{
    struct status *own = (struct status *)status;
    if (!own)
        return;
    ls_message_free(own->message);
    free(own->cameras);
    free(own->pointers);
    free(own);
}

static void fill_cameras(struct status *own, const Lightstage__StatusReply *reply)
{
    for (size_t i = 0; i < reply->n_cameras; i++) {
        const Lightstage__CameraStatus *c = reply->cameras[i];
        own->cameras[i] = (struct lightstage_camera_status){
            .connected = c->connected,
            .packet_socket = c->packet_socket,
            .name = c->name,
            .model = c->model,
            .serial = c->serial,
            .unverified = c->unverified,
        };
        own->pointers[i] = &own->cameras[i];
    }
    own->status.n_cameras = reply->n_cameras;
    own->status.cameras = own->pointers;
}

static void fill_status(struct status *own, const Lightstage__StatusReply *reply)
{
    struct lightstage_status *s = &own->status;
    s->lights_serial = s->lights_state = "";
    if (reply->lights) {
        s->lights_connected = reply->lights->connected;
        s->lights_serial = reply->lights->serial;
        s->lights_state = reply->lights->state;
        s->temperature_c = reply->lights->temperature_c;
        s->n_faults = reply->lights->n_faults;
        s->faults = (const char *const *)reply->lights->faults;
    }
    fill_cameras(own, reply);
    s->disk_free_bytes = reply->disk_free_bytes;
    s->calibration = reply->calibration;
    s->privileges = reply->privileges;
    if (reply->take) {
        own->take = ls_library_take_status(reply->take);
        s->take = &own->take;
    }
}

static uint32_t take_status(const struct ls_reply *reply, void *user,
                            struct lightstage_error *error)
{
    struct lightstage_status **out = *(struct lightstage_status ***)user;
    const Lightstage__StatusReply *r = (const Lightstage__StatusReply *)reply->message;
    struct status *own = calloc(1, sizeof *own);
    if (own) {
        own->cameras = calloc(r->n_cameras + 1, sizeof *own->cameras);
        own->pointers = calloc(r->n_cameras + 1, sizeof *own->pointers);
    }
    if (!own || !own->cameras || !own->pointers) {
        lightstage_status_free((struct lightstage_status *)own);
        return ls_library_fail(error, LIGHTSTAGE_NO_MEMORY, "out of memory");
    }
    fill_status(own, r);
    own->message = reply->message; /* stolen */
    ((struct ls_reply *)reply)->message = NULL;
    *out = &own->status;
    return 0;
}

uint32_t lightstage_status(struct lightstage *stage, struct lightstage_status **out,
                           struct lightstage_error *error)
{
    Lightstage__Status body = LIGHTSTAGE__STATUS__INIT;
    return ls_library_call(stage, LS_MESSAGE_STATUS, &body.base, NULL, 0, take_status, &out,
                           sizeof out, error);
}

/* ---- takes ---- */

uint32_t lightstage_take_start(struct lightstage *stage, const char *name, const char *token,
                               const char *plan, struct lightstage_error *error)
{
    Lightstage__TakeStart body = LIGHTSTAGE__TAKE_START__INIT;
    body.name = (char *)name;
    body.token = (char *)token;
    return ls_library_call(stage, LS_MESSAGE_TAKE_START, &body.base, plan, strlen(plan), NULL, NULL,
                           0, error);
}

uint32_t lightstage_take_resume(struct lightstage *stage, const char *take, const char *token,
                                struct lightstage_error *error)
{
    Lightstage__TakeResume body = LIGHTSTAGE__TAKE_RESUME__INIT;
    body.take = (char *)take;
    body.token = (char *)token;
    return ls_library_call(stage, LS_MESSAGE_TAKE_RESUME, &body.base, NULL, 0, NULL, NULL, 0,
                           error);
}

uint32_t lightstage_take_abort(struct lightstage *stage, struct lightstage_error *error)
{
    Lightstage__TakeAbort body = LIGHTSTAGE__TAKE_ABORT__INIT;
    return ls_library_call(stage, LS_MESSAGE_TAKE_ABORT, &body.base, NULL, 0, NULL, NULL, 0, error);
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
    return call->callback(&status, call->user)
               ? ls_library_fail(error, LIGHTSTAGE_CANCELLED, "cancelled by the callback")
               : 0;
}

uint32_t lightstage_take_progress(struct lightstage *stage, const char *token,
                                  lightstage_on_progress *callback, void *user,
                                  struct lightstage_error *error)
{
    Lightstage__TakeProgress body = LIGHTSTAGE__TAKE_PROGRESS__INIT;
    const struct progress_call call = {callback, user};
    if (token)
        body.token = (char *)token;
    return ls_library_call(stage, LS_MESSAGE_TAKE_PROGRESS, &body.base, NULL, 0, take_progress,
                           &call, sizeof call, error);
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
