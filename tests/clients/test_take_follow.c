/* lightstagectl: following a take, Ctrl-C, and a connection that is lost. */
#include "tests/clients/ctl_fixture.h"

#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

/* A take start in its own process. */
struct starting {
    GPid pid;
    int out, err;
};

static struct starting begin(struct stage *stage, const char *options)
{
    struct starting starting;
    char *line = start_line(stage, options), **words = NULL;
    char *command =
        g_strdup_printf("%s --socket %s %s", g_getenv("LIGHTSTAGECTL"), stage->socket_path, line);
    g_assert_true(g_shell_parse_argv(command, NULL, &words, NULL));
    g_assert_true(g_spawn_async_with_pipes(NULL, words, NULL, G_SPAWN_DO_NOT_REAP_CHILD, NULL, NULL,
                                           &starting.pid, NULL, &starting.out, &starting.err,
                                           NULL));
    g_strfreev(words);
    g_free(command);
    g_free(line);
    wait_for_connections(stage, 1);
    fake_engine_wait(stage->engine, 1, 0);
    return starting;
}

static int ending(struct starting *starting, char **err)
{
    int status = 0;
    GString *text = g_string_new(NULL);
    char bytes[512];
    for (ssize_t n; (n = read(starting->err, bytes, sizeof bytes)) > 0;)
        g_string_append_len(text, bytes, n);
    g_assert_cmpint(waitpid(starting->pid, &status, 0), ==, starting->pid);
    close(starting->out);
    close(starting->err);
    *err = g_string_free(text, FALSE);
    g_assert_true(WIFEXITED(status));
    return WEXITSTATUS(status);
}

static void a_take_that_completes_ends_with_0_else_1(struct stage *stage, gconstpointer data)
{
    static const enum ls_take_state states[] = {LS_TAKE_COMPLETE, LS_TAKE_INCOMPLETE,
                                                LS_TAKE_FAILED, LS_TAKE_ABORTED};
    struct starting starting = begin(stage, "--token t0");
    char *err;
    take_advances(stage, 10);
    take_ends(stage, states[0]);
    g_assert_cmpint(ending(&starting, &err), ==, 0);
    g_free(err);
    for (size_t i = 1; i < G_N_ELEMENTS(states); i++) {
        char token[16];
        snprintf(token, sizeof token, "--token t%zu", i);
        starting = begin(stage, token);
        fake_engine_wait(stage->engine, (unsigned)i + 1, 0);
        take_ends(stage, states[i]);
        g_assert_cmpint(ending(&starting, &err), ==, 1);
        g_free(err);
    }
}

/* SIGINT to the program, as the kernel may deliver it: to the youngest of its threads, which is a
 * library's if one has any. */
static void press_ctrl_c(GPid pid)
{
    char *path = g_strdup_printf("/proc/%d/task", pid);
    GDir *tasks = g_dir_open(path, 0, NULL);
    long thread = pid;
    for (const char *name; (name = g_dir_read_name(tasks));)
        thread = MAX(thread, strtol(name, NULL, 10));
    g_dir_close(tasks);
    g_free(path);
    g_assert_no_errno((int)syscall(SYS_tgkill, pid, thread, SIGINT));
}

static void ctrl_c_aborts_and_waits_for_the_end(struct stage *stage, gconstpointer data)
{
    struct starting starting = begin(stage, "");
    char *err;
    press_ctrl_c(starting.pid);
    fake_engine_wait(stage->engine, 1, 1);
    g_assert_cmpint(waitpid(starting.pid, NULL, WNOHANG), ==, 0); /* still waiting */
    take_ends(stage, LS_TAKE_ABORTED);
    g_assert_cmpint(ending(&starting, &err), ==, 130);
    g_assert_nonnull(strstr(err, "aborting"));
    g_free(err);
}

static void a_second_ctrl_c_leaves_at_once(struct stage *stage, gconstpointer data)
{
    struct starting starting = begin(stage, "");
    char *err;
    press_ctrl_c(starting.pid);
    fake_engine_wait(stage->engine, 1, 1);
    press_ctrl_c(starting.pid);
    g_assert_cmpint(ending(&starting, &err), ==, 130); /* the take has not ended */
    g_assert_nonnull(strstr(err, "the daemon finishes aborting"));
    g_free(err);
}

static void a_lost_connection_leaves_the_take_running(struct stage *stage, gconstpointer data)
{
    static const struct stage empty;
    struct starting starting = begin(stage, "--token mine");
    char *err;
    stage_close(stage);
    int code = ending(&starting, &err);
    g_assert_true(code == 3 || code == 5); /* 5: the daemon could still say that it closes */
    g_assert_nonnull(strstr(err, code == 3 ? "--token mine" : "shutting down"));
    g_free(err);
    *stage = empty;
    with_stage(stage, NULL);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    if (!g_getenv("LIGHTSTAGECTL")) {
        puts("1..0 # SKIP LIGHTSTAGECTL is not set");
        return 0;
    }
    ADD("a-take-that-completes-ends-with-0-else-1", a_take_that_completes_ends_with_0_else_1);
    ADD("ctrl-c-aborts-and-waits-for-the-end", ctrl_c_aborts_and_waits_for_the_end);
    ADD("a-second-ctrl-c-leaves-at-once", a_second_ctrl_c_leaves_at_once);
    ADD("a-lost-connection-leaves-the-take-running", a_lost_connection_leaves_the_take_running);
    return g_test_run();
}
