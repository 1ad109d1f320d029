#include "clients/fetch_options.h"

#include "clients/promotion_option.h"
#include "clients/region_option.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static int layout_option(const char *text, enum lightstage_layout *out)
{
    static const char *const names[] = {"mosaic", "rgb", "mono"};
    for (size_t i = 0; i < sizeof names / sizeof *names; i++)
        if (strcmp(text, names[i]) == 0) {
            *out = (enum lightstage_layout)i;
            return LS_EXIT_OK;
        }
    return ls_command_wrong("--layout %s: expected mosaic, rgb or mono", text);
}

static int max_error_option(const char *text, double *out)
{
    char *end = NULL;
    *out = strtod(text, &end);
    return end != text && !*end && *out > 0 && isfinite(*out)
               ? LS_EXIT_OK
               : ls_command_wrong("--max-error %s: expected more than 0", text);
}

static int parse_option(struct ls_fetch_options *out, int option)
{
    switch (option) {
    case 1:
        out->channel = optarg;
        return LS_EXIT_OK;
    case 2:
        out->lights = optarg;
        return LS_EXIT_OK;
    case 3:
        out->output = optarg;
        return LS_EXIT_OK;
    case 5:
        return layout_option(optarg, &out->layout);
    case 6:
        out->estimate = true;
        return LS_EXIT_OK;
    case 7:
        out->half = true;
        return LS_EXIT_OK;
    case 8:
        out->full_sphere = true;
        return LS_EXIT_OK;
    case 9:
        return ls_region_option(optarg, &out->region);
    case 10:
        return ls_camera_option(optarg, &out->camera);
    case 14:
        return ls_level_option(optarg, &out->level);
    case 12:
        out->validity = true;
        return LS_EXIT_OK;
    case 13:
        out->variance = true;
        return LS_EXIT_OK;
    case 15:
        out->factored = true;
        return LS_EXIT_OK;
    case 16:
        return max_error_option(optarg, &out->max_error);
    case 11:
        out->coefficients = optarg;
        return strcmp(optarg, "harmonics") == 0 || strcmp(optarg, "gradients") == 0
                   ? LS_EXIT_OK
                   : ls_command_wrong("--coefficients %s: expected harmonics or gradients", optarg);
    default:
        out->promoted = true;
        return ls_promotion_option(option, optarg, &out->promotion);
    }
}

/* What is promoted is RGB, gained, and of single lights. */
static int check_promotion(const struct ls_fetch_options *o)
{
    const char *model = lightstage_model_name(o->promotion.model);
    if (o->promotion.model == LIGHTSTAGE_MEASURED)
        return LS_EXIT_OK;
    if (o->full_sphere)
        return ls_command_wrong("fetch: --full-sphere is photographed: leave out --model %s",
                                model);
    if (o->estimate)
        return ls_command_wrong("fetch: --estimate is photographed: leave out --model %s", model);
    if (o->layout == LIGHTSTAGE_MOSAIC)
        return ls_command_wrong("fetch: --model %s makes RGB pictures, as ratios are formed after "
                                "demosaicing: add --layout rgb or mono",
                                model);
    return LS_EXIT_OK;
}

/* A mean or a luminance of products is no product. */
static int check_factored(const struct ls_fetch_options *o)
{
    bool product =
        o->promotion.model == LIGHTSTAGE_SPHERE || o->promotion.model == LIGHTSTAGE_HEADLIGHT;
    if (o->factored && (!product || o->layout != LIGHTSTAGE_RGB || !o->half || o->level))
        return ls_command_wrong("fetch: --factored makes full-size RGB halves: add --layout rgb "
                                "--half and --model sphere or headlight");
    return LS_EXIT_OK;
}

int ls_fetch_options_parse(struct ls_command_context *context, int argc, char **argv,
                           struct ls_fetch_options *out)
{
    static const struct option options[] = {{"channel", required_argument, NULL, 1},
                                            {"lights", required_argument, NULL, 2},
                                            {"output", required_argument, NULL, 3},
                                            {"layout", required_argument, NULL, 5},
                                            {"estimate", no_argument, NULL, 6},
                                            {"half", no_argument, NULL, 7},
                                            {"full-sphere", no_argument, NULL, 8},
                                            {"region", required_argument, NULL, 9},
                                            {"camera", required_argument, NULL, 10},
                                            {"coefficients", required_argument, NULL, 11},
                                            {"validity", no_argument, NULL, 12},
                                            {"variance", no_argument, NULL, 13},
                                            {"level", required_argument, NULL, 14},
                                            {"factored", no_argument, NULL, 15},
                                            {"max-error", required_argument, NULL, 16},
                                            LS_PROMOTION_OPTIONS,
                                            LS_COMMON_OPTIONS};
    *out = (struct ls_fetch_options){.promotion.size = sizeof out->promotion};
    for (int option;
         (option = ls_command_option(context, &ls_command_fetch, argc, argv, options)) != -1;) {
        int code = parse_option(out, option);
        if (code)
            return code;
    }
    if (!ls_command_arguments(&ls_command_fetch, argc, 1))
        return LS_EXIT_USAGE;
    if (!out->channel || !out->output)
        return ls_command_wrong("fetch: --channel NAME and --output PREFIX are needed");
    if (out->full_sphere && out->lights)
        return ls_command_wrong("fetch: --full-sphere is all lights at once: leave out --lights");
    if (out->coefficients && (out->full_sphere || out->lights || out->estimate || out->promoted))
        return ls_command_wrong("fetch: --coefficients are sums over all lights, as photographed: "
                                "leave out --lights, --full-sphere, --estimate and --model");
    if (out->coefficients && (out->level || out->layout == LIGHTSTAGE_MONO))
        return ls_command_wrong("fetch: --coefficients come full size, as mosaic or rgb");
    if ((out->validity || out->variance) &&
        (out->layout != LIGHTSTAGE_MOSAIC || out->level || out->coefficients))
        return ls_command_wrong(
            "fetch: --validity and --variance are of photographed pixels: leave "
            "out --layout, --level and --coefficients");
    if (out->max_error > 0 && (out->validity || out->variance || out->coefficients))
        return ls_command_wrong("fetch: --max-error leaves out tiles of pictures: leave out "
                                "--validity, --variance and --coefficients");
    int code = check_promotion(out);
    return code ? code : check_factored(out);
}
