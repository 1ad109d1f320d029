#include "daemon/session.h"

#include "daemon/requests.h"
#include "daemon/take_reply.h"
#include "proto/frame.h"

#include <errno.h>
#include <glib-unix.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

enum {
    READ_BYTES = 64 * 1024,
    OUTBOX_HIGH = 1024 * 1024, /* above: no new frames are made, nothing more is read */
    DRAIN_BYTES = 1024 * 1024, /* read and dropped before closing */
};

struct ls_session {
    struct ls_service *service;
    int fd;
    struct ls_peer peer;
    struct ls_frame_decoder decoder;
    struct ls_outbox outbox;
    guint reading, writing; /* sources, 0 = none */
    uint8_t *in;            /* READ_BYTES; [in_used, in_fill) is still to be decoded */
    size_t in_used, in_fill;
    bool greeted;
    bool closing;            /* an error is on its way out, then close */
    GQueue jobs;             /* waiting for their turn */
    struct ls_job *stepping; /* on a thread now */
    GList *pending;          /* struct ls_pending */
    bool stepping_cancelled;
    uint32_t subscription; /* request id, 0 = none */
    bool event_pending;
    struct {
        uint32_t request; /* 0 = does not look */
        uint32_t camera;
        bool frames; /* the live view is this client's */
        uint64_t skipped;
    } preview;
    int64_t read_us, wrote_us; /* last time bytes moved in, out */
    unsigned refs;             /* the connection, and the step under way */
    bool open;
};

static void session_unref(struct ls_session *session)
{
    if (--session->refs > 0)
        return;
    ls_frame_decoder_finish(&session->decoder);
    ls_outbox_finish(&session->outbox);
    g_free(session->in);
    g_free(session);
}

const struct ls_peer *ls_session_peer(const struct ls_session *session)
{
    return &session->peer;
}

struct ls_service *ls_session_service(const struct ls_session *session)
{
    return session->service;
}

static void drop_source(guint *source)
{
    if (*source)
        g_source_remove(*source);
    *source = 0;
}

static void drop_job(gpointer data)
{
    struct ls_job *job = data;
    job->ops->destroy(job);
}

/* Unread bytes at close would reach the peer as a reset, before it has read our last words. */
static void drain(int fd)
{
    char bytes[4096];
    ssize_t n;
    for (size_t total = 0; total < DRAIN_BYTES; total += (size_t)n)
        if ((n = recv(fd, bytes, sizeof bytes, MSG_DONTWAIT)) <= 0)
            return;
}

static void end_preview(struct ls_session *session)
{
    if (session->preview.frames)
        (void)ls_engine_frame_end(session->service->engine, NULL);
    session->preview.request = 0;
    session->preview.frames = false;
}

static void drop_pending(struct ls_session *session)
{
    while (session->pending) {
        struct ls_pending *pending = session->pending->data;
        ls_session_waited(session, pending);
        pending->drop(pending, false);
    }
}

void ls_session_close(struct ls_session *session)
{
    if (!session->open)
        return;
    session->open = false;
    end_preview(session);
    drop_pending(session);
    drop_source(&session->reading);
    drop_source(&session->writing);
    drain(session->fd);
    close(session->fd);
    g_queue_clear_full(&session->jobs, drop_job);
    if (session->stepping)
        ls_job_cancel(session->stepping);
    ls_outbox_finish(&session->outbox);
    session->service->sessions = g_list_remove(session->service->sessions, session);
    session->service->n_sessions--;
    session_unref(session);
}

/* ---- out ---- */

static void kick(struct ls_session *session);
static void go_on_reading(struct ls_session *session);

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

/* After a write: false when the session is done with. */
static bool after_write(struct ls_session *session)
{
    if (session->outbox.bytes == 0 && session->event_pending)
        send_event(session);
    if (session->open && session->outbox.bytes < OUTBOX_HIGH) {
        kick(session);
        go_on_reading(session);
    }
    if (session->open && session->outbox.bytes == 0 && session->closing)
        ls_session_close(session);
    return session->open;
}

static gboolean on_writable(gint fd, GIOCondition condition, gpointer data)
{
    struct ls_session *session = data;
    size_t sent = 0;
    session->refs++;
    bool on = ls_outbox_write(&session->outbox, fd, &sent) == LS_OK;
    if (!on)
        ls_session_close(session);
    if (sent > 0)
        session->wrote_us = g_get_monotonic_time();
    on = on && after_write(session);
    bool more = on && session->outbox.bytes > 0;
    if (on && !more)
        session->writing = 0;
    session_unref(session);
    return more ? G_SOURCE_CONTINUE : G_SOURCE_REMOVE;
}

static void push(struct ls_session *session, struct ls_chunk *chunk)
{
    if (!session->open) {
        ls_chunk_finish(chunk);
        return;
    }
    if (session->outbox.bytes == 0)
        session->wrote_us = g_get_monotonic_time();
    ls_outbox_push(&session->outbox, chunk);
    if (!session->writing)
        session->writing = g_unix_fd_add(session->fd, G_IO_OUT, on_writable, session);
}

void ls_session_reply(struct ls_session *session, uint32_t request, uint16_t type,
                      const ProtobufCMessage *body, uint8_t *payload, size_t payload_bytes,
                      bool last)
{
    struct ls_diag diag = {0};
    struct ls_chunk chunk = {.payload = payload, .payload_bytes = payload_bytes};
    enum ls_err err = ls_message_frame(type, request, last ? LS_FRAME_LAST : 0, body, payload_bytes,
                                       &chunk.head, &chunk.head_bytes, &diag);
    if (!err) {
        push(session, &chunk);
        return;
    }
    ls_chunk_finish(&chunk);
    ls_session_error(session, request, ls_proto_error_of(LS_ERR_BUG, LS_PROTO_ABOUT_REQUEST),
                     diag.text);
}

void ls_session_error(struct ls_session *session, uint32_t request, uint32_t number,
                      const char *text)
{
    Lightstage__Error error = LIGHTSTAGE__ERROR__INIT;
    struct ls_chunk chunk = {0};
    error.number = number;
    error.text = (char *)text;
    if (ls_message_frame(LS_MESSAGE_ERROR, request, LS_FRAME_LAST, &error.base, 0, &chunk.head,
                         &chunk.head_bytes, NULL))
        ls_session_close(session);
    else
        push(session, &chunk);
}

void ls_session_fail(struct ls_session *session, uint32_t request, enum ls_err err,
                     enum ls_proto_context about, const struct ls_diag *diag)
{
    const char *text = diag && diag->text[0] ? diag->text : ls_err_name(err);
    ls_session_error(session, request, ls_proto_error_of(err, about), text);
}

/* The stream cannot go on: say why, then close. */
static void refuse(struct ls_session *session, uint32_t request, uint32_t number, const char *text)
{
    session->closing = true;
    drop_source(&session->reading);
    g_queue_clear_full(&session->jobs, drop_job);
    session->subscription = 0;
    session->event_pending = false;
    end_preview(session);
    drop_pending(session);
    ls_session_error(session, request, number, text);
}

/* ---- jobs ---- */

static uint64_t payload_bytes(const struct ls_chunk *chunk)
{
    return ls_chunk_bytes(chunk) - chunk->head_bytes;
}

static void on_step(void *user, struct ls_job *job, struct ls_job_result *result)
{
    struct ls_session *session = user;
    session->stepping = NULL;
    if (!session->open || session->closing) {
        job->ops->destroy(job);
        session_unref(session);
        return;
    }
    bool ends = result->err || result->last;
    if (!ends)
        session->service->credit_waits += ls_job_use_credit(job, payload_bytes(&result->chunk));
    if (result->err && ls_job_cancelled(job))
        ls_session_error(session, job->request, LS_PROTO_CANCELLED, "cancelled by the client");
    else if (result->err)
        ls_session_fail(session, job->request, result->err, LS_PROTO_ABOUT_STORAGE, &result->diag);
    else if (result->chunk.head)
        push(session, &result->chunk);
    if (ends)
        job->ops->destroy(job);
    else
        g_queue_push_tail(&session->jobs, job);
    kick(session);
    session_unref(session);
}

/* One step at a time per client; the jobs of a client take turns. */
static void kick(struct ls_session *session)
{
    if (session->stepping || session->closing || !session->open ||
        session->outbox.bytes >= OUTBOX_HIGH)
        return;
    GList *next = session->jobs.head;
    while (next && !ls_job_may_send(next->data))
        next = next->next;
    if (!next)
        return;
    session->stepping = next->data;
    g_queue_delete_link(&session->jobs, next);
    session->refs++;
    ls_job_pool_step(session->service->pool, session->stepping, on_step, session);
}

static unsigned in_flight(const struct ls_session *session)
{
    return session->jobs.length + (session->stepping != NULL) + g_list_length(session->pending) +
           (session->subscription != 0) + (session->preview.request != 0);
}

static bool has_room(struct ls_session *session, uint32_t request)
{
    char text[128];
    if (in_flight(session) < session->service->config.max_requests)
        return true;
    snprintf(text, sizeof text, "%u requests are in flight on this connection, at most %u allowed",
             in_flight(session), session->service->config.max_requests);
    ls_session_error(session, request, LS_PROTO_TOO_MANY, text);
    return false;
}

void ls_session_run(struct ls_session *session, struct ls_job *job)
{
    if (!has_room(session, job->request)) {
        job->ops->destroy(job);
        return;
    }
    g_queue_push_tail(&session->jobs, job);
    kick(session);
}

bool ls_session_wait(struct ls_session *session, struct ls_pending *pending)
{
    if (!has_room(session, pending->request))
        return false;
    session->pending = g_list_prepend(session->pending, pending);
    return true;
}

void ls_session_waited(struct ls_session *session, struct ls_pending *pending)
{
    session->pending = g_list_remove(session->pending, pending);
}

static bool cancel_pending(struct ls_session *session, uint32_t request)
{
    for (GList *l = session->pending; l; l = l->next) {
        struct ls_pending *pending = l->data;
        if (pending->request != request)
            continue;
        ls_session_waited(session, pending);
        pending->drop(pending, true);
        ls_session_error(session, request, LS_PROTO_CANCELLED, "cancelled by the client");
        return true;
    }
    return false;
}

bool ls_session_cancel(struct ls_session *session, uint32_t request)
{
    if (cancel_pending(session, request))
        return true;

    if (session->subscription == request) {
        session->subscription = 0;
        session->event_pending = false;
        ls_session_error(session, request, LS_PROTO_CANCELLED, "cancelled by the client");
        return true;
    }
    if (session->preview.request == request) {
        end_preview(session);
        ls_session_error(session, request, LS_PROTO_CANCELLED, "cancelled by the client");
        return true;
    }
    if (session->stepping && session->stepping->request == request) {
        ls_job_cancel(session->stepping);
        return true;
    }
    for (GList *l = session->jobs.head; l; l = l->next) {
        struct ls_job *job = l->data;
        if (job->request != request)
            continue;
        g_queue_delete_link(&session->jobs, l);
        job->ops->destroy(job);
        ls_session_error(session, request, LS_PROTO_CANCELLED, "cancelled by the client");
        return true;
    }
    return false;
}

static struct ls_job *job_of(const struct ls_session *session, uint32_t request)
{
    if (session->stepping && session->stepping->request == request)
        return session->stepping;
    for (GList *l = session->jobs.head; l; l = l->next)
        if (((struct ls_job *)l->data)->request == request)
            return l->data;
    return NULL;
}

bool ls_session_credit(struct ls_session *session, uint32_t request, uint64_t bytes)
{
    struct ls_job *job = job_of(session, request);
    if (!job || !job->counts_credit)
        return false;
    ls_job_give_credit(job, bytes);
    kick(session);
    return true;
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
    if (!session->subscription || session->closing)
        return;
    if (session->outbox.bytes == 0) {
        send_event(session);
        return;
    }
    if (session->event_pending)
        session->service->events_skipped++;
    session->event_pending = true;
}

/* ---- pictures of what cameras see ---- */

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
    return looks_at(session, camera) && session->outbox.bytes == 0;
}

void ls_session_picture(struct ls_session *session, uint32_t camera,
                        const struct ls_preview_picture *picture)
{
    Lightstage__PreviewReply body = LIGHTSTAGE__PREVIEW_REPLY__INIT;
    size_t n = (size_t)picture->width * picture->height * 3;
    double clip[3];
    if (!looks_at(session, camera))
        return;
    uint8_t *rgb = session->outbox.bytes == 0 ? malloc(n) : NULL;
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

/* ---- in ---- */

static void greet(struct ls_session *session, const struct ls_frame_header *header,
                  const ProtobufCMessage *message)
{
    static char *capabilities[] = {(char *)"relight", (char *)"fetch", (char *)"resume",
                                   (char *)"tiles", (char *)"credit"};
    const Lightstage__Hello *hello = (const Lightstage__Hello *)message;
    Lightstage__HelloReply reply = LIGHTSTAGE__HELLO_REPLY__INIT;
    if (hello->version != LS_FRAME_VERSION) {
        char text[96];
        snprintf(text, sizeof text, "the client speaks version %u, this daemon version %d",
                 hello->version, LS_FRAME_VERSION);
        refuse(session, header->request, LS_PROTO_BAD_VERSION, text);
        return;
    }
    session->greeted = true;
    reply.version = LS_FRAME_VERSION;
    reply.server = (char *)"lightstaged " LS_VERSION;
    reply.capabilities = capabilities;
    reply.n_capabilities = G_N_ELEMENTS(capabilities);
    reply.max_message_bytes = LS_FRAME_MAX_MESSAGE;
    reply.max_payload_bytes = session->service->config.max_payload;
    reply.max_requests = session->service->config.max_requests;
    ls_session_reply(session, header->request, LS_MESSAGE_HELLO | LS_MESSAGE_REPLY, &reply.base,
                     NULL, 0, true);
}

static void dispatch(struct ls_session *session, const struct ls_frame_header *header,
                     const ProtobufCMessage *message)
{
    if (header->type == LS_MESSAGE_HELLO) {
        greet(session, header, message);
        return;
    }
    if (!session->greeted) {
        refuse(session, header->request, LS_PROTO_NO_HELLO,
               "the first message of a connection is Hello");
        return;
    }
    ls_request_handle(session, header->type, header->request, message,
                      ls_frame_decoder_payload(&session->decoder), (size_t)header->payload_bytes);
}

static void take_frame(struct ls_session *session)
{
    const struct ls_frame_header *header = &session->decoder.header;
    ProtobufCMessage *message = NULL;
    struct ls_diag diag = {0};
    if ((header->type & LS_MESSAGE_REPLY) || !ls_message_descriptor(header->type)) {
        snprintf(diag.text, sizeof diag.text, "type %#x is not a request this daemon knows",
                 header->type);
        refuse(session, header->request, LS_PROTO_UNKNOWN_TYPE, diag.text);
        return;
    }
    if (header->request == 0) {
        refuse(session, 0, LS_PROTO_BAD_FRAME, "a request has request id 0, expected 1 or more");
        return;
    }
    enum ls_err err = ls_message_decode(header->type, ls_frame_decoder_message(&session->decoder),
                                        header->message_bytes, &message, &diag);
    if (err)
        refuse(session, header->request,
               err == LS_ERR_LIMIT ? LS_PROTO_MESSAGE_TOO_BIG : LS_PROTO_BAD_MESSAGE, diag.text);
    else
        dispatch(session, header, message);
    ls_message_free(message);
}

static uint32_t frame_error(enum ls_err err)
{
    switch (err) {
    case LS_ERR_UNSUPPORTED:
        return LS_PROTO_BAD_VERSION;
    case LS_ERR_LIMIT:
        return LS_PROTO_MESSAGE_TOO_BIG;
    case LS_ERR_INVALID:
        return LS_PROTO_BAD_FRAME;
    default:
        return ls_proto_error_of(err, LS_PROTO_ABOUT_REQUEST);
    }
}

/* Decode what has been read, as far as its answers have room to wait. */
static void take_bytes(struct ls_session *session)
{
    while (session->in_used < session->in_fill && session->open && !session->closing &&
           session->outbox.bytes < OUTBOX_HIGH) {
        size_t used = 0;
        int complete = 0;
        struct ls_diag diag = {0};
        enum ls_err err =
            ls_frame_decoder_feed(&session->decoder, session->in + session->in_used,
                                  session->in_fill - session->in_used, &used, &complete, &diag);
        session->in_used += used;
        if (err) {
            refuse(session, session->decoder.header.request, frame_error(err), diag.text);
            return;
        }
        if (complete) {
            take_frame(session);
            ls_frame_decoder_next(&session->decoder);
        }
    }
    if (session->outbox.bytes >= OUTBOX_HIGH)
        drop_source(&session->reading);
}

static void take_more(struct ls_session *session)
{
    ssize_t n = recv(session->fd, session->in, READ_BYTES, MSG_DONTWAIT);
    if (n < 0 && (errno == EAGAIN || errno == EWOULDBLOCK || errno == EINTR))
        return;
    if (n <= 0) {
        ls_session_close(session);
        return;
    }
    session->in_used = 0;
    session->in_fill = (size_t)n;
    session->read_us = g_get_monotonic_time();
    take_bytes(session);
}

/* One read per turn of the loop, so that every client has its turn. */
static gboolean on_readable(gint fd, GIOCondition condition, gpointer data)
{
    struct ls_session *session = data;
    session->refs++;
    take_more(session);
    bool on = session->reading != 0;
    session_unref(session);
    return on ? G_SOURCE_CONTINUE : G_SOURCE_REMOVE;
}

static void go_on_reading(struct ls_session *session)
{
    take_bytes(session);
    if (session->open && !session->reading && !session->closing &&
        session->outbox.bytes < OUTBOX_HIGH)
        session->reading =
            g_unix_fd_add(session->fd, G_IO_IN | G_IO_HUP | G_IO_ERR, on_readable, session);
}

/* ---- life ---- */

static void close_stalled(struct ls_session *session)
{
    session->service->stalled_closed++;
    g_message("closing the connection of pid %d: nothing moved for %u ms", session->peer.pid,
              session->service->config.stall_ms);
    ls_session_close(session);
}

void ls_session_tick(struct ls_session *session, int64_t now_us)
{
    const struct ls_server_config *config = &session->service->config;
    int64_t read_ms = (now_us - session->read_us) / 1000;
    int64_t wrote_ms = (now_us - session->wrote_us) / 1000;
    if (session->outbox.bytes > 0 && wrote_ms >= config->stall_ms)
        close_stalled(session);
    else if (session->reading && ls_frame_decoder_inside(&session->decoder) &&
             read_ms >= config->stall_ms)
        close_stalled(session);
    else if (!session->greeted && read_ms >= config->hello_ms)
        ls_session_close(session);
}

void ls_session_shutdown(struct ls_session *session)
{
    size_t sent = 0;
    session->refs++;
    if (!session->closing)
        refuse(session, 0, LS_PROTO_CLOSING, "the daemon is shutting down");
    if (session->open && ls_outbox_write(&session->outbox, session->fd, &sent))
        g_debug("pid %d left before the daemon", session->peer.pid);
    ls_session_close(session);
    session_unref(session);
}

void ls_session_start(struct ls_service *service, int fd, const struct ls_peer *peer)
{
    struct ls_session *session = g_new0(struct ls_session, 1);
    session->service = service;
    session->fd = fd;
    session->peer = *peer;
    session->refs = 1;
    session->open = true;
    session->read_us = session->wrote_us = g_get_monotonic_time();
    session->in = g_malloc(READ_BYTES);
    ls_frame_decoder_init(&session->decoder, service->config.max_payload);
    ls_outbox_init(&session->outbox);
    g_queue_init(&session->jobs);
    service->sessions = g_list_prepend(service->sessions, session);
    service->n_sessions++;
    go_on_reading(session);
}

void ls_session_turn_away(int fd, unsigned max)
{
    Lightstage__Error error = LIGHTSTAGE__ERROR__INIT;
    char text[96];
    uint8_t *bytes = NULL;
    size_t n = 0;
    snprintf(text, sizeof text, "%u clients are connected already, at most %u allowed", max, max);
    error.number = LS_PROTO_TOO_MANY;
    error.text = text;
    if (ls_message_frame(LS_MESSAGE_ERROR, 0, LS_FRAME_LAST, &error.base, 0, &bytes, &n, NULL) ==
            LS_OK &&
        send(fd, bytes, n, MSG_DONTWAIT | MSG_NOSIGNAL) != (ssize_t)n)
        g_debug("a client left before it could be turned away");
    free(bytes);
    drain(fd);
    close(fd);
}
