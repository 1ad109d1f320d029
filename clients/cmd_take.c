#include "clients/command.h"

#include <stdio.h>

/* Options of a command that has only the common ones. */
static bool parse(struct ls_command_context *context, const struct ls_command *command, int argc,
                  char **argv, int n_arguments)
{
    static const struct option options[] = {LS_COMMON_OPTIONS};
    return ls_command_option(context, command, argc, argv, options) == -1 &&
           ls_command_arguments(command, argc, n_arguments);
}

/* ---- list ---- */

static json_t *summary_json(const struct lightstage_take_summary *t)
{
    return json_pack("{ss ss ss sI ss}", "id", t->id, "name", t->name, "state", t->state,
                     "conditions_planned", (json_int_t)t->conditions_planned, "problem",
                     t->problem);
}

static void print_summary(const struct lightstage_take_summary *t)
{
    ls_say("%-40s  %-10s  ", t->id, t->state);
    if (t->problem[0])
        ls_say("%s\n", t->problem);
    else
        printf("%u conditions\n", t->conditions_planned);
}

static int list_one(const struct lightstage_take_summary *take, void *user)
{
    json_t *takes = user;
    if (takes)
        json_array_append_new(takes, summary_json(take));
    else
        print_summary(take);
    return 0;
}

static int run_list(struct ls_command_context *context, int argc, char **argv)
{
    if (!parse(context, &ls_command_take_list, argc, argv, 0))
        return LS_EXIT_USAGE;
    int code = ls_command_open(context);
    if (code)
        return code;
    json_t *takes = context->json ? json_array() : NULL;
    code = ls_command_answered(
        context, lightstage_take_list(context->stage, list_one, takes, &context->error));
    if (takes && !code)
        ls_command_print_json(json_pack("{sO}", "takes", takes));
    json_decref(takes);
    return code;
}

/* ---- show ---- */

static void print_take(const struct lightstage_take_summary *s)
{
    ls_say("take        %s\nstate       %s\nconditions  %u of %u published\npictures    %u x %u\n"
           "lights      %u\n",
           s->id, s->state, s->conditions_published, s->conditions_planned, s->width, s->height,
           s->n_lights);
}

static int print_take_json(struct ls_command_context *context,
                           const struct lightstage_take_summary *s)
{
    json_error_t error;
    char *text = NULL;
    int code = ls_command_answered(
        context, lightstage_take_show(context->stage, s->id, &text, &context->error));
    if (code)
        return code;
    json_t *document = json_loads(text, JSON_REJECT_DUPLICATES, &error);
    lightstage_text_free(text);
    if (!document) {
        ls_fail(&context->diag, LS_ERR_INVALID, "take.json:%d: %s", error.line, error.text);
        return ls_command_failed(context, LS_ERR_INVALID);
    }
    ls_command_print_json(json_pack("{ss ss sI sI sI sI sI so}", "id", s->id, "state", s->state,
                                    "conditions_planned", (json_int_t)s->conditions_planned,
                                    "conditions_published", (json_int_t)s->conditions_published,
                                    "width", (json_int_t)s->width, "height", (json_int_t)s->height,
                                    "lights", (json_int_t)s->n_lights, "take", document));
    return LS_EXIT_OK;
}

static int run_show(struct ls_command_context *context, int argc, char **argv)
{
    struct lightstage_take_summary *summary = NULL;
    if (!parse(context, &ls_command_take_show, argc, argv, 1))
        return LS_EXIT_USAGE;
    int code = ls_command_open(context);
    if (!code)
        code = ls_command_answered(context, lightstage_take_summary(context->stage, argv[optind],
                                                                    &summary, &context->error));
    if (!code && context->json)
        code = print_take_json(context, summary);
    else if (!code)
        print_take(summary);
    lightstage_take_summary_free(summary);
    return code;
}

/* ---- verify ---- */

static void print_verify_json(const struct lightstage_verified *v)
{
    json_t *findings = json_array();
    for (size_t i = 0; i < v->n_findings; i++)
        json_array_append_new(findings, json_string(v->findings[i]));
    ls_command_print_json(json_pack(
        "{sI sI sI sI sI so sI}", "shots_planned", (json_int_t)v->shots_planned, "shots_ticketed",
        (json_int_t)v->shots_ticketed, "conditions_checked", (json_int_t)v->conditions_checked,
        "conditions_missing", (json_int_t)v->conditions_missing, "conditions_damaged",
        (json_int_t)v->conditions_damaged, "findings", findings, "findings_left_out",
        (json_int_t)v->findings_left_out));
}

static void print_verify(const struct lightstage_verified *v)
{
    printf("%u of %u shots have their ticket\n%u pictures checked, %u missing, %u damaged\n",
           v->shots_ticketed, v->shots_planned, v->conditions_checked, v->conditions_missing,
           v->conditions_damaged);
    for (size_t i = 0; i < v->n_findings; i++)
        ls_say("  %s\n", v->findings[i]);
    if (v->findings_left_out)
        printf("  and %u more like these\n", v->findings_left_out);
}

static int run_verify(struct ls_command_context *context, int argc, char **argv)
{
    struct lightstage_verified *verified = NULL;
    if (!parse(context, &ls_command_take_verify, argc, argv, 1))
        return LS_EXIT_USAGE;
    int code = ls_command_open(context);
    if (!code)
        code = ls_command_answered(context, lightstage_take_verify(context->stage, argv[optind],
                                                                   &verified, &context->error));
    if (code)
        return code;
    if (context->json)
        print_verify_json(verified);
    else
        print_verify(verified);
    bool good = verified->conditions_missing == 0 && verified->conditions_damaged == 0 &&
                verified->n_findings == 0;
    lightstage_verified_free(verified);
    return good ? LS_EXIT_OK : LS_EXIT_NO;
}

/* ---- abort ---- */

static int run_abort(struct ls_command_context *context, int argc, char **argv)
{
    if (!parse(context, &ls_command_take_abort, argc, argv, 0))
        return LS_EXIT_USAGE;
    int code = ls_command_open(context);
    if (!code)
        code = ls_command_answered(context, lightstage_take_abort(context->stage, &context->error));
    if (!code)
        puts("aborting; what is stored stays, `take resume` shoots the rest");
    return code;
}

const struct ls_command ls_command_take_list = {"take list", "The takes on disk, oldest first",
                                                "[--json]", run_list};
const struct ls_command ls_command_take_show = {
    "take show", "One take; --json prints its whole document", "TAKE [--json]", run_show};
const struct ls_command ls_command_take_verify = {
    "take verify", "Follow every shot from plan to disk, read every picture back", "TAKE [--json]",
    run_verify};
const struct ls_command ls_command_take_abort = {"take abort", "Stop the running take", "",
                                                 run_abort};
