/* server: byte streams that are wrong, cut off, silent, too many or never read. */
#include "proto/errors.h"
#include "proto/frame.h"
#include "tests/daemon/server_verbs.h"

#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

/* Write @bytes, then read to the end of the connection: the number of the Error that came. */
static uint32_t refusal_of(int fd, const void *bytes, size_t n)
{
    struct ls_frame_decoder decoder;
    uint8_t in[4096];
    uint32_t number = 0;
    ls_frame_decoder_init(&decoder, 1024 * 1024);
    g_assert_cmpint(send(fd, bytes, n, MSG_NOSIGNAL), ==, (gssize)n);
    for (ssize_t got; (got = recv(fd, in, sizeof in, 0)) > 0;) {
        for (size_t at = 0, used; at < (size_t)got; at += used) {
            int complete;
            ProtobufCMessage *message = NULL;
            g_assert_cmpint(
                ls_frame_decoder_feed(&decoder, in + at, (size_t)got - at, &used, &complete, NULL),
                ==, LS_OK);
            if (!complete)
                continue;
            if (decoder.header.type == LS_MESSAGE_ERROR) {
                g_assert_cmpint(ls_message_decode(decoder.header.type,
                                                  ls_frame_decoder_message(&decoder),
                                                  decoder.header.message_bytes, &message, NULL),
                                ==, LS_OK);
                number = ((Lightstage__Error *)message)->number;
                g_assert_cmpstr(((Lightstage__Error *)message)->text, !=, "");
                ls_message_free(message);
            }
            ls_frame_decoder_next(&decoder);
        }
    }
    ls_frame_decoder_finish(&decoder);
    close(fd);
    return number;
}

static size_t request_bytes(uint16_t type, uint32_t request, const ProtobufCMessage *body,
                            uint64_t payload, uint8_t **out)
{
    size_t n = 0;
    g_assert_cmpint(ls_message_frame(type, request, LS_FRAME_LAST, body, payload, out, &n, NULL),
                    ==, LS_OK);
    return n;
}

static uint8_t *hello_then(const uint8_t *more, size_t n_more, size_t *n)
{
    Lightstage__Hello hello = LIGHTSTAGE__HELLO__INIT;
    uint8_t *bytes = NULL;
    hello.version = LS_FRAME_VERSION;
    *n = request_bytes(LS_MESSAGE_HELLO, 1, &hello.base, 0, &bytes);
    bytes = realloc(bytes, *n + n_more);
    memcpy(bytes + *n, more, n_more);
    *n += n_more;
    return bytes;
}

static void bad_streams_get_an_error_and_are_closed(struct stage *stage, gconstpointer data)
{
    static const struct {
        const char *what;
        size_t offset;
        uint8_t value;
        uint32_t number;
    } cases[] = {
        {"magic", 0, 'X', 100},           {"version", 4, 9, 101},
        {"unknown flag", 9, 1, 100},      {"unknown type", 7, 0x11, 102},
        {"a reply's type", 7, 0x80, 102}, {"request id 0", 12, 0, 100},
        {"long message", 18, 2, 103},     {"long payload", 30, 1, 103},
        {"reserved", 20, 1, 100},
    };
    for (size_t i = 0; i < G_N_ELEMENTS(cases); i++) {
        Lightstage__Status body = LIGHTSTAGE__STATUS__INIT;
        uint8_t *frame = NULL;
        size_t n = 0, n_frame = request_bytes(LS_MESSAGE_STATUS, 2, &body.base, 0, &frame);
        frame[cases[i].offset] = cases[i].value;
        uint8_t *bytes = hello_then(frame, n_frame, &n);
        g_test_message("%s", cases[i].what);
        g_assert_cmpuint(refusal_of(a_bare_socket(stage), bytes, n), ==, cases[i].number);
        free(bytes);
        free(frame);
    }
    wait_for_connections(stage, 0);
    still_serves(stage);
}

static void a_message_that_does_not_decode_is_refused(struct stage *stage, gconstpointer data)
{
    Lightstage__TakeShow body = LIGHTSTAGE__TAKE_SHOW__INIT;
    uint8_t *frame = NULL;
    size_t n = 0;
    body.take = (char *)"0123456789";
    size_t n_frame = request_bytes(LS_MESSAGE_TAKE_SHOW, 2, &body.base, 0, &frame);
    frame[LS_FRAME_HEADER_BYTES + 1] = 0x7f; /* a string longer than the message */
    uint8_t *bytes = hello_then(frame, n_frame, &n);
    g_assert_cmpuint(refusal_of(a_bare_socket(stage), bytes, n), ==, LS_PROTO_BAD_MESSAGE);
    free(bytes);
    free(frame);
}

static void the_first_message_must_be_hello(struct stage *stage, gconstpointer data)
{
    Lightstage__Status body = LIGHTSTAGE__STATUS__INIT;
    Lightstage__Hello hello = LIGHTSTAGE__HELLO__INIT;
    uint8_t *bytes = NULL;
    size_t n = request_bytes(LS_MESSAGE_STATUS, 1, &body.base, 0, &bytes);
    g_assert_cmpuint(refusal_of(a_bare_socket(stage), bytes, n), ==, LS_PROTO_NO_HELLO);
    free(bytes);
    hello.version = 77;
    n = request_bytes(LS_MESSAGE_HELLO, 1, &hello.base, 0, &bytes);
    g_assert_cmpuint(refusal_of(a_bare_socket(stage), bytes, n), ==, LS_PROTO_BAD_VERSION);
    free(bytes);
}

/* Leave after every possible number of bytes of a conversation that starts a take. */
static void disconnecting_anywhere_does_no_harm(struct stage *stage, gconstpointer data)
{
    Lightstage__TakeProgress body = LIGHTSTAGE__TAKE_PROGRESS__INIT;
    uint8_t *frame = NULL;
    size_t n = 0, n_frame = request_bytes(LS_MESSAGE_TAKE_PROGRESS, 2, &body.base, 40, &frame);
    frame = realloc(frame, n_frame + 40);
    memset(frame + n_frame, 'x', 40);
    uint8_t *bytes = hello_then(frame, n_frame + 40, &n);
    for (size_t cut = 0; cut <= n; cut++) {
        int fd = a_bare_socket(stage);
        g_assert_cmpint(send(fd, bytes, cut, MSG_NOSIGNAL), ==, (gssize)cut);
        close(fd);
    }
    wait_for_connections(stage, 0);
    still_serves(stage);
    free(bytes);
    free(frame);
}

static void too_many_clients_are_turned_away(struct stage *stage, gconstpointer data)
{
    struct ls_connection *clients[4];
    struct ls_connection *extra = NULL;
    struct ls_diag diag = {0};
    stage_init(stage);
    stage->limits.max_connections = G_N_ELEMENTS(clients);
    stage_open(stage);
    for (size_t i = 0; i < G_N_ELEMENTS(clients); i++)
        clients[i] = a_client(stage);
    g_assert_cmpint(ls_connection_open(stage->socket_path, &extra, &diag), ==, LS_ERR_REFUSED);
    g_assert_nonnull(strstr(diag.text, "4 clients"));
    ls_connection_close(clients[0]);
    wait_for_connections(stage, G_N_ELEMENTS(clients) - 1);
    clients[0] = a_client(stage);
    for (size_t i = 0; i < G_N_ELEMENTS(clients); i++)
        ls_connection_close(clients[i]);
}

static void silent_and_half_spoken_clients_are_closed(struct stage *stage, gconstpointer data)
{
    uint8_t byte = 'L';
    stage_init(stage);
    stage->limits.hello_ms = 50;
    stage->limits.stall_ms = 50;
    stage_open(stage);
    int silent = a_bare_socket(stage), half = a_bare_socket(stage);
    g_assert_cmpint(send(half, &byte, 1, 0), ==, 1);
    g_assert_cmpint(recv(silent, &byte, 1, 0), ==, 0); /* returns when the daemon closes */
    g_assert_cmpint(recv(half, &byte, 1, 0), ==, 0);
    close(silent);
    close(half);
}

/* The one that follows was quiet for longer when the other is hung up on. */
static void who_follows_may_be_silent_who_does_not_is_closed(struct stage *stage,
                                                             gconstpointer data)
{
    Lightstage__Events events = LIGHTSTAGE__EVENTS__INIT;
    Lightstage__Status status = LIGHTSTAGE__STATUS__INIT;
    uint32_t request;
    size_t n = 0;
    stage_init(stage);
    stage->limits.idle_s = 1;
    stage_open(stage);
    struct ls_connection *follower = a_client(stage), *library = a_client(stage);
    g_assert_cmpint(
        ls_connection_send(follower, LS_MESSAGE_EVENTS, &events.base, NULL, 0, &request, NULL), ==,
        LS_OK);
    uint8_t *bytes = hello_then((const uint8_t *)"", 0, &n);
    g_assert_cmpuint(refusal_of(a_bare_socket(stage), bytes, n), ==, LS_PROTO_CLOSING);
    wait_for_connections(stage, 1);
    g_assert_cmpuint(ask(follower, LS_MESSAGE_STATUS, &status.base, NULL, NULL), ==, 0);
    g_assert_cmpuint(ask(library, LS_MESSAGE_STATUS, &status.base, NULL, NULL), ==,
                     LS_PROTO_CLOSING);
    ls_connection_close(follower);
    ls_connection_close(library);
    free(bytes);
}

/* Bytes of an endless request until the daemon hangs up; whether it did within five seconds. */
static bool drips_until_closed(int fd)
{
    uint8_t byte = 0;
    gint64 until = g_get_monotonic_time() + 5 * G_USEC_PER_SEC;
    while (g_get_monotonic_time() < until) {
        if (send(fd, &byte, 1, MSG_NOSIGNAL) < 0)
            return true;
        g_usleep(10000); /* a fifth of what a silent client is given */
    }
    return false;
}

/* A byte now and then is no progress: it would hold a connection for hours. */
static void a_request_that_drips_is_not_waited_for(struct stage *stage, gconstpointer data)
{
    Lightstage__Preflight body = LIGHTSTAGE__PREFLIGHT__INIT;
    struct ls_frame_header endless = {.version = LS_FRAME_VERSION,
                                      .type = LS_MESSAGE_HELLO,
                                      .request = 1,
                                      .message_bytes = LS_FRAME_MAX_MESSAGE};
    uint8_t head[LS_FRAME_HEADER_BYTES], *frame = NULL;
    size_t n;
    stage_init(stage);
    stage->limits.hello_ms = 50;
    stage->limits.stall_ms = 50;
    stage_open(stage);
    int stranger = a_bare_socket(stage);
    ls_frame_put(&endless, head);
    g_assert_cmpint(send(stranger, head, sizeof head, MSG_NOSIGNAL), ==, sizeof head);
    g_assert_true(drips_until_closed(stranger));
    size_t n_frame = request_bytes(LS_MESSAGE_PREFLIGHT, 2, &body.base, 1024 * 1024, &frame);
    uint8_t *bytes = hello_then(frame, n_frame, &n);
    int greeted = a_bare_socket(stage);
    g_assert_cmpint(send(greeted, bytes, n, MSG_NOSIGNAL), ==, (gssize)n);
    g_assert_true(drips_until_closed(greeted));
    close(stranger);
    close(greeted);
    free(bytes);
    free(frame);
}

/* Asks for the rig for ever and never reads: memory stays bounded, others are served. */
static void a_client_that_never_reads_is_counted_and_closed(struct stage *stage, gconstpointer data)
{
    static struct ls_config_light many[LS_MAX_LIGHTS];
    Lightstage__Rig body = LIGHTSTAGE__RIG__INIT;
    Lightstage__Status status = LIGHTSTAGE__STATUS__INIT;
    uint8_t *frame = NULL;
    size_t n = 0;
    struct ls_reply reply;
    stage_init(stage);
    stage->config.n_lights = LS_MAX_LIGHTS; /* 48 KiB of positions per answer */
    stage->config.lights = many;
    stage->limits.stall_ms = 300;
    stage_open(stage);
    int fd = a_bare_socket(stage);
    size_t n_frame = request_bytes(LS_MESSAGE_RIG, 2, &body.base, 0, &frame);
    uint8_t *bytes = hello_then(frame, n_frame, &n);
    size_t sent = 0;
    g_assert_cmpint(send(fd, bytes, n, MSG_NOSIGNAL), ==, (gssize)n);
    for (ssize_t went; (went = send(fd, frame, n_frame, MSG_NOSIGNAL | MSG_DONTWAIT)) > 0;)
        sent += (size_t)went;
    g_assert_cmpuint(sent, >, 0);
    still_serves(stage);
    wait_for_connections(stage, 0);
    struct ls_connection *client = a_client(stage);
    g_assert_cmpuint(ask(client, LS_MESSAGE_STATUS, &status.base, NULL, &reply), ==, 0);
    g_assert_cmpuint(((const Lightstage__StatusReply *)reply.message)->stalled_closed, ==, 1);
    ls_reply_finish(&reply);
    ls_connection_close(client);
    close(fd);
    free(bytes);
    free(frame);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    ADD("bad-streams-get-an-error-and-are-closed", bad_streams_get_an_error_and_are_closed);
    ADD("a-message-that-does-not-decode-is-refused", a_message_that_does_not_decode_is_refused);
    ADD("the-first-message-must-be-hello", the_first_message_must_be_hello);
    ADD_OWN("who-follows-may-be-silent-who-does-not-is-closed",
            who_follows_may_be_silent_who_does_not_is_closed);
    ADD("disconnecting-anywhere-does-no-harm", disconnecting_anywhere_does_no_harm);
    ADD_OWN("too-many-clients-are-turned-away", too_many_clients_are_turned_away);
    ADD_OWN("silent-and-half-spoken-clients-are-closed", silent_and_half_spoken_clients_are_closed);
    ADD_OWN("a-request-that-drips-is-not-waited-for", a_request_that_drips_is_not_waited_for);
    ADD_OWN("a-client-that-never-reads-is-counted-and-closed",
            a_client_that_never_reads_is_counted_and_closed);
    return g_test_run();
}
