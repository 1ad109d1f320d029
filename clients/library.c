#include "clients/library.h"

#include "core/error.h"

#include <stdarg.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

struct ls_in_flight {
    struct ls_in_flight *next;
    uint32_t request;
    uint16_t reply_type;
    bool ended, cancelled;
    ls_on_reply *on_reply;
    void *user; /* malloc */
    struct lightstage_error error;
};

uint32_t ls_library_fail(struct lightstage_error *error, uint32_t number, const char *fmt, ...)
{
    va_list args;
    if (!error)
        return number;
    error->number = number;
    va_start(args, fmt);
    vsnprintf(error->text, sizeof error->text, fmt, args);
    va_end(args);
    return number;
}

uint32_t ls_library_stopped(int stop, struct lightstage_error *error)
{
    return stop ? ls_library_fail(error, LIGHTSTAGE_CANCELLED, "cancelled by the callback") : 0;
}

uint32_t ls_library_number(enum ls_err err)
{
    switch (err) {
    case LS_ERR_NOT_FOUND:
    case LS_ERR_TIMEOUT:
        return LIGHTSTAGE_UNREACHABLE;
    case LS_ERR_NOMEM:
        return LIGHTSTAGE_NO_MEMORY;
    case LS_ERR_LIMIT:
        return LIGHTSTAGE_OVER_LIMIT;
    case LS_ERR_REFUSED:
        return LIGHTSTAGE_UNTRUSTED;
    case LS_ERR_INVALID:
    case LS_ERR_UNSUPPORTED:
        return LIGHTSTAGE_STRANGE;
    default:
        return LIGHTSTAGE_LOST;
    }
}

uint32_t ls_library_take_in(void *to, size_t bytes, const void *from,
                            struct lightstage_error *error)
{
    size_t size = 0;
    if (from)
        memcpy(&size, from, sizeof size);
    if (size < sizeof size || size > 65536)
        return ls_library_fail(error, LIGHTSTAGE_BAD_ARGUMENT,
                               "a struct does not begin with its size: set it to sizeof");
    for (size_t i = bytes; i < size; i++)
        if (((const char *)from)[i])
            return ls_library_fail(error, LIGHTSTAGE_UNSUPPORTED,
                                   "liblightstage %s is older than the header: it does not know "
                                   "what byte %zu of a struct asks for",
                                   LS_VERSION, i);
    memset(to, 0, bytes);
    memcpy(to, from, size < bytes ? size : bytes);
    return 0;
}

static void forget(struct lightstage *stage, struct ls_in_flight *flight)
{
    struct ls_in_flight **at = &stage->first;
    while (*at != flight)
        at = &(*at)->next;
    *at = flight->next;
    free(flight->user);
    free(flight);
}

void lightstage_close(struct lightstage *stage)
{
    if (!stage)
        return;
    while (stage->first)
        forget(stage, stage->first);
    ls_connection_close(stage->connection);
    ls_message_free(stage->hello);
    free(stage);
}

int lightstage_descriptor(const struct lightstage *stage)
{
    return ls_connection_descriptor(stage->connection);
}

size_t lightstage_in_flight(const struct lightstage *stage)
{
    size_t n = 0;
    for (const struct ls_in_flight *f = stage->first; f; f = f->next)
        n++;
    return n;
}

static struct ls_in_flight *find(const struct lightstage *stage, uint32_t request)
{
    struct ls_in_flight *f = stage->first;
    while (f && f->request != request)
        f = f->next;
    return f;
}

uint32_t ls_library_begin(struct lightstage *stage, uint16_t type, const ProtobufCMessage *body,
                          const void *payload, size_t payload_bytes, ls_on_reply *on_reply,
                          const void *user, size_t user_bytes, uint32_t *request,
                          struct lightstage_error *error)
{
    struct ls_diag diag = {0};
    if (stage->lost)
        return ls_library_fail(error, LIGHTSTAGE_LOST, "the connection to the daemon is lost");
    struct ls_in_flight *flight = calloc(1, sizeof *flight);
    void *own = user_bytes ? malloc(user_bytes) : NULL;
    enum ls_err err = !flight || (user_bytes && !own)
                          ? ls_fail(&diag, LS_ERR_NOMEM, "out of memory")
                          : ls_connection_send(stage->connection, type, body, payload,
                                               payload_bytes, request, &diag);
    if (err) {
        free(flight);
        free(own);
        return ls_library_fail(error, ls_library_number(err), "%s", diag.text);
    }
    if (own)
        memcpy(own, user, user_bytes);
    flight->user = own;
    flight->on_reply = on_reply;
    flight->request = *request;
    flight->reply_type = type | LS_MESSAGE_REPLY;
    flight->next = stage->first;
    stage->first = flight;
    return 0;
}

uint32_t ls_library_tell(struct lightstage *stage, uint16_t type, const ProtobufCMessage *body,
                         struct lightstage_error *error)
{
    struct ls_diag diag = {0};
    uint32_t request = 0;
    if (stage->lost)
        return ls_library_fail(error, LIGHTSTAGE_LOST, "the connection to the daemon is lost");
    enum ls_err err = ls_connection_send(stage->connection, type, body, NULL, 0, &request, &diag);
    return err ? ls_library_fail(error, ls_library_number(err), "%s", diag.text) : 0;
}

static uint32_t send_cancel(struct lightstage *stage, struct ls_in_flight *flight,
                            struct lightstage_error *error)
{
    Lightstage__Cancel body = LIGHTSTAGE__CANCEL__INIT;
    body.request = flight->request;
    flight->cancelled = true;
    return ls_library_tell(stage, LS_MESSAGE_CANCEL, &body.base, error);
}

uint32_t lightstage_cancel(struct lightstage *stage, uint32_t request,
                           struct lightstage_error *error)
{
    struct ls_in_flight *flight = find(stage, request);
    if (!flight)
        return ls_library_fail(error, LIGHTSTAGE_BAD_ARGUMENT, "no request %u is in flight",
                               request);
    if (flight->ended || flight->cancelled)
        return 0;
    ls_library_fail(&flight->error, LIGHTSTAGE_CANCELLED, "cancelled");
    return send_cancel(stage, flight, error);
}

/* All that is in flight ends with what ended the connection. */
static uint32_t lose(struct lightstage *stage, enum ls_err err, const struct ls_diag *diag,
                     struct lightstage_error *error)
{
    uint32_t said = err == LS_ERR_REFUSED ? ls_connection_error(stage->connection) : 0;
    uint32_t number = said ? said : ls_library_number(err);
    stage->lost = true;
    for (struct ls_in_flight *f = stage->first; f; f = f->next) {
        if (!f->ended && !f->cancelled)
            ls_library_fail(&f->error, number, "%s", diag->text);
        f->ended = true;
    }
    return ls_library_fail(error, number, "%s", diag->text);
}

static void hand_out(struct lightstage *stage, struct ls_in_flight *flight,
                     const struct ls_reply *reply)
{
    uint32_t number = 0;
    if (reply->type != flight->reply_type)
        number = ls_library_fail(&flight->error, LIGHTSTAGE_STRANGE,
                                 "the daemon answered with another kind of message");
    else if (flight->on_reply && !flight->cancelled)
        number = flight->on_reply(reply, flight->user, &flight->error);
    if (number && !reply->last && !flight->cancelled)
        (void)send_cancel(stage, flight, NULL); /* a lost connection shows when reading */
    flight->ended = reply->last;
}

static uint32_t one_frame(struct lightstage *stage, struct lightstage_error *error)
{
    struct ls_diag diag = {0};
    struct ls_reply reply;
    enum ls_err err;
    if (stage->lost)
        return ls_library_fail(error, LIGHTSTAGE_LOST, "the connection to the daemon is lost");
    do
        err = ls_connection_receive(stage->connection, 0, &reply, &diag);
    while (err == LS_ERR_ABORTED); /* a signal */
    if (err && !(err == LS_ERR_REFUSED && reply.request))
        return lose(stage, err, &diag, error);
    struct ls_in_flight *flight = find(stage, reply.request);
    if (err && flight) {
        if (!flight->cancelled)
            ls_library_fail(&flight->error, ls_connection_error(stage->connection), "%s",
                            diag.text);
        flight->ended = true;
    } else if (flight)
        hand_out(stage, flight, &reply);
    ls_reply_finish(&reply);
    return 0;
}

uint32_t lightstage_dispatch(struct lightstage *stage, struct lightstage_error *error)
{
    uint32_t number;
    do
        number = one_frame(stage, error);
    while (!number && ls_connection_has_bytes(stage->connection));
    return number;
}

int lightstage_has_ended(const struct lightstage *stage, uint32_t request)
{
    const struct ls_in_flight *flight = find(stage, request);
    return !flight || flight->ended;
}

uint32_t lightstage_wait(struct lightstage *stage, uint32_t request, struct lightstage_error *error)
{
    struct ls_in_flight *flight = find(stage, request);
    if (!flight)
        return ls_library_fail(error, LIGHTSTAGE_BAD_ARGUMENT, "no request %u is in flight",
                               request);
    while (!flight->ended)
        (void)one_frame(stage, NULL); /* a loss ends every request */
    while (!stage->lost && ls_connection_has_bytes(stage->connection))
        (void)one_frame(stage, NULL); /* of others: who polls would not hear of them */
    uint32_t number = flight->error.number;
    if (error)
        *error = flight->error;
    forget(stage, flight);
    return number;
}

uint32_t ls_library_call(struct lightstage *stage, uint16_t type, const ProtobufCMessage *body,
                         const void *payload, size_t payload_bytes, ls_on_reply *on_reply,
                         const void *user, size_t user_bytes, struct lightstage_error *error)
{
    uint32_t request = 0;
    uint32_t number = ls_library_begin(stage, type, body, payload, payload_bytes, on_reply, user,
                                       user_bytes, &request, error);
    return number ? number : lightstage_wait(stage, request, error);
}
