#include "clients/command.h"
#include "clients/plan_text.h"
#include "clients/take_follow.h"
#include "clients/take_text.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

struct options {
    const char *name, *plan, *custom, *take; /* take: of resume */
    char token[64];
    bool no_wait, sweep;
};

/* Common to start and resume; -1 = go on. */
static int parse(struct ls_command_context *context, const struct ls_command *command, int argc,
                 char **argv, struct options *out)
{
    enum { NAME = 1, PLAN, CUSTOM, SWEEP, TOKEN, NO_WAIT };
    static const struct option options[] = {{"name", required_argument, NULL, NAME},
                                            {"plan", required_argument, NULL, PLAN},
                                            {"custom", required_argument, NULL, CUSTOM},
                                            {"sweep", no_argument, NULL, SWEEP},
                                            {"token", required_argument, NULL, TOKEN},
                                            {"no-wait", no_argument, NULL, NO_WAIT},
                                            LS_COMMON_OPTIONS};
    for (int option; (option = ls_command_option(context, command, argc, argv, options)) != -1;) {
        if (option == NAME)
            out->name = optarg;
        else if (option == PLAN)
            out->plan = optarg;
        else if (option == CUSTOM)
            out->custom = optarg;
        else if (option == SWEEP)
            out->sweep = true;
        else if (option == NO_WAIT)
            out->no_wait = true;
        else if (option != TOKEN)
            return LS_EXIT_USAGE;
        else if (strlen(optarg) < 1 || strlen(optarg) >= sizeof out->token)
            return ls_command_wrong("--token: expected 1 to 63 characters");
        else
            snprintf(out->token, sizeof out->token, "%s", optarg);
    }
    if (!out->token[0] && !ls_take_token(out->token))
        return ls_command_wrong("no random numbers for a token; give one with --token");
    return -1;
}

static void print_started(struct ls_command_context *context,
                          const struct lightstage_started *started, const char *token)
{
    const char *id = started->take->id;
    if (context->json)
        ls_command_print_json(
            json_pack("{ss ss sb}", "token", token, "id", id, "already", started->already));
    else
        printf("%s%s%s, token %s\n", started->already ? "started before" : "started",
               id[0] ? ": " : "", id, token);
}

/* By a plan, or of what the take lacks. */
static int start(struct ls_command_context *context, const char *plan,
                 const struct options *options)
{
    struct lightstage_started *started = NULL;
    int code = ls_command_open(context);
    if (code)
        return code;
    ls_take_follow_signals();
    code = ls_command_answered(
        context, plan ? lightstage_take_start(context->stage, options->name, options->token, plan,
                                              &started, &context->error)
                      : lightstage_take_resume(context->stage, options->take, options->token,
                                               &started, &context->error));
    if (code == LS_EXIT_UNREACHABLE)
        fprintf(stderr,
                "lightstagectl: whether the take has started is not known; the same command with "
                "--token %s starts it at most once\n",
                options->token);
    if (!code && options->no_wait)
        print_started(context, started, options->token);
    else if (!code)
        code = ls_take_follow(context, options->token);
    lightstage_started_free(started);
    return code;
}

static int run_start(struct ls_command_context *context, int argc, char **argv)
{
    struct options options = {.name = "take"};
    char *text = NULL;
    size_t n = 0;
    int code = parse(context, &ls_command_take_start, argc, argv, &options);
    if (code >= 0 || !ls_command_arguments(&ls_command_take_start, argc, 0))
        return LS_EXIT_USAGE;
    if (!options.plan)
        return ls_command_wrong("take start: --plan FILE is needed");
    enum ls_err err =
        ls_plan_text_read(options.plan, options.custom, options.sweep, &text, &n, &context->diag);
    if (err)
        return ls_command_failed(context, err);
    code = start(context, text, &options);
    free(text);
    return code;
}

static int run_resume(struct ls_command_context *context, int argc, char **argv)
{
    struct options options = {0};
    int code = parse(context, &ls_command_take_resume, argc, argv, &options);
    if (code >= 0 || !ls_command_arguments(&ls_command_take_resume, argc, 1))
        return LS_EXIT_USAGE;
    if (options.plan || options.custom || options.sweep || options.name)
        return ls_command_wrong("take resume: the plan and the name are those of the take");
    options.take = argv[optind];
    return start(context, NULL, &options);
}

const struct ls_command ls_command_take_start = {
    "take start", "Photograph a plan and wait for its end (Ctrl-C aborts)",
    "--plan FILE [--custom FILE] [--sweep] [--name NAME] [--token TOKEN] [--no-wait] [--json]",
    run_start};
const struct ls_command ls_command_take_resume = {"take resume", "Shoot what a take is missing",
                                                  "TAKE [--token TOKEN] [--no-wait] [--json]",
                                                  run_resume};
