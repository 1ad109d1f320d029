/*
 * ctl_fixture: lightstagectl as a process, and a daemon with a fake engine for it to speak to.
 * Layer: tests. Threads: the test's one, and the server's own. Ownership: with_stage / end_stage.
 *
 * The program is $LIGHTSTAGECTL.
 */
#ifndef LS_TESTS_CLIENTS_CTL_FIXTURE_H
#define LS_TESTS_CLIENTS_CTL_FIXTURE_H

#include "tests/daemon/server_fixture.h"

/** Exit code and what was written; outcome_free. */
struct outcome {
    int code;
    char *out, *err;
};

/** Run it with the words of @line to its end. */
struct outcome run(const char *socket, const char *line);
void outcome_free(struct outcome *outcome);

/** Run it: it must end with @code and say @sentence. */
void expect(const char *socket, const char *line, int code, const char *sentence);

void with_stage(struct stage *stage, gconstpointer data);
void end_stage(struct stage *stage, gconstpointer data);

/** "take start" with the stage's plan; g_free. */
char *start_line(const struct stage *stage, const char *options);

#define ADD(name, function) \
    g_test_add("/lightstagectl/" name, struct stage, NULL, with_stage, function, end_stage)

#endif
