/*
 * library_fixture: liblightstage, the shared one, and a daemon with made takes.
 * Layer: tests. Threads: the test's one, and the server's own. Ownership: lightstage_close.
 */
#ifndef LS_TESTS_CLIENTS_LIBRARY_FIXTURE_H
#define LS_TESTS_CLIENTS_LIBRARY_FIXTURE_H

#include "clients/lightstage.h"
#include "tests/clients/ctl_fixture.h"
#include "tests/daemon/take_fixture.h"

struct lightstage *connected(const struct stage *stage);

/** All lights of it under W, as they are stored. */
struct lightstage_fetch stored(const struct made_take *take);

#define ADD_LIBRARY(name, function) \
    g_test_add("/liblightstage/" name, struct stage, NULL, with_stage, function, end_stage)

#endif
