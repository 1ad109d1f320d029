/*
 * server_verbs: what clients of a server ask in its tests, and what they are told.
 * Layer: tests. Threads: the test's one. Ownership: with_stage / end_stage.
 */
#ifndef LS_TESTS_DAEMON_SERVER_VERBS_H
#define LS_TESTS_DAEMON_SERVER_VERBS_H

#include "tests/daemon/server_fixture.h"

/** Of the takes that are started. */
extern const char plan[19];

void with_stage(struct stage *stage, gconstpointer data);
void end_stage(struct stage *stage, gconstpointer data);

/** In the place of either: the test does it. */
void nothing(struct stage *stage, gconstpointer data);

/** The number the daemon refuses with; 0 = it answers. *reply may be NULL. */
uint32_t ask(struct ls_connection *client, uint16_t type, const ProtobufCMessage *body,
             const char *payload, struct ls_reply *reply);

/** As ask; *already: the token was known. */
uint32_t start_take(struct ls_connection *client, const char *token, bool *already);

/** Subscribe to the take; returns the request. */
uint32_t follow(struct ls_connection *client);

/** The next that is told of it. */
Lightstage__TakeState next_state(struct ls_connection *client, uint32_t request, uint32_t *bound,
                                 bool *last);

/** A new client is answered. */
void still_serves(struct stage *stage);

#define ADD(name, function) \
    g_test_add("/server/" name, struct stage, NULL, with_stage, function, end_stage)
#define ADD_OWN(name, function) \
    g_test_add("/server/" name, struct stage, NULL, nothing, function, end_stage)

#endif
