/* server: what clients ask for, against a fake engine, and the socket they come to. */
#include "daemon/listen.h"
#include "proto/errors.h"
#include "tests/daemon/server_verbs.h"

#include <glib/gstdio.h>
#include <string.h>
#include <unistd.h>

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

static uint32_t ask_preflight(struct ls_connection *client)
{
    Lightstage__Preflight body = LIGHTSTAGE__PREFLIGHT__INIT;
    uint32_t request = 0;
    g_assert_cmpint(ls_connection_send(client, LS_MESSAGE_PREFLIGHT, &body.base, plan, strlen(plan),
                                       &request, NULL),
                    ==, LS_OK);
    return request;
}

/* What the engine has not answered is the client's to cancel, and goes with its connection. */
static void a_request_that_waits_for_devices_holds_nobody(struct stage *stage, gconstpointer data)
{
    struct ls_connection *client = a_client(stage);
    Lightstage__Cancel cancel = LIGHTSTAGE__CANCEL__INIT;
    struct ls_reply reply;
    struct ls_diag diag = {0};
    engine_falls_silent(stage);
    uint32_t first = ask_preflight(client), unanswered = ask_preflight(client);
    still_serves(stage);
    cancel.request = first;
    g_assert_cmpint(
        ls_connection_send(client, LS_MESSAGE_CANCEL, &cancel.base, NULL, 0, &unanswered, NULL), ==,
        LS_OK);
    g_assert_cmpint(ls_connection_receive(client, first, &reply, &diag), ==, LS_ERR_REFUSED);
    g_assert_cmpuint(ls_connection_error(client), ==, LS_PROTO_CANCELLED);
    g_assert_cmpuint(engine_state(stage).stopped, ==, 1);
    ls_connection_close(client);
    wait_for_connections(stage, 0);
    struct fake_engine_state state = engine_state(stage);
    g_assert_cmpuint(state.waiting, ==, 0);
    g_assert_cmpuint(state.stopped, ==, 2);
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

static void a_running_take_is_not_verified(struct stage *stage, gconstpointer data)
{
    struct ls_connection *client = a_client(stage);
    Lightstage__TakeStart start = LIGHTSTAGE__TAKE_START__INIT;
    Lightstage__TakeVerify verify = LIGHTSTAGE__TAKE_VERIFY__INIT;
    struct ls_reply reply;
    start.name = (char *)"vase";
    start.token = (char *)"token";
    g_assert_cmpuint(ask(client, LS_MESSAGE_TAKE_START, &start.base, plan, &reply), ==, 0);
    verify.take = g_strdup(((const Lightstage__TakeStartReply *)reply.message)->take->id);
    ls_reply_finish(&reply);
    g_assert_cmpuint(ask(client, LS_MESSAGE_TAKE_VERIFY, &verify.base, NULL, NULL), ==,
                     LS_PROTO_BUSY);
    g_free(verify.take);
    ls_connection_close(client);
}

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
    ADD("a-request-that-waits-for-devices-holds-nobody",
        a_request_that_waits_for_devices_holds_nobody);
    ADD("abort-resume-and-blank-reach-the-engine", abort_resume_and_blank_reach_the_engine);
    ADD("cancel-ends-a-subscription", cancel_ends_a_subscription);
    ADD("a-running-take-is-not-verified", a_running_take_is_not_verified);
    ADD("unknown-takes-are-not-found", unknown_takes_are_not_found);
    ADD("a-socket-in-use-is-refused-with-a-sentence", a_socket_in_use_is_refused_with_a_sentence);
    ADD_OWN("a-stale-socket-is-taken-over", a_stale_socket_is_taken_over);
    ADD("a-file-in-the-sockets-place-is-kept", a_file_in_the_sockets_place_is_kept);
    g_test_add("/server/the-daemon-says-when-it-goes", struct stage, NULL, nothing,
               the_daemon_says_when_it_goes, nothing);
    return g_test_run();
}
