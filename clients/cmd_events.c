#include "clients/command.h"
#include "clients/take_text.h"

#include <stdio.h>
#include <stdlib.h>

/* Which kinds are listened to. */
struct wish {
    bool progress, published, alarms;
};

static int parse(struct ls_command_context *context, int argc, char **argv, struct wish *wish)
{
    static const struct option options[] = {{"progress", no_argument, NULL, 'p'},
                                            {"published", no_argument, NULL, 'u'},
                                            {"alarms", no_argument, NULL, 'a'},
                                            LS_COMMON_OPTIONS};
    for (int c; (c = ls_command_option(context, &ls_command_events, argc, argv, options)) != -1;) {
        wish->progress |= c == 'p';
        wish->published |= c == 'u';
        wish->alarms |= c == 'a';
        if (c == '?')
            return LS_EXIT_USAGE;
    }
    if (!wish->progress && !wish->published && !wish->alarms)
        *wish = (struct wish){true, true, true};
    return ls_command_arguments(&ls_command_events, argc, 0) ? LS_EXIT_OK : LS_EXIT_USAGE;
}

static const char *kind_of(enum lightstage_alarm_kind kind)
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

/* ---- one of a kind; not 0: nobody reads ---- */

static int progress(const struct lightstage_take_status *s, void *user)
{
    const struct ls_command_context *context = user;
    if (context->json) {
        json_t *object = json_pack("{ss}", "event", "progress"), *said = ls_take_status_json(s);
        json_object_update(object, said);
        json_decref(said);
        line(object);
    } else
        ls_say("progress   %s  %s  %u of %u steps  %u of %u pictures\n", s->id[0] ? s->id : "-",
               ls_take_state_word(s->state), s->steps_bound, s->steps_planned, s->conditions_stored,
               s->conditions_planned);
    return fflush(stdout);
}

static json_t *published_json(const struct lightstage_published *p)
{
    json_t *object = json_pack("{ss ss ss sI}", "event", "published", "take", p->take, "condition",
                               p->condition, "camera", (json_int_t)p->camera);
    if (p->single_light)
        json_object_set_new(object, "light", json_integer(p->light));
    if (p->channel[0])
        json_object_set_new(object, "channel", json_string(p->channel));
    return object;
}

static int published(const struct lightstage_published *p, void *user)
{
    const struct ls_command_context *context = user;
    if (context->json)
        line(published_json(p));
    else
        ls_say("published  %s  camera %u  %s\n", p->take, p->camera, p->condition);
    return fflush(stdout);
}

static int missed(void *user)
{
    const struct ls_command_context *context = user;
    if (context->json)
        line(json_pack("{ss}", "event", "missed"));
    else
        puts("missed     pictures of the take before were published meanwhile");
    return fflush(stdout);
}

static int alarmed(const struct lightstage_alarm *a, void *user)
{
    const struct ls_command_context *context = user;
    if (context->json)
        line(json_pack("{ss ss sb ss ss}", "event", "alarm", "kind", kind_of(a->kind), "active",
                       a->active, "take", a->take, "text", a->text));
    else
        ls_say("%s  %s: %s\n", a->active ? "ALARM    " : "over     ", kind_of(a->kind), a->text);
    return fflush(stdout);
}

/* ---- the command ---- */

static int run(struct ls_command_context *context, int argc, char **argv)
{
    struct wish wish = {0};
    int code = parse(context, argc, argv, &wish);
    if (!code)
        code = ls_command_open(context);
    if (code)
        return code;
    const struct lightstage_listener listener = {
        .size = sizeof listener,
        .progress = wish.progress ? progress : NULL,
        .published = wish.published ? published : NULL,
        .missed = wish.published ? missed : NULL,
        .alarm = wish.alarms ? alarmed : NULL,
    };
    uint32_t number = lightstage_events(context->stage, &listener, context, &context->error);
    return ferror(stdout) ? ls_command_wrong("standard output: cannot be written")
                          : ls_command_answered(context, number);
}

const struct ls_command ls_command_events = {
    "events", "What happens, a line each, until interrupted: progress, pictures published, alarms",
    "[--progress] [--published] [--alarms] [--json]\n"
    "  --progress   how far the take is, as often as this program keeps up\n"
    "  --published  every picture that can be fetched from now on\n"
    "  --alarms     drift, findings of a sweep, a hot dome, faults, the disk\n"
    "  none of them: all. --json: an object a line",
    run};
