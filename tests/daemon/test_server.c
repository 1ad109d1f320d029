/* server: clients good, bad, slow and gone, against a fake engine. */
#include "daemon/listen.h"
#include "proto/errors.h"
#include "proto/frame.h"
#include "tests/daemon/server_fixture.h"

#include <glib/gstdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

static const char plan[] = "subject = \"still\";";

static void with_stage(struct stage *stage, gconstpointer data)
{
    stage_init(stage);
    stage_open(stage);
}

static void end_stage(struct stage *stage, gconstpointer data)
{
    stage_close(stage);
}

/* ---- verbs ---- */

/* The number the daemon refuses with; 0 = it answers. *reply may be NULL. */
static uint32_t ask(struct ls_connection *client, uint16_t type, const ProtobufCMessage *body,
                    const char *payload, struct ls_reply *reply)
{
    struct ls_reply own;
    struct ls_diag diag = {0};
    enum ls_err err =
        ls_connection_call(client, type, body, payload, payload ? strlen(payload) : 0, &own, &diag);
    if (err) {
        g_assert_cmpint(err, ==, LS_ERR_REFUSED);
        g_assert_cmpstr(diag.text, !=, "");
        return ls_connection_error(client);
    }
    if (reply)
        *reply = own;
    else
        ls_reply_finish(&own);
    return 0;
}

static uint32_t start_take(struct ls_connection *client, const char *token, bool *already)
{
    Lightstage__TakeStart body = LIGHTSTAGE__TAKE_START__INIT;
    struct ls_reply reply;
    body.name = (char *)"vase";
    body.token = (char *)token;
    uint32_t number = ask(client, LS_MESSAGE_TAKE_START, &body.base, plan, &reply);
    if (number)
        return number;
    *already = ((const Lightstage__TakeStartReply *)reply.message)->already;
    ls_reply_finish(&reply);
    return 0;
}

static uint32_t follow(struct ls_connection *client)
{
    Lightstage__TakeProgress body = LIGHTSTAGE__TAKE_PROGRESS__INIT;
    uint32_t request = 0;
    g_assert_cmpint(
        ls_connection_send(client, LS_MESSAGE_TAKE_PROGRESS, &body.base, NULL, 0, &request, NULL),
        ==, LS_OK);
    return request;
}

static Lightstage__TakeState next_state(struct ls_connection *client, uint32_t request,
                                        uint32_t *bound, bool *last)
{
    struct ls_reply reply;
    struct ls_diag diag = {0};
    enum ls_err err = ls_connection_receive(client, request, &reply, &diag);
    g_assert_cmpstr(diag.text, ==, "");
    g_assert_cmpint(err, ==, LS_OK);
    const Lightstage__TakeStatus *status = (const Lightstage__TakeStatus *)reply.message;
    Lightstage__TakeState state = status->state;
    *bound = status->progress->steps_bound;
    *last = reply.last;
    ls_reply_finish(&reply);
    return state;
}

static void still_serves(struct stage *stage)
{
    Lightstage__Status body = LIGHTSTAGE__STATUS__INIT;
    struct ls_connection *client = a_client(stage);
    g_assert_cmpuint(ask(client, LS_MESSAGE_STATUS, &body.base, NULL, NULL), ==, 0);
    ls_connection_close(client);
}

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

/* ---- conversation ---- */

static void status_and_rig_are_answered(struct stage *stage, gconstpointer data)
{
    Lightstage__Status status = LIGHTSTAGE__STATUS__INIT;
    Lightstage__Rig rig = LIGHTSTAGE__RIG__INIT;
    struct ls_connection *client = a_client(stage);
    struct ls_reply reply;
    g_assert_cmpuint(ask(client, LS_MESSAGE_STATUS, &status.base, NULL, &reply), ==, 0);
    const Lightstage__StatusReply *s = (const Lightstage__StatusReply *)reply.message;
    g_assert_cmpstr(s->lights->serial, ==, "DOME-1");
    g_assert_cmpstr(s->lights->faults[0], ==, "interlock");
    g_assert_cmpstr(s->cameras[0]->name, ==, "front");
    g_assert_cmpuint(s->connections, ==, 1);
    ls_reply_finish(&reply);
    g_assert_cmpuint(ask(client, LS_MESSAGE_RIG, &rig.base, NULL, &reply), ==, 0);
    const Lightstage__RigReply *r = (const Lightstage__RigReply *)reply.message;
    float positions[6];
    g_assert_cmpuint(r->n_lights, ==, 2);
    g_assert_cmpstr(r->channels[1]->name, ==, "R");
    g_assert_cmpuint(reply.payload_bytes, ==, sizeof positions);
    memcpy(positions, reply.payload, sizeof positions);
    g_assert_cmpfloat(positions[5], ==, 1.5f);
    ls_reply_finish(&reply);
    ls_connection_close(client);
}

static void preflight_gets_the_plans_text(struct stage *stage, gconstpointer data)
{
    Lightstage__Preflight body = LIGHTSTAGE__PREFLIGHT__INIT;
    struct ls_connection *client = a_client(stage);
    struct ls_reply reply;
    g_assert_cmpuint(ask(client, LS_MESSAGE_PREFLIGHT, &body.base, plan, &reply), ==, 0);
    g_assert_cmpuint(((const Lightstage__PreflightReply *)reply.message)->shots, ==, strlen(plan));
    ls_reply_finish(&reply);
    g_assert_cmpuint(ask(client, LS_MESSAGE_PREFLIGHT, &body.base, NULL, NULL), ==, 107);
    engine_will_answer(stage, LS_ERR_LIMIT);
    g_assert_cmpuint(ask(client, LS_MESSAGE_PREFLIGHT, &body.base, plan, NULL), ==, 303);
    engine_will_answer(stage, LS_ERR_FULL);
    g_assert_cmpuint(ask(client, LS_MESSAGE_PREFLIGHT, &body.base, plan, NULL), ==, 401);
    engine_will_answer(stage, LS_ERR_GONE);
    g_assert_cmpuint(ask(client, LS_MESSAGE_PREFLIGHT, &body.base, plan, NULL), ==, 300);
    ls_connection_close(client);
}

static void two_clients_starting_at_once_start_one_take(struct stage *stage, gconstpointer data)
{
    struct ls_connection *a = a_client(stage), *b = a_client(stage);
    bool already = true;
    g_assert_cmpuint(start_take(a, "token-a", &already), ==, 0);
    g_assert_false(already);
    g_assert_cmpuint(start_take(b, "token-b", &already), ==, 201);
    g_assert_cmpuint(engine_state(stage).started, ==, 1);
    ls_connection_close(a);
    ls_connection_close(b);
}

static void the_same_token_starts_once(struct stage *stage, gconstpointer data)
{
    struct ls_connection *a = a_client(stage);
    bool already = true;
    g_assert_cmpuint(start_take(a, "token", &already), ==, 0);
    ls_connection_close(a); /* lost, and the operator tries again */
    a = a_client(stage);
    g_assert_cmpuint(start_take(a, "token", &already), ==, 0);
    g_assert_true(already);
    take_ends(stage, LS_TAKE_COMPLETE);
    g_assert_cmpuint(start_take(a, "token", &already), ==, 0);
    g_assert_true(already);
    g_assert_cmpuint(engine_state(stage).started, ==, 1);
    uint32_t bound;
    bool last;
    g_assert_cmpint(next_state(a, follow(a), &bound, &last), ==, LIGHTSTAGE__TAKE_STATE__COMPLETE);
    g_assert_true(last);
    ls_connection_close(a);
}

static void bad_names_and_tokens_are_refused(struct stage *stage, gconstpointer data)
{
    struct ls_connection *client = a_client(stage);
    Lightstage__TakeStart body = LIGHTSTAGE__TAKE_START__INIT;
    bool already;
    g_assert_cmpuint(start_take(client, "", &already), ==, 107);
    g_assert_cmpuint(start_take(client, "with space", &already), ==, 107);
    body.token = (char *)"t";
    body.name = (char *)"../up";
    g_assert_cmpuint(ask(client, LS_MESSAGE_TAKE_START, &body.base, plan, NULL), ==, 107);
    body.name = (char *)"ok";
    g_assert_cmpuint(ask(client, LS_MESSAGE_TAKE_START, &body.base, NULL, NULL), ==, 107);
    g_assert_cmpuint(engine_state(stage).started, ==, 0);
    ls_connection_close(client);
}

static void progress_follows_the_take_to_its_end(struct stage *stage, gconstpointer data)
{
    struct ls_connection *client = a_client(stage);
    uint32_t bound = 0;
    bool already, last = false;
    g_assert_cmpuint(start_take(client, "token", &already), ==, 0);
    uint32_t request = follow(client);
    g_assert_cmpint(next_state(client, request, &bound, &last), ==,
                    LIGHTSTAGE__TAKE_STATE__PREPARING);
    take_advances(stage, 42);
    g_assert_cmpint(next_state(client, request, &bound, &last), ==,
                    LIGHTSTAGE__TAKE_STATE__RUNNING);
    g_assert_cmpuint(bound, ==, 42);
    g_assert_false(last);
    take_ends(stage, LS_TAKE_INCOMPLETE);
    g_assert_cmpint(next_state(client, request, &bound, &last), ==,
                    LIGHTSTAGE__TAKE_STATE__INCOMPLETE);
    g_assert_true(last);
    ls_connection_close(client);
}

static void a_subscriber_that_leaves_changes_nothing(struct stage *stage, gconstpointer data)
{
    struct ls_connection *client = a_client(stage);
    bool already;
    g_assert_cmpuint(start_take(client, "token", &already), ==, 0);
    follow(client);
    ls_connection_close(client);
    take_advances(stage, 1);
    wait_for_connections(stage, 0);
    take_advances(stage, 2);
    take_ends(stage, LS_TAKE_COMPLETE);
    g_assert_cmpuint(engine_state(stage).aborted, ==, 0);
    still_serves(stage);
}

static void abort_resume_and_blank_reach_the_engine(struct stage *stage, gconstpointer data)
{
    Lightstage__TakeAbort abort_body = LIGHTSTAGE__TAKE_ABORT__INIT;
    Lightstage__Blank blank = LIGHTSTAGE__BLANK__INIT;
    Lightstage__TakeResume resume = LIGHTSTAGE__TAKE_RESUME__INIT;
    struct ls_connection *client = a_client(stage);
    bool already;
    g_assert_cmpuint(ask(client, LS_MESSAGE_TAKE_ABORT, &abort_body.base, NULL, NULL), ==, 200);
    g_assert_cmpuint(start_take(client, "token", &already), ==, 0);
    g_assert_cmpuint(ask(client, LS_MESSAGE_TAKE_ABORT, &abort_body.base, NULL, NULL), ==, 0);
    take_ends(stage, LS_TAKE_ABORTED);
    resume.take = (char *)"20260102T030405Z-vase-0a0b0c";
    resume.token = (char *)"again";
    engine_will_answer(stage, LS_ERR_MISMATCH);
    g_assert_cmpuint(ask(client, LS_MESSAGE_TAKE_RESUME, &resume.base, NULL, NULL), ==, 206);
    g_assert_cmpuint(ask(client, LS_MESSAGE_TAKE_RESUME, &resume.base, NULL, NULL), ==, 0);
    resume.take = (char *)"../../etc";
    g_assert_cmpuint(ask(client, LS_MESSAGE_TAKE_RESUME, &resume.base, NULL, NULL), ==, 202);
    g_assert_cmpuint(ask(client, LS_MESSAGE_BLANK, &blank.base, NULL, NULL), ==, 0);
    struct fake_engine_state state = engine_state(stage);
    g_assert_cmpuint(state.aborted, ==, 1);
    g_assert_cmpuint(state.resumed, ==, 1);
    g_assert_cmpuint(state.blanked, ==, 1);
    ls_connection_close(client);
}

static void cancel_ends_a_subscription(struct stage *stage, gconstpointer data)
{
    struct ls_connection *client = a_client(stage);
    Lightstage__Cancel cancel = LIGHTSTAGE__CANCEL__INIT;
    struct ls_reply reply;
    uint32_t bound, other;
    bool already, last;
    g_assert_cmpuint(start_take(client, "token", &already), ==, 0);
    cancel.request = follow(client);
    next_state(client, cancel.request, &bound, &last);
    g_assert_cmpint(
        ls_connection_send(client, LS_MESSAGE_CANCEL, &cancel.base, NULL, 0, &other, NULL), ==,
        LS_OK);
    g_assert_cmpint(ls_connection_receive(client, cancel.request, &reply, NULL), ==,
                    LS_ERR_REFUSED);
    g_assert_cmpuint(ls_connection_error(client), ==, LS_PROTO_CANCELLED);
    ls_connection_close(client);
}

/* ---- bad clients ---- */

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

static void unknown_takes_are_not_found(struct stage *stage, gconstpointer data)
{
    static const char *const names[] = {"", "..", "20260102T030405Z-none-000000",
                                        "../../../etc/passwd"};
    struct ls_connection *client = a_client(stage);
    for (size_t i = 0; i < G_N_ELEMENTS(names); i++) {
        Lightstage__TakeShow show = LIGHTSTAGE__TAKE_SHOW__INIT;
        Lightstage__TakeVerify verify = LIGHTSTAGE__TAKE_VERIFY__INIT;
        Lightstage__Fetch fetch = LIGHTSTAGE__FETCH__INIT;
        show.take = verify.take = fetch.take = (char *)names[i];
        fetch.channel = (char *)"W";
        g_assert_cmpuint(ask(client, LS_MESSAGE_TAKE_SHOW, &show.base, NULL, NULL), ==, 202);
        g_assert_cmpuint(ask(client, LS_MESSAGE_TAKE_VERIFY, &verify.base, NULL, NULL), ==, 202);
        g_assert_cmpuint(ask(client, LS_MESSAGE_FETCH, &fetch.base, NULL, NULL), ==, 202);
    }
    ls_connection_close(client);
}

/* ---- the socket ---- */

static void a_socket_in_use_is_refused_with_a_sentence(struct stage *stage, gconstpointer data)
{
    struct ls_server *second = NULL;
    struct ls_diag diag = {0};
    g_assert_cmpint(ls_server_create(&stage->limits, stage->engine, &second, &diag), ==,
                    LS_ERR_BUSY);
    g_assert_nonnull(strstr(diag.text, stage->socket_path));
    g_assert_nonnull(strstr(diag.text, "running"));
    still_serves(stage);
}

static void a_stale_socket_is_taken_over(struct stage *stage, gconstpointer data)
{
    struct ls_diag diag = {0};
    struct stat info;
    int fd = -1;
    stage_init(stage);
    g_assert_cmpint(ls_listen_unix(stage->socket_path, &fd, &diag), ==, LS_OK);
    close(fd); /* the file stays, as after kill -9 */
    g_assert_cmpint(g_stat(stage->socket_path, &info), ==, 0);
    g_assert_cmpint(info.st_mode & 0777, ==, 0660);
    stage_open(stage);
    still_serves(stage);
}

static void a_file_in_the_sockets_place_is_kept(struct stage *stage, gconstpointer data)
{
    struct ls_diag diag = {0};
    int fd = -1;
    char *path = g_build_filename(stage->folder, "file", NULL), *text = NULL;
    g_assert_true(g_file_set_contents(path, "precious", -1, NULL));
    g_assert_cmpint(ls_listen_unix(path, &fd, &diag), ==, LS_ERR_EXISTS);
    g_assert_true(g_file_get_contents(path, &text, NULL, NULL));
    g_assert_cmpstr(text, ==, "precious");
    g_free(text);
    g_free(path);
    g_assert_cmpint(ls_listen_unix("/nonexistent/folder/socket", &fd, &diag), ==, LS_ERR_NOT_FOUND);
    char *longest = g_strnfill(200, 'x');
    g_assert_cmpint(ls_listen_unix(longest, &fd, &diag), ==, LS_ERR_INVALID);
    g_free(longest);
}

static void the_daemon_says_when_it_goes(struct stage *stage, gconstpointer data)
{
    struct ls_connection *client;
    struct ls_reply reply;
    bool already, last;
    uint32_t bound;
    stage_init(stage);
    stage_open(stage);
    client = a_client(stage);
    g_assert_cmpuint(start_take(client, "token", &already), ==, 0);
    uint32_t request = follow(client);
    next_state(client, request, &bound, &last);
    stage_close(stage);
    g_assert_cmpint(ls_connection_receive(client, request, &reply, NULL), ==, LS_ERR_REFUSED);
    g_assert_cmpuint(ls_connection_error(client), ==, LS_PROTO_CLOSING);
    g_assert_cmpint(ls_connection_receive(client, request, &reply, NULL), ==, LS_ERR_GONE);
    ls_connection_close(client);
}

static void nothing(struct stage *stage, gconstpointer data)
{
}

#define ADD(name, function) \
    g_test_add("/server/" name, struct stage, NULL, with_stage, function, end_stage)
#define ADD_OWN(name, function) \
    g_test_add("/server/" name, struct stage, NULL, nothing, function, end_stage)

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    ADD("status-and-rig-are-answered", status_and_rig_are_answered);
    ADD("preflight-gets-the-plans-text", preflight_gets_the_plans_text);
    ADD("two-clients-starting-at-once-start-one-take", two_clients_starting_at_once_start_one_take);
    ADD("the-same-token-starts-once", the_same_token_starts_once);
    ADD("bad-names-and-tokens-are-refused", bad_names_and_tokens_are_refused);
    ADD("progress-follows-the-take-to-its-end", progress_follows_the_take_to_its_end);
    ADD("a-subscriber-that-leaves-changes-nothing", a_subscriber_that_leaves_changes_nothing);
    ADD("abort-resume-and-blank-reach-the-engine", abort_resume_and_blank_reach_the_engine);
    ADD("cancel-ends-a-subscription", cancel_ends_a_subscription);
    ADD("bad-streams-get-an-error-and-are-closed", bad_streams_get_an_error_and_are_closed);
    ADD("a-message-that-does-not-decode-is-refused", a_message_that_does_not_decode_is_refused);
    ADD("the-first-message-must-be-hello", the_first_message_must_be_hello);
    ADD("disconnecting-anywhere-does-no-harm", disconnecting_anywhere_does_no_harm);
    ADD_OWN("too-many-clients-are-turned-away", too_many_clients_are_turned_away);
    ADD_OWN("silent-and-half-spoken-clients-are-closed", silent_and_half_spoken_clients_are_closed);
    ADD_OWN("a-client-that-never-reads-is-counted-and-closed",
            a_client_that_never_reads_is_counted_and_closed);
    ADD("unknown-takes-are-not-found", unknown_takes_are_not_found);
    ADD("a-socket-in-use-is-refused-with-a-sentence", a_socket_in_use_is_refused_with_a_sentence);
    ADD_OWN("a-stale-socket-is-taken-over", a_stale_socket_is_taken_over);
    ADD("a-file-in-the-sockets-place-is-kept", a_file_in_the_sockets_place_is_kept);
    g_test_add("/server/the-daemon-says-when-it-goes", struct stage, NULL, nothing,
               the_daemon_says_when_it_goes, nothing);
    return g_test_run();
}
