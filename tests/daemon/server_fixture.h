/*
 * server_fixture: a real server on a thread of its own, with a fake engine behind it.
 * Layer: tests. Threads: verbs are called from the test's thread. Ownership: the fixture's.
 */
#ifndef LS_TESTS_DAEMON_SERVER_FIXTURE_H
#define LS_TESTS_DAEMON_SERVER_FIXTURE_H

#include "clients/connection.h"
#include "daemon/server.h"
#include "tests/daemon/fake_engine.h"

#include <glib.h>

struct stage {
    char *folder, *socket_path, *storage;
    struct ls_server_config limits; /* fill in before stage_open */
    struct ls_config config;
    struct ls_engine *engine;
    struct ls_server *server;
    GMainLoop *loop;
    GThread *thread;
};

/** Make folders and defaults; then change limits; then open. */
void stage_init(struct stage *stage);
void stage_open(struct stage *stage);
void stage_close(struct stage *stage);

/** Call @verb on ls-main and wait for it. */
void stage_do(struct stage *stage, void (*verb)(struct stage *stage, void *data), void *data);

/** Common verbs. */
void take_advances(struct stage *stage, uint32_t steps);
void take_ends(struct stage *stage, enum ls_take_state state);
struct fake_engine_state engine_state(struct stage *stage);
void engine_will_answer(struct stage *stage, enum ls_err err);
void engine_falls_silent(struct stage *stage);

/** Wait until @n clients are connected; fails the test after 5 s. */
void wait_for_connections(struct stage *stage, unsigned n);

/** A greeted client. */
struct ls_connection *a_client(struct stage *stage);

/** A bare socket, connected. */
int a_bare_socket(struct stage *stage);

#endif
