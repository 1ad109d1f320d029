/* roles: every type of request, asked by a reader and by an operator; who is who. */
#include "daemon/access.h"
#include "proto/errors.h"
#include "tests/daemon/server_verbs.h"

#include <string.h>
#include <unistd.h>

/* What a reader may ask for; every type of the protocol stands in one of the two. */
static const uint16_t of_readers[] = {
    LS_MESSAGE_STATUS,    LS_MESSAGE_RIG,       LS_MESSAGE_METRICS,     LS_MESSAGE_TAKE_PROGRESS,
    LS_MESSAGE_TAKE_LIST, LS_MESSAGE_TAKE_SHOW, LS_MESSAGE_TAKE_VERIFY, LS_MESSAGE_TAKE_SLATE,
    LS_MESSAGE_PREVIEW,   LS_MESSAGE_FETCH,     LS_MESSAGE_RELIGHT,     LS_MESSAGE_CANCEL,
    LS_MESSAGE_CREDIT,    LS_MESSAGE_EVENTS,
};
static const uint16_t of_operators[] = {
    LS_MESSAGE_PREFLIGHT,   LS_MESSAGE_TAKE_START, LS_MESSAGE_TAKE_ABORT,
    LS_MESSAGE_TAKE_RESUME, LS_MESSAGE_BLANK,      LS_MESSAGE_RING,
};

static bool among(const uint16_t *types, size_t n, uint16_t type)
{
    for (size_t i = 0; i < n; i++)
        if (types[i] == type)
            return true;
    return false;
}

/* A request of defaults; what it says of the rest of it is not looked at here. */
static uint32_t ask_type(struct ls_connection *client, uint16_t type)
{
    const ProtobufCMessageDescriptor *descriptor = ls_message_descriptor(type);
    ProtobufCMessage *body = g_malloc0(descriptor->sizeof_message);
    protobuf_c_message_init(descriptor, body);
    if (type == LS_MESSAGE_PREVIEW)
        ((Lightstage__Preview *)body)->camera = 99; /* there is none, so that it ends */
    uint32_t number = ask(client, type, body, NULL, NULL);
    g_free(body);
    return number;
}

static void open_as(struct stage *stage, struct ls_access *access)
{
    stage_init(stage);
    access->listed = true;
    stage->limits.access = access;
    stage_open(stage);
}

static void every_request_has_its_role(struct stage *stage, gconstpointer data)
{
    struct ls_access reader = {.reader_uids = {{getuid()}, 1}};
    open_as(stage, &reader);
    unsigned met = 0;
    for (uint16_t type = LS_MESSAGE_HELLO + 1; type < LS_MESSAGE_REPLY; type++) {
        if (!ls_message_descriptor(type))
            continue;
        bool free = among(of_readers, G_N_ELEMENTS(of_readers), type);
        bool kept = among(of_operators, G_N_ELEMENTS(of_operators), type);
        if (free == kept)
            g_error("%s: is it a reader's or an operator's?", ls_message_name(type));
        struct ls_connection *client = a_client(stage);
        uint32_t number = ask_type(client, type);
        if ((number == LS_PROTO_NOT_ALLOWED) != kept)
            g_error("%s of a reader ends with %u", ls_message_name(type), number);
        if (kept) /* the connection goes on */
            g_assert_cmpuint(ask_type(client, LS_MESSAGE_STATUS), ==, 0);
        ls_connection_close(client);
        met++;
    }
    g_assert_cmpuint(met, ==, G_N_ELEMENTS(of_readers) + G_N_ELEMENTS(of_operators));
    struct fake_engine_state state = engine_state(stage);
    g_assert_cmpuint(state.started + state.resumed + state.aborted + state.blanked, ==, 0);
}

static void an_operator_may_ask_for_everything(struct stage *stage, gconstpointer data)
{
    struct ls_access operator= {.operator_uids = {{getuid()}, 1}};
    open_as(stage, &operator);
    for (uint16_t type = LS_MESSAGE_HELLO + 1; type < LS_MESSAGE_REPLY; type++) {
        if (!ls_message_descriptor(type))
            continue;
        struct ls_connection *client = a_client(stage);
        g_assert_cmpuint(ask_type(client, type), !=, LS_PROTO_NOT_ALLOWED);
        ls_connection_close(client);
    }
}

static void a_reader_writes_no_slate_and_drives_no_camera(struct stage *stage, gconstpointer data)
{
    struct ls_access reader = {.reader_uids = {{getuid()}, 1}};
    open_as(stage, &reader);
    Lightstage__Slate words = LIGHTSTAGE__SLATE__INIT;
    Lightstage__TakeSlate slate = LIGHTSTAGE__TAKE_SLATE__INIT;
    Lightstage__Preview preview = LIGHTSTAGE__PREVIEW__INIT;
    struct ls_connection *client = a_client(stage);
    slate.take = (char *)"20260102T030405Z-vase-0a0b0c";
    g_assert_cmpuint(ask(client, LS_MESSAGE_TAKE_SLATE, &slate.base, NULL, NULL), ==, 202);
    slate.write = &words;
    g_assert_cmpuint(ask(client, LS_MESSAGE_TAKE_SLATE, &slate.base, NULL, NULL), ==, 110);
    preview.exposure_us = 100;
    g_assert_cmpuint(ask(client, LS_MESSAGE_PREVIEW, &preview.base, NULL, NULL), ==, 110);
    ls_connection_close(client);
}

static void hello_says_the_role(struct stage *stage, gconstpointer data)
{
    struct ls_access reader = {.reader_gids = {{getgid()}, 1}};
    Lightstage__Hello hello = LIGHTSTAGE__HELLO__INIT;
    struct ls_reply reply;
    open_as(stage, &reader);
    struct ls_connection *client = a_client(stage);
    hello.version = 1;
    g_assert_cmpuint(ask(client, LS_MESSAGE_HELLO, &hello.base, NULL, &reply), ==, 0);
    g_assert_cmpint(((const Lightstage__HelloReply *)reply.message)->role, ==,
                    LIGHTSTAGE__ROLE__READER);
    ls_reply_finish(&reply);
    ls_connection_close(client);
}

static void who_is_in_no_list_is_told_so(struct stage *stage, gconstpointer data)
{
    struct ls_access others = {.operator_uids = {{getuid() + 1}, 1}};
    struct ls_connection *client = NULL;
    struct ls_diag diag = {0};
    open_as(stage, &others);
    g_assert_cmpint(ls_connection_open(stage->socket_path, &client, &diag), ==, LS_ERR_REFUSED);
    g_assert_nonnull(strstr(diag.text, "neither an operator nor a reader"));
    wait_for_connections(stage, 0);
}

static void one_user_has_so_many_connections(struct stage *stage, gconstpointer data)
{
    struct ls_connection *client[3] = {NULL};
    struct ls_diag diag = {0};
    stage_init(stage);
    stage->limits.max_connections_each = 2;
    stage_open(stage);
    client[0] = a_client(stage);
    client[1] = a_client(stage);
    g_assert_cmpint(ls_connection_open(stage->socket_path, &client[2], &diag), ==, LS_ERR_REFUSED);
    g_assert_nonnull(strstr(diag.text, "2 connections already"));
    ls_connection_close(client[0]);
    wait_for_connections(stage, 1);
    still_serves(stage);
    ls_connection_close(client[1]);
}

static void the_higher_of_two_roles_counts(void)
{
    const gid_t groups[] = {7, 8};
    struct ls_access access = {.listed = true,
                               .operator_gids = {{8}, 1},
                               .reader_uids = {{1000}, 1},
                               .operators = {{(char *)"desk"}, 1},
                               .readers = {{(char *)"node"}, 1}};
    g_assert_cmpint(ls_access_unix(&access, 1000, groups, 2), ==, LS_ROLE_OPERATOR);
    g_assert_cmpint(ls_access_unix(&access, 1000, groups, 1), ==, LS_ROLE_READER);
    g_assert_cmpint(ls_access_unix(&access, 1001, groups, 1), ==, LS_ROLE_NONE);
    g_assert_cmpint(ls_access_certificate(&access, "desk"), ==, LS_ROLE_OPERATOR);
    g_assert_cmpint(ls_access_certificate(&access, "node"), ==, LS_ROLE_READER);
    g_assert_cmpint(ls_access_certificate(&access, ""), ==, LS_ROLE_NONE);
    access.listed = false;
    g_assert_cmpint(ls_access_unix(&access, 1001, NULL, 0), ==, LS_ROLE_OPERATOR);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    ADD_OWN("every-request-has-its-role", every_request_has_its_role);
    ADD_OWN("an-operator-may-ask-for-everything", an_operator_may_ask_for_everything);
    ADD_OWN("a-reader-writes-no-slate-and-drives-no-camera",
            a_reader_writes_no_slate_and_drives_no_camera);
    ADD_OWN("hello-says-the-role", hello_says_the_role);
    ADD_OWN("who-is-in-no-list-is-told-so", who_is_in_no_list_is_told_so);
    ADD_OWN("one-user-has-so-many-connections", one_user_has_so_many_connections);
    g_test_add_func("/server/the-higher-of-two-roles-counts", the_higher_of_two_roles_counts);
    return g_test_run();
}
