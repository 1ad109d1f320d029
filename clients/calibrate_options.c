#include "clients/calibrate_options.h"

#include "clients/region_option.h"

#include <stdlib.h>
#include <string.h>

enum {
    OUTPUT = 1,
    BASE,
    PLAN,
    GREY,
    CHROME,
    GLOSS,
    NO_CHROME,
    NO_GLOSS,
    RADIUS,
    REFLECTANCE,
    CAMERA,
    SEGMENTS,
    DARKS,
    YES,
    EXPOSURES,
    GREY_EXPOSURES,
    CHROME_EXPOSURES,
    GLOSS_EXPOSURES,
};

static bool number(const char *text, double low, double high, double *out)
{
    char *end;
    *out = strtod(text, &end);
    return end != text && !*end && *out >= low && *out <= high;
}

static bool whole(const char *text, uint32_t low, uint32_t high, uint32_t *out)
{
    double value;
    bool ok = number(text, low, high, &value);
    *out = ok ? (uint32_t)value : 0;
    return ok && *out == value;
}

/* Digits, commas and spaces: the rest is the daemon's to judge. */
static bool exposures(const char *text, const char **out)
{
    *out = text;
    return text[0] && strlen(text) < 256 && strspn(text, "0123456789, ") == strlen(text);
}

static bool camera_list(const char *text, struct ls_calibrate_options *o)
{
    LS_CLEANUP_FREE uint32_t *list = NULL;
    size_t n = 0;
    if (!ls_lights_option(text, LS_CALIBRATION_MAX_CAMERAS, &list, &n))
        return false;
    memcpy(o->cameras, list, n * sizeof *list);
    o->n_cameras = (uint32_t)n;
    return true;
}

static int parse_number(struct ls_calibrate_options *o, int option)
{
    if (option == RADIUS && !number(optarg, 0.001, 10, &o->radius_m))
        return ls_command_wrong("--radius %s: expected metres, 0.001 to 10", optarg);
    if (option == REFLECTANCE && !number(optarg, 0.01, 1, &o->reflectance))
        return ls_command_wrong("--reflectance %s: expected 0.01 to 1", optarg);
    if (option == CAMERA && !camera_list(optarg, o))
        return ls_command_wrong("--camera %s: expected a camera's number, from 0, or several: 0,1",
                                optarg);
    o->shoot.segments_asked |= option == SEGMENTS;
    if (option == SEGMENTS && !whole(optarg, 0, 4096, &o->shoot.segments))
        return ls_command_wrong("--segments %s: expected 0 to 4096", optarg);
    if (option == DARKS && !whole(optarg, 2, 4096, &o->shoot.darks))
        return ls_command_wrong("--darks %s: expected 2 to 4096", optarg);
    return LS_EXIT_OK;
}

static int parse_option(struct ls_calibrate_options *o, int option)
{
    switch (option) {
    case OUTPUT:
        o->output = optarg;
        return LS_EXIT_OK;
    case BASE:
        o->base = optarg;
        return LS_EXIT_OK;
    case PLAN:
        o->plan = optarg;
        return LS_EXIT_OK;
    case GREY:
    case CHROME:
    case GLOSS:
        o->takes[option - GREY] = optarg;
        return LS_EXIT_OK;
    case NO_CHROME:
        o->skip[LS_OBJECT_CHROME] = true;
        return LS_EXIT_OK;
    case NO_GLOSS:
        o->skip[LS_OBJECT_GLOSS] = true;
        return LS_EXIT_OK;
    case YES:
        o->shoot.yes = true;
        return LS_EXIT_OK;
    case EXPOSURES:
    case GREY_EXPOSURES:
    case CHROME_EXPOSURES:
    case GLOSS_EXPOSURES:
        for (int i = 0; i < LS_N_OBJECTS; i++)
            if ((option == EXPOSURES || option == GREY_EXPOSURES + i) &&
                !exposures(optarg, &o->shoot.exposures_us[i]))
                return ls_command_wrong(
                    "%s: expected microseconds, shortest first, e.g. 100,800,6400", optarg);
        return LS_EXIT_OK;
    default:
        return option == '?' ? LS_EXIT_USAGE : parse_number(o, option);
    }
}

int ls_calibrate_options_parse(struct ls_command_context *context, int argc, char **argv,
                               struct ls_calibrate_options *o)
{
    static const char usual[] = "100, 800, 6400";
    static const struct option options[] = {
        {"output", required_argument, NULL, OUTPUT},
        {"base", required_argument, NULL, BASE},
        {"plan", required_argument, NULL, PLAN},
        {"grey", required_argument, NULL, GREY},
        {"chrome", required_argument, NULL, CHROME},
        {"gloss", required_argument, NULL, GLOSS},
        {"no-chrome", no_argument, NULL, NO_CHROME},
        {"no-gloss", no_argument, NULL, NO_GLOSS},
        {"radius", required_argument, NULL, RADIUS},
        {"reflectance", required_argument, NULL, REFLECTANCE},
        {"camera", required_argument, NULL, CAMERA},
        {"segments", required_argument, NULL, SEGMENTS},
        {"darks", required_argument, NULL, DARKS},
        {"yes", no_argument, NULL, YES},
        {"exposures", required_argument, NULL, EXPOSURES},
        {"grey-exposures", required_argument, NULL, GREY_EXPOSURES},
        {"chrome-exposures", required_argument, NULL, CHROME_EXPOSURES},
        {"gloss-exposures", required_argument, NULL, GLOSS_EXPOSURES},
        LS_COMMON_OPTIONS};
    *o = (struct ls_calibrate_options){
        .radius_m = 0.1,
        .reflectance = 0.33,
        .n_cameras = 1,
        .shoot = {{usual, usual, usual}, .darks = 16, .segments = 14}};
    for (int option;
         (option = ls_command_option(context, &ls_command_calibrate, argc, argv, options)) != -1;) {
        int code = parse_option(o, option);
        if (code)
            return code;
    }
    if (!ls_command_arguments(&ls_command_calibrate, argc, 0))
        return LS_EXIT_USAGE;
    if (!o->output)
        return ls_command_wrong("calibrate: --output FILE is needed");
    for (int i = 0; i < LS_N_OBJECTS; i++)
        if (o->skip[i] && o->takes[i])
            return ls_command_wrong("calibrate: --no-chrome and --no-gloss leave out what --chrome "
                                    "and --gloss name: give one of them");
    if (o->plan && o->takes[LS_OBJECT_GREY])
        return ls_command_wrong(
            "calibrate: --plan says what to photograph, and --grey names a take "
            "that was: give one of them");
    if (!o->takes[LS_OBJECT_GREY] && (o->takes[LS_OBJECT_CHROME] || o->takes[LS_OBJECT_GLOSS]))
        return ls_command_wrong(
            "calibrate: --chrome and --gloss name takes that go with --grey TAKE");
    return LS_EXIT_OK;
}
