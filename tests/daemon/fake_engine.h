/*
 * fake_engine: daemon/engine.h without devices, linked in its place, told what to do by tests.
 * Layer: tests. Threads: as engine.h (ls-main); what fake_engine_* says, from ls-main too, but for
 * fake_engine_wait.
 */
#ifndef LS_TESTS_DAEMON_FAKE_ENGINE_H
#define LS_TESTS_DAEMON_FAKE_ENGINE_H

#include "daemon/engine.h"

/** Counters and answers; written on ls-main only. */
struct fake_engine_state {
    unsigned started, resumed, aborted, blanked, framed;
    bool silent;               /* preflights are not answered */
    unsigned waiting, stopped; /* of those: not withdrawn yet; withdrawn, and to be stopped */
    enum ls_err answer;        /* of the next start, resume or preflight; LS_OK = do it */
};

struct fake_engine_state *fake_engine_state(struct ls_engine *engine);

/** What it says it has counted. */
struct ls_metrics *fake_engine_metrics(struct ls_engine *engine);

/** Wait until @started takes were begun and @aborted aborts asked for; the test fails after 30 s.
 * Any thread but ls-main. */
void fake_engine_wait(struct ls_engine *engine, unsigned started, unsigned aborted);

/** The running take has bound @steps; its subscribers are told. */
void fake_engine_advance(struct ls_engine *engine, uint32_t steps);

/** The running take ends. */
void fake_engine_end(struct ls_engine *engine, enum ls_take_state state);

#endif
