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
};

static bool parse_number(const char *text, long *out)
{
    char *end;
    *out = strtol(text, &end, 10);
    return *text && !*end && *out >= 0 && *out <= INT32_MAX;
}

static bool take_option(struct changes *c, int option)
{
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

/* Those of enum lightstage_slate_field that change; the daemon keeps the others as they are. */
static uint32_t fields_of(const struct changes *c)
{
    return (c->slate ? LIGHTSTAGE_SLATE : 0u) | (c->scene ? LIGHTSTAGE_SLATE_SCENE : 0u) |
           (c->timecode ? LIGHTSTAGE_SLATE_TIMECODE : 0u) |
           (c->notes ? LIGHTSTAGE_SLATE_NOTES : 0u) |
           (c->number >= 0 ? LIGHTSTAGE_SLATE_TAKE : 0u) |
           (c->circled >= 0 ? LIGHTSTAGE_SLATE_CIRCLED : 0u);
}

static void print(struct ls_command_context *context, const struct lightstage_slate *s)
{
    if (context->json) {
        ls_command_print_json(json_pack("{ss ss sI sb ss ss}", "slate", s->slate, "scene", s->scene,
                                        "take", (json_int_t)s->take, "circled", s->circled,
                                        "timecode", s->timecode, "notes", s->notes));
        return;
    }
    ls_say("slate     %s\nscene     %s\ntake      ", s->slate, s->scene);
    if (s->take)
        printf("%u", s->take);
    ls_say("%s\ntimecode  %s\nnotes     ", s->circled ? " (circled)" : "", s->timecode);
    for (const char *c = s->notes; *c; c++) /* the daemon lets no other control character in */
        if (*c == '\n')
            printf("\n          ");
        else if ((unsigned char)*c >= ' ')
            putchar(*c);
    putchar('\n');
}

static uint32_t ask(struct ls_command_context *context, const char *take, const struct changes *c,
                    struct lightstage_slate **is)
{
    const struct lightstage_slate write = {
        .size = sizeof write,
        .slate = c->slate,
        .scene = c->scene,
        .timecode = c->timecode,
        .notes = c->notes,
        .take = c->number >= 0 ? (uint32_t)c->number : 0,
        .circled = c->circled > 0,
    };
    uint32_t fields = fields_of(c);
    return fields ? lightstage_take_slate_write(context->stage, take, &write, fields, is,
                                                &context->error)
                  : lightstage_take_slate(context->stage, take, is, &context->error);
}

static int run_slate(struct ls_command_context *context, int argc, char **argv)
{
    struct changes changes;
    struct lightstage_slate *is = NULL;
    if (!parse(context, argc, argv, &changes))
        return LS_EXIT_USAGE;
    int code = ls_command_open(context);
    if (!code)
        code = ls_command_answered(context, ask(context, argv[optind], &changes, &is));
    if (code)
        return code;
    print(context, is);
    if (is->damaged)
        fprintf(stderr, "lightstagectl: the slate was damaged and is empty but for this change; "
                        "what was there is slate.damaged.json in the take's folder\n");
    lightstage_slate_free(is);
    return LS_EXIT_OK;
}

const struct ls_command ls_command_take_slate = {
    "take slate", "What is written down about a take; options change it",
    "TAKE [--slate TEXT] [--scene TEXT] [--take N] [--circled yes|no]\n"
    "       [--timecode HH:MM:SS:FF] [--notes TEXT] [--json]",
    run_slate};
