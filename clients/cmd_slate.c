#include "clients/command.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { SLATE = 1, SCENE, NUMBER, CIRCLED, TIMECODE, NOTES };

/** What the command line changes; NULL and -1: nothing. */
struct changes {
    const char *slate, *scene, *timecode, *notes;
    long number;
    int circled;
    bool any;
};

static bool parse_number(const char *text, long *out)
{
    char *end;
    *out = strtol(text, &end, 10);
    return *text && !*end && *out >= 0 && *out <= INT32_MAX;
}

static bool take_option(struct changes *c, int option)
{
    c->any = true;
    switch (option) {
    case SLATE:
        c->slate = optarg;
        return true;
    case SCENE:
        c->scene = optarg;
        return true;
    case TIMECODE:
        c->timecode = optarg;
        return true;
    case NOTES:
        c->notes = optarg;
        return true;
    case NUMBER:
        if (parse_number(optarg, &c->number))
            return true;
        (void)ls_command_wrong("--take \"%s\": expected a number, 0 for none", optarg);
        return false;
    case CIRCLED:
        c->circled = !strcmp(optarg, "yes");
        if (c->circled || !strcmp(optarg, "no"))
            return true;
        (void)ls_command_wrong("--circled \"%s\": expected yes or no", optarg);
        return false;
    default:
        return false;
    }
}

static bool parse(struct ls_command_context *context, int argc, char **argv, struct changes *c)
{
    static const struct option options[] = {{"slate", required_argument, NULL, SLATE},
                                            {"scene", required_argument, NULL, SCENE},
                                            {"take", required_argument, NULL, NUMBER},
                                            {"circled", required_argument, NULL, CIRCLED},
                                            {"timecode", required_argument, NULL, TIMECODE},
                                            {"notes", required_argument, NULL, NOTES},
                                            LS_COMMON_OPTIONS};
    *c = (struct changes){.number = -1, .circled = -1};
    for (int option;
         (option = ls_command_option(context, &ls_command_take_slate, argc, argv, options)) != -1;)
        if (!take_option(c, option))
            return false;
    return ls_command_arguments(&ls_command_take_slate, argc, 1);
}

/* Of a text that changes; the daemon keeps the others as they are. */
static char *text_of(const char *text, uint32_t field, Lightstage__TakeSlate *body)
{
    if (text)
        body->fields[body->n_fields++] = field;
    return (char *)(text ? text : "");
}

static void apply(const struct changes *c, Lightstage__Slate *slate, Lightstage__TakeSlate *body)
{
    slate->slate = text_of(c->slate, 1, body);
    slate->scene = text_of(c->scene, 2, body);
    slate->timecode = text_of(c->timecode, 5, body);
    slate->notes = text_of(c->notes, 6, body);
    if (c->number >= 0) {
        slate->take = (uint32_t)c->number;
        body->fields[body->n_fields++] = 3;
    }
    if (c->circled >= 0) {
        slate->circled = c->circled;
        body->fields[body->n_fields++] = 4;
    }
    body->write = slate;
}

static void print(struct ls_command_context *context, const Lightstage__Slate *s)
{
    if (context->json) {
        ls_command_print_json(json_pack("{ss ss sI sb ss ss}", "slate", s->slate, "scene", s->scene,
                                        "take", (json_int_t)s->take, "circled", s->circled,
                                        "timecode", s->timecode, "notes", s->notes));
        return;
    }
    printf("slate     %s\nscene     %s\ntake      ", ls_clean(s->slate), ls_clean(s->scene));
    if (s->take)
        printf("%u", s->take);
    printf("%s\ntimecode  %s\nnotes     ", s->circled ? " (circled)" : "", ls_clean(s->timecode));
    for (const char *c = s->notes; *c; c++) /* the daemon lets no other control character in */
        if (*c == '\n')
            printf("\n          ");
        else if ((unsigned char)*c >= ' ')
            putchar(*c);
    putchar('\n');
}

static int call(struct ls_command_context *context, const Lightstage__TakeSlate *body,
                struct ls_reply *reply)
{
    int code = ls_command_call(context, LS_MESSAGE_TAKE_SLATE, &body->base, NULL, 0, reply);
    if (code || ((const Lightstage__TakeSlateReply *)reply->message)->slate)
        return code;
    ls_reply_finish(reply);
    ls_fail(&context->diag, LS_ERR_INVALID, "the daemon answered without a slate");
    return ls_command_failed(context, LS_ERR_INVALID);
}

static int run_slate(struct ls_command_context *context, int argc, char **argv)
{
    struct changes changes;
    struct ls_reply reply;
    uint32_t fields[6];
    Lightstage__Slate slate = LIGHTSTAGE__SLATE__INIT;
    Lightstage__TakeSlate body = LIGHTSTAGE__TAKE_SLATE__INIT;
    if (!parse(context, argc, argv, &changes))
        return LS_EXIT_USAGE;
    body.take = argv[optind];
    body.fields = fields;
    if (changes.any)
        apply(&changes, &slate, &body);
    int code = call(context, &body, &reply);
    if (code)
        return code;
    const Lightstage__TakeSlateReply *is = (const Lightstage__TakeSlateReply *)reply.message;
    print(context, is->slate);
    if (is->damaged)
        fprintf(stderr, "lightstagectl: the slate was damaged and is empty but for this change; "
                        "what was there is slate.damaged.json in the take's folder\n");
    ls_reply_finish(&reply);
    return 0;
}

const struct ls_command ls_command_take_slate = {
    "take slate", "What is written down about a take; options change it",
    "TAKE [--slate TEXT] [--scene TEXT] [--take N] [--circled yes|no]\n"
    "       [--timecode HH:MM:SS:FF] [--notes TEXT] [--json]",
    run_slate};
