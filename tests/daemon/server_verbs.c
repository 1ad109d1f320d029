#include "tests/daemon/server_verbs.h"

#include <string.h>

const char plan[19] = "subject = \"still\";";

void with_stage(struct stage *stage, gconstpointer data)
{
    stage_init(stage);
    stage_open(stage);
}

void end_stage(struct stage *stage, gconstpointer data)
{
    stage_close(stage);
}

uint32_t ask(struct ls_connection *client, uint16_t type, const ProtobufCMessage *body,
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

uint32_t start_take(struct ls_connection *client, const char *token, bool *already)
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

uint32_t follow(struct ls_connection *client)
{
    Lightstage__TakeProgress body = LIGHTSTAGE__TAKE_PROGRESS__INIT;
    uint32_t request = 0;
    g_assert_cmpint(
        ls_connection_send(client, LS_MESSAGE_TAKE_PROGRESS, &body.base, NULL, 0, &request, NULL),
        ==, LS_OK);
    return request;
}

Lightstage__TakeState next_state(struct ls_connection *client, uint32_t request, uint32_t *bound,
                                 bool *last)
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

void still_serves(struct stage *stage)
{
    Lightstage__Status body = LIGHTSTAGE__STATUS__INIT;
    struct ls_connection *client = a_client(stage);
    g_assert_cmpuint(ask(client, LS_MESSAGE_STATUS, &body.base, NULL, NULL), ==, 0);
    ls_connection_close(client);
}

void nothing(struct stage *stage, gconstpointer data)
{
}
