#include "tests/clients/ctl_fixture.h"

#include <string.h>
#include <sys/wait.h>

void outcome_free(struct outcome *outcome)
{
    g_free(outcome->out);
    g_free(outcome->err);
}

struct outcome run(const char *socket, const char *line)
{
    struct outcome outcome = {0};
    char **words = NULL;
    int status = 0;
    GError *error = NULL;
    char *command = g_strdup_printf("%s --socket %s %s", g_getenv("LIGHTSTAGECTL"), socket, line);
    g_assert_true(g_shell_parse_argv(command, NULL, &words, &error));
    g_assert_true(g_spawn_sync(NULL, words, NULL, G_SPAWN_DEFAULT, NULL, NULL, &outcome.out,
                               &outcome.err, &status, &error));
    g_assert_no_error(error);
    g_assert_true(WIFEXITED(status));
    outcome.code = WEXITSTATUS(status);
    g_test_message("%s -> %d %s", line, outcome.code, outcome.err);
    g_strfreev(words);
    g_free(command);
    return outcome;
}

void expect(const char *socket, const char *line, int code, const char *sentence)
{
    struct outcome outcome = run(socket, line);
    g_assert_cmpint(outcome.code, ==, code);
    if (code && !strstr(outcome.err, sentence))
        g_error("\"%s\" said \"%s\", expected \"%s\"", line, outcome.err, sentence);
    if (!code && !strstr(outcome.out, sentence))
        g_error("\"%s\" printed \"%s\", expected \"%s\"", line, outcome.out, sentence);
    outcome_free(&outcome);
}

void with_stage(struct stage *stage, gconstpointer data)
{
    stage_init(stage);
    stage_open(stage);
    char *plan = g_build_filename(stage->folder, "plan", NULL);
    g_assert_true(g_file_set_contents(plan, "subject = \"still\";", -1, NULL));
    g_free(plan);
}

void end_stage(struct stage *stage, gconstpointer data)
{
    stage_close(stage);
}

char *start_line(const struct stage *stage, const char *options)
{
    return g_strdup_printf("take start --plan %s/plan %s", stage->folder, options);
}
