#include "daemon/session_private.h"

#include "daemon/requests.h"

#include <stdio.h>
#include <string.h>

void ls_peer_describe(const struct ls_peer *peer, char *text, size_t size)
{
    if (peer->remote)
        snprintf(text, size, "certificate \"%s\"", peer->name);
    else
        snprintf(text, size, "pid %d of uid %u", peer->pid, peer->uid);
}

const struct ls_peer *ls_session_peer(const struct ls_session *session)
{
    return &session->peer;
}

bool ls_session_passes_fds(const struct ls_session *session)
{
    return ls_transport_passes_fds(session->traffic.transport);
}

struct ls_service *ls_session_service(const struct ls_session *session)
{
    return session->service;
}

bool ls_session_first_refusal(struct ls_session *session)
{
    bool first = !session->refused;
    session->refused = true;
    return first;
}

void ls_session_hold(struct ls_session *session)
{
    session->refs++;
}

void ls_session_release(struct ls_session *session)
{
    if (--session->refs > 0)
        return;
    ls_traffic_finish(&session->traffic);
    g_free(session);
}

void ls_session_close(struct ls_session *session)
{
    if (!session->open)
        return;
    session->open = false;
    ls_session_end_streams(session);
    ls_session_drop_requests(session);
    ls_traffic_close(&session->traffic);
    session->service->sessions = g_list_remove(session->service->sessions, session);
    session->service->n_sessions--;
    ls_session_release(session);
}

/* ---- out ---- */

/* (transfer full) of @chunk. */
static void reply(struct ls_session *session, uint32_t request, uint16_t type,
                  const ProtobufCMessage *body, struct ls_chunk *chunk, bool last)
{
    struct ls_diag diag = {0};
    enum ls_err err =
        ls_message_frame(type, request, last ? LS_FRAME_LAST : 0, body, chunk->payload_bytes,
                         &chunk->head, &chunk->head_bytes, &diag);
    if (!err) {
        ls_traffic_push(&session->traffic, chunk);
        return;
    }
    ls_chunk_finish(chunk);
    ls_session_error(session, request, ls_proto_error_of(LS_ERR_BUG, LS_PROTO_ABOUT_REQUEST),
                     diag.text);
}

void ls_session_reply(struct ls_session *session, uint32_t request, uint16_t type,
                      const ProtobufCMessage *body, uint8_t *payload, size_t payload_bytes,
                      bool last)
{
    struct ls_chunk chunk = {.payload = payload, .payload_bytes = payload_bytes};
    reply(session, request, type, body, &chunk, last);
}

void ls_session_reply_fd(struct ls_session *session, uint32_t request, uint16_t type,
                         const ProtobufCMessage *body, int fd)
{
    struct ls_chunk chunk = {.passes = true, .fd = fd};
    reply(session, request, type, body, &chunk, true);
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
        ls_traffic_push(&session->traffic, &chunk);
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
    ls_session_end_streams(session);
    ls_session_drop_requests(session);
    ls_session_error(session, request, number, text);
    ls_traffic_last_words(&session->traffic);
}

static void on_wrote(void *user)
{
    struct ls_session *session = user;
    ls_session_catch_up(session);
    if (session->open && ls_traffic_has_room(&session->traffic)) {
        ls_session_next_job(session);
        ls_traffic_go_on(&session->traffic);
    }
    if (session->open && session->closing && ls_traffic_waiting(&session->traffic) == 0)
        ls_session_close(session);
}

/* ---- in ---- */

static void greet(struct ls_session *session, const struct ls_frame_header *header,
                  const ProtobufCMessage *message)
{
    static char *capabilities[] = {
        (char *)"relight",   (char *)"fetch",   (char *)"resume",   (char *)"tiles",
        (char *)"credit",    (char *)"memfd",   (char *)"ring",     (char *)"roles",
        (char *)"levels",    (char *)"mono",    (char *)"factored", (char *)"events",
        (char *)"max_error", (char *)"spectra",
    };
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
    reply.role = (Lightstage__Role)session->peer.role;
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
                      ls_frame_decoder_payload(&session->traffic.decoder),
                      (size_t)header->payload_bytes);
}

static void on_frame(void *user)
{
    struct ls_session *session = user;
    const struct ls_frame_header *header = &session->traffic.decoder.header;
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
    enum ls_err err =
        ls_message_decode(header->type, ls_frame_decoder_message(&session->traffic.decoder),
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

static void on_damaged(void *user, enum ls_err err, const struct ls_diag *diag)
{
    struct ls_session *session = user;
    refuse(session, session->traffic.decoder.header.request, frame_error(err), diag->text);
}

static void on_gone(void *user)
{
    ls_session_close(user);
}

static void hold(void *user)
{
    ls_session_hold(user);
}

static void release(void *user)
{
    ls_session_release(user);
}

static const struct ls_traffic_ops traffic_ops = {on_frame, on_damaged, on_wrote,
                                                  on_gone,  hold,       release};

/* ---- life ---- */

static void close_stalled(struct ls_session *session)
{
    session->service->stalled_closed++;
    char who[96];
    ls_peer_describe(&session->peer, who, sizeof who);
    g_message("closing the connection of %s: nothing moved for %u ms", who,
              session->service->config.stall_ms);
    ls_session_close(session);
}

/* Nothing is under way in either direction, nor has been for long. */
static bool is_forgotten(const struct ls_session *session, int64_t now_us)
{
    return !session->closing && ls_session_in_flight(session) == 0 &&
           ls_traffic_waiting(&session->traffic) == 0 &&
           ls_traffic_quiet_us(&session->traffic, now_us) / 1000000 >=
               session->service->config.idle_s;
}

static void close_forgotten(struct ls_session *session)
{
    char text[96];
    snprintf(text, sizeof text,
             "nothing was asked for %u s: the connection is closed; connect again",
             session->service->config.idle_s);
    ls_session_hold(session);
    refuse(session, 0, LS_PROTO_CLOSING, text);
    ls_session_release(session);
}

void ls_session_tick(struct ls_session *session, int64_t now_us)
{
    const struct ls_server_config *config = &session->service->config;
    if (ls_traffic_stalled(&session->traffic, now_us, config->stall_ms))
        close_stalled(session);
    else if (!session->greeted && (now_us - session->traffic.begun_us) / 1000 >= config->hello_ms)
        ls_session_close(session);
    else if (session->greeted && is_forgotten(session, now_us))
        close_forgotten(session);
}

void ls_session_shutdown(struct ls_session *session)
{
    ls_session_hold(session);
    if (!session->closing)
        refuse(session, 0, LS_PROTO_CLOSING, "the daemon is shutting down");
    ls_traffic_write_now(&session->traffic);
    ls_session_close(session);
    ls_session_release(session);
}

static struct ls_session *session_create(struct ls_service *service, struct ls_transport *transport,
                                         const struct ls_peer *peer)
{
    struct ls_session *session = g_new0(struct ls_session, 1);
    session->service = service;
    session->peer = *peer;
    session->refs = 1;
    session->open = true;
    g_queue_init(&session->jobs);
    ls_traffic_init(&session->traffic, transport, service->pool, service->config.max_payload,
                    &traffic_ops, session);
    service->sessions = g_list_prepend(service->sessions, session);
    service->n_sessions++;
    return session;
}

static void turn_away(struct ls_session *session, uint32_t number, const char *text)
{
    ls_session_hold(session);
    refuse(session, 0, number, text);
    ls_traffic_write_now(&session->traffic);
    ls_session_close(session);
    ls_session_release(session);
}

static bool same_peer(const struct ls_peer *a, const struct ls_peer *b)
{
    return a->remote == b->remote && (a->remote ? strcmp(a->name, b->name) == 0 : a->uid == b->uid);
}

static unsigned connections_of(const struct ls_service *service, const struct ls_peer *peer)
{
    unsigned n = 0;
    for (const GList *l = service->sessions; l; l = l->next)
        n += same_peer(&((const struct ls_session *)l->data)->peer, peer);
    return n;
}

void ls_session_admit(struct ls_service *service, struct ls_transport *transport,
                      const struct ls_peer *peer)
{
    const struct ls_server_config *config = &service->config;
    struct ls_session *session = session_create(service, transport, peer);
    char who[96], text[192];
    ls_peer_describe(peer, who, sizeof who);
    if (peer->role == LS_ROLE_NONE) {
        ls_lines_turned_away(&service->strangers, who, "neither an operator nor a reader");
        snprintf(text, sizeof text,
                 "%s is neither an operator nor a reader of this daemon; its configuration says "
                 "who is",
                 who);
        turn_away(session, LS_PROTO_NOT_ALLOWED, text);
    } else if (service->n_sessions > config->max_connections) {
        snprintf(text, sizeof text, "%u clients are connected already, at most %u allowed",
                 config->max_connections, config->max_connections);
        turn_away(session, LS_PROTO_TOO_MANY, text);
    } else if (connections_of(service, peer) > config->max_connections_each) {
        snprintf(text, sizeof text, "%s has %u connections already, at most %u allowed", who,
                 config->max_connections_each, config->max_connections_each);
        turn_away(session, LS_PROTO_TOO_MANY, text);
    } else {
        ls_traffic_go_on(&session->traffic);
    }
}
