#include "clients/command.h"
#include "clients/take_text.h"

#include <stdio.h>
#include <stdlib.h>

static int parse(struct ls_command_context *context, int argc, char **argv,
                 Lightstage__Events *wish)
{
    static const struct option options[] = {{"progress", no_argument, NULL, 'p'},
                                            {"published", no_argument, NULL, 'u'},
                                            {"alarms", no_argument, NULL, 'a'},
                                            LS_COMMON_OPTIONS};
    lightstage__events__init(wish);
    for (int c; (c = ls_command_option(context, &ls_command_events, argc, argv, options)) != -1;) {
        wish->progress |= c == 'p';
        wish->published |= c == 'u';
        wish->alarms |= c == 'a';
        if (c == '?')
            return LS_EXIT_USAGE;
    }
    return ls_command_arguments(&ls_command_events, argc, 0) ? LS_EXIT_OK : LS_EXIT_USAGE;
}

static const char *kind_of(Lightstage__AlarmKind kind)
{
    static const char *const names[] = {"drift", "sweep", "hot", "fault", "disk"};
    return (size_t)kind < sizeof names / sizeof *names ? names[kind] : "other";
}

/* ---- as JSON, an object a line ---- */

static void line(json_t *object)
{
    char *text = object ? json_dumps(object, JSON_COMPACT) : NULL;
    if (text)
        puts(text);
    free(text);
    json_decref(object);
}

static json_t *progress_json(const Lightstage__TakeStatus *status)
{
    json_t *object = json_pack("{ss}", "event", "progress"), *said = ls_take_status_json(status);
    json_object_update(object, said);
    json_decref(said);
    return object;
}

static json_t *published_json(const char *take, const Lightstage__Published *p)
{
    json_t *object = json_pack("{ss ss ss sI}", "event", "published", "take", take, "condition",
                               p->condition, "camera", (json_int_t)p->camera);
    if (p->single_light)
        json_object_set_new(object, "light", json_integer(p->light));
    if (p->channel[0])
        json_object_set_new(object, "channel", json_string(p->channel));
    return object;
}

static void print_json(const Lightstage__EventsReply *reply)
{
    if (reply->progress)
        line(progress_json(reply->progress));
    if (reply->missed)
        line(json_pack("{ss}", "event", "missed"));
    for (size_t i = 0; i < reply->n_published; i++)
        line(published_json(reply->take, reply->published[i]));
    for (size_t i = 0; i < reply->n_alarms; i++) {
        const Lightstage__Alarm *a = reply->alarms[i];
        line(json_pack("{ss ss sb ss ss}", "event", "alarm", "kind", kind_of(a->kind), "active",
                       a->active, "take", a->take, "text", a->text));
    }
}

/* ---- as text ---- */

static void print_published(char *take, const Lightstage__Published *p)
{
    printf("published  %s", ls_clean(take));
    printf("  camera %u  %s\n", p->camera, ls_clean(p->condition));
}

static void print_text(const Lightstage__EventsReply *reply)
{
    const Lightstage__TakeStatus *s = reply->progress;
    if (s)
        printf("progress   %s  %s  %u of %u steps  %u of %u pictures\n",
               s->id[0] ? ls_clean(s->id) : "-", ls_take_state_word(s->state),
               s->progress ? s->progress->steps_bound : 0,
               s->progress ? s->progress->steps_planned : 0,
               s->progress ? s->progress->conditions_stored : 0,
               s->progress ? s->progress->conditions_planned : 0);
    if (reply->missed)
        puts("missed     pictures of the take before were published meanwhile");
    for (size_t i = 0; i < reply->n_published; i++)
        print_published(reply->take, reply->published[i]);
    for (size_t i = 0; i < reply->n_alarms; i++) {
        const Lightstage__Alarm *a = reply->alarms[i];
        printf("%s  %s: %s\n", a->active ? "ALARM    " : "over     ", kind_of(a->kind),
               ls_clean(a->text));
    }
}

/* ---- the command ---- */

static int follow(struct ls_command_context *context, uint32_t request)
{
    for (;;) {
        struct ls_reply reply;
        enum ls_err err =
            ls_connection_receive(context->connection, request, &reply, &context->diag);
        if (err == LS_ERR_ABORTED)
            continue;
        if (err)
            return ls_command_failed(context, err);
        const Lightstage__EventsReply *body = (const Lightstage__EventsReply *)reply.message;
        if (context->json)
            print_json(body);
        else
            print_text(body);
        ls_reply_finish(&reply);
        if (fflush(stdout))
            return ls_command_wrong("standard output: %m");
    }
}

static int run(struct ls_command_context *context, int argc, char **argv)
{
    Lightstage__Events wish;
    uint32_t request = 0;
    int code = parse(context, argc, argv, &wish);
    if (!code)
        code = ls_command_connect(context);
    if (code)
        return code;
    enum ls_err err = ls_connection_send(context->connection, LS_MESSAGE_EVENTS, &wish.base, NULL,
                                         0, &request, &context->diag);
    return err ? ls_command_failed(context, err) : follow(context, request);
}

const struct ls_command ls_command_events = {
    "events", "What happens, a line each, until interrupted: progress, pictures published, alarms",
    "[--progress] [--published] [--alarms] [--json]\n"
    "  --progress   how far the take is, as often as this program keeps up\n"
    "  --published  every picture that can be fetched from now on\n"
    "  --alarms     drift, findings of a sweep, a hot dome, faults, the disk\n"
    "  none of them: all. --json: an object a line",
    run};
