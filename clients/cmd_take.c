#include "clients/command.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Options of a command that has only the common ones. */
static bool parse(struct ls_command_context *context, const struct ls_command *command, int argc,
                  char **argv, int n_arguments)
{
    static const struct option options[] = {LS_COMMON_OPTIONS};
    return ls_command_option(context, command, argc, argv, options) == -1 &&
           ls_command_arguments(command, argc, n_arguments);
}

/* ---- list ---- */

static json_t *summary_json(const Lightstage__TakeSummary *t)
{
    return json_pack("{ss ss ss sI ss}", "id", t->id, "name", t->name, "state", t->state,
                     "conditions_planned", (json_int_t)t->conditions_planned, "problem",
                     t->problem);
}

static void print_summary(const Lightstage__TakeSummary *t)
{
    printf("%-40s  %-10s  ", ls_clean(t->id), ls_clean(t->state));
    if (t->problem[0])
        printf("%s\n", ls_clean(t->problem));
    else
        printf("%u conditions\n", t->conditions_planned);
}

static int receive_list(struct ls_command_context *context, uint32_t request, json_t *takes)
{
    for (bool last = false; !last;) {
        struct ls_reply reply;
        enum ls_err err =
            ls_connection_receive(context->connection, request, &reply, &context->diag);
        if (err)
            return ls_command_failed(context, err);
        const Lightstage__TakeListReply *list = (const Lightstage__TakeListReply *)reply.message;
        for (size_t i = 0; i < list->n_takes; i++)
            if (context->json)
                json_array_append_new(takes, summary_json(list->takes[i]));
            else
                print_summary(list->takes[i]);
        last = reply.last;
        ls_reply_finish(&reply);
    }
    return LS_EXIT_OK;
}

static int run_list(struct ls_command_context *context, int argc, char **argv)
{
    Lightstage__TakeList body = LIGHTSTAGE__TAKE_LIST__INIT;
    uint32_t request = 0;
    if (!parse(context, &ls_command_take_list, argc, argv, 0))
        return LS_EXIT_USAGE;
    int code = ls_command_connect(context);
    if (code)
        return code;
    enum ls_err err = ls_connection_send(context->connection, LS_MESSAGE_TAKE_LIST, &body.base,
                                         NULL, 0, &request, &context->diag);
    if (err)
        return ls_command_failed(context, err);
    json_t *takes = json_array();
    code = receive_list(context, request, takes);
    if (context->json && code == LS_EXIT_OK)
        ls_command_print_json(json_pack("{sO}", "takes", takes));
    json_decref(takes);
    return code;
}

/* ---- show ---- */

static void print_take(const Lightstage__TakeSummary *s)
{
    printf("take        %s\nstate       %s\nconditions  %u of %u published\npictures    %u x %u\n"
           "lights      %u\n",
           ls_clean(s->id), ls_clean(s->state), s->conditions_published, s->conditions_planned,
           s->width, s->height, s->n_lights);
}

static int print_take_json(struct ls_command_context *context, const struct ls_reply *reply,
                           const Lightstage__TakeSummary *s)
{
    json_error_t error;
    json_t *document = json_loadb((const char *)reply->payload, reply->payload_bytes,
                                  JSON_REJECT_DUPLICATES, &error);
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
    Lightstage__TakeShow body = LIGHTSTAGE__TAKE_SHOW__INIT;
    struct ls_reply reply;
    if (!parse(context, &ls_command_take_show, argc, argv, 1))
        return LS_EXIT_USAGE;
    body.take = argv[optind];
    int code = ls_command_call(context, LS_MESSAGE_TAKE_SHOW, &body.base, NULL, 0, &reply);
    if (code)
        return code;
    const Lightstage__TakeSummary *summary =
        ((const Lightstage__TakeShowReply *)reply.message)->summary;
    if (summary && context->json)
        code = print_take_json(context, &reply, summary);
    else if (summary)
        print_take(summary);
    ls_reply_finish(&reply);
    return code;
}

/* ---- verify ---- */

static void print_verify_json(const Lightstage__TakeVerifyReply *v)
{
    json_t *findings = json_array();
    for (size_t i = 0; i < v->n_findings; i++)
        json_array_append_new(findings, json_string(ls_clean(v->findings[i])));
    ls_command_print_json(json_pack(
        "{sI sI sI sI sI so sI}", "shots_planned", (json_int_t)v->shots_planned, "shots_ticketed",
        (json_int_t)v->shots_ticketed, "conditions_checked", (json_int_t)v->conditions_checked,
        "conditions_missing", (json_int_t)v->conditions_missing, "conditions_damaged",
        (json_int_t)v->conditions_damaged, "findings", findings, "findings_left_out",
        (json_int_t)v->findings_left_out));
}

static void print_verify(const Lightstage__TakeVerifyReply *v)
{
    printf("%u of %u shots have their ticket\n%u pictures checked, %u missing, %u damaged\n",
           v->shots_ticketed, v->shots_planned, v->conditions_checked, v->conditions_missing,
           v->conditions_damaged);
    for (size_t i = 0; i < v->n_findings; i++)
        printf("  %s\n", ls_clean(v->findings[i]));
    if (v->findings_left_out)
        printf("  and %u more like these\n", v->findings_left_out);
}

static int run_verify(struct ls_command_context *context, int argc, char **argv)
{
    Lightstage__TakeVerify body = LIGHTSTAGE__TAKE_VERIFY__INIT;
    struct ls_reply reply;
    if (!parse(context, &ls_command_take_verify, argc, argv, 1))
        return LS_EXIT_USAGE;
    body.take = argv[optind];
    int code = ls_command_call(context, LS_MESSAGE_TAKE_VERIFY, &body.base, NULL, 0, &reply);
    if (code)
        return code;
    const Lightstage__TakeVerifyReply *verify = (const Lightstage__TakeVerifyReply *)reply.message;
    if (context->json)
        print_verify_json(verify);
    else
        print_verify(verify);
    bool good = verify->conditions_missing == 0 && verify->conditions_damaged == 0 &&
                verify->n_findings == 0;
    ls_reply_finish(&reply);
    return good ? LS_EXIT_OK : LS_EXIT_NO;
}

/* ---- abort ---- */

static int run_abort(struct ls_command_context *context, int argc, char **argv)
{
    Lightstage__TakeAbort body = LIGHTSTAGE__TAKE_ABORT__INIT;
    struct ls_reply reply;
    if (!parse(context, &ls_command_take_abort, argc, argv, 0))
        return LS_EXIT_USAGE;
    int code = ls_command_call(context, LS_MESSAGE_TAKE_ABORT, &body.base, NULL, 0, &reply);
    if (code)
        return code;
    ls_reply_finish(&reply);
    puts("aborting; what is stored stays, `take resume` shoots the rest");
    return LS_EXIT_OK;
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
