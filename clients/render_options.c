#include "clients/render_options.h"

#include <stdlib.h>
#include <string.h>
#include <unistd.h>

enum { OUTPUT = 1, FRAMES, ROTATE, JOBS, AGAIN, QUIET, VERSION };

/* What is needed before the frames are known. */
struct given {
    const char *output;
    struct ls_frame_range range;
    double turn[2];
};

static uint32_t default_jobs(void)
{
    long n = sysconf(_SC_NPROCESSORS_ONLN);
    return n < 2 ? 1 : n < 8 ? 2 : 4;
}

static int set(struct ls_render_options *out, struct given *given, int option)
{
    char *end;
    switch (option) {
    case OUTPUT:
        given->output = optarg;
        return LS_EXIT_OK;
    case FRAMES:
        return ls_frame_range_option(optarg, &given->range)
                   ? LS_EXIT_OK
                   : ls_command_wrong("--frames %s: expected 7, 1-48 or 1-48x2, at most a million",
                                      optarg);
    case ROTATE:
        return ls_turn_range_option(optarg, given->turn)
                   ? LS_EXIT_OK
                   : ls_command_wrong("--rotate %s: expected degrees FROM,TO", optarg);
    case JOBS:
        out->jobs = (uint32_t)strtoul(optarg, &end, 10);
        return !*end && *optarg >= '0' && *optarg <= '9' && out->jobs >= 1 &&
                       out->jobs <= LS_RENDER_MAX_JOBS
                   ? LS_EXIT_OK
                   : ls_command_wrong("--jobs %s: expected 1 to %d", optarg, LS_RENDER_MAX_JOBS);
    case AGAIN:
        out->again = true;
        return LS_EXIT_OK;
    case QUIET:
        out->quiet = true;
        return LS_EXIT_OK;
    default:
        return ls_relight_option(&out->relight, option);
    }
}

int ls_render_options_parse(struct ls_command_context *context, int argc, char **argv,
                            struct ls_render_options *out)
{
    static const struct option options[] = {{"output", required_argument, NULL, OUTPUT},
                                            {"frames", required_argument, NULL, FRAMES},
                                            {"rotate", required_argument, NULL, ROTATE},
                                            {"jobs", required_argument, NULL, JOBS},
                                            {"again", no_argument, NULL, AGAIN},
                                            {"quiet", no_argument, NULL, QUIET},
                                            {"version", no_argument, NULL, VERSION},
                                            LS_RELIGHT_OPTIONS,
                                            LS_COMMON_OPTIONS};
    struct given given = {0};
    out->jobs = default_jobs();
    ls_relight_options_init(&out->relight);
    for (int option;
         (option = ls_command_option(context, &ls_command_render, argc, argv, options)) != -1;) {
        if (option == VERSION) {
            puts("lightstage-render " LS_VERSION);
            exit(ls_command_end(LS_EXIT_OK));
        }
        int code = set(out, &given, option);
        if (code)
            return code;
    }
    int code = ls_relight_options_settle(&out->relight);
    if (code)
        return code;
    if (argc - optind < 2)
        return ls_command_wrong("expected a TAKE and an ENVIRONMENT or more; --help tells more");
    if (!given.output)
        return ls_command_wrong("--output FOLDER/NAME.%%04d.exr is needed");
    out->relight.take = argv[optind];
    return ls_render_frames_make((const char *const *)argv + optind + 1,
                                 (uint32_t)(argc - optind - 1), &given.range, given.turn,
                                 given.output, &out->frames);
}

void ls_render_options_finish(struct ls_render_options *options)
{
    ls_render_frames_finish(&options->frames);
    ls_relight_options_finish(&options->relight);
}
