#include "clients/relight_options.h"

#include "clients/kept_files.h"
#include "clients/numbered_name.h"
#include "clients/region_option.h"
#include "clients/relight_text.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static bool number(const char *text, double *out)
{
    char *end = NULL;
    *out = strtod(text, &end);
    return end != text && *end == '\0' && isfinite(*out);
}

/* "0,15,30" */
static bool set_turns(const char *text, struct ls_relight_options *out)
{
    out->n_turns = 0;
    for (const char *at = text; out->n_turns < LS_RELIGHT_MAX_TURNS; at++) {
        char *end = NULL;
        double turn = strtod(at, &end);
        if (end == at || !isfinite(turn) || (*end != ',' && *end != '\0'))
            return false;
        out->turns[out->n_turns++] = turn;
        if (*end == '\0')
            return true;
        at = end;
    }
    return false;
}

static int read_rows(struct ls_relight_options *out)
{
    struct ls_diag diag = {0};
    ls_row_weights_finish(&out->rows);
    out->solve.rows = &out->rows;
    return ls_row_weights_read(optarg, &out->rows, &diag)
               ? ls_command_wrong("--row-weights %s", diag.text)
               : LS_EXIT_OK;
}

void ls_relight_options_init(struct ls_relight_options *out)
{
    out->promotion =
        (struct lightstage_promotion){.size = sizeof out->promotion, .model = LIGHTSTAGE_SPHERE};
}

int ls_relight_option(struct ls_relight_options *out, int option)
{
    out->solved |= option == LS_RELIGHT_SOLVE || option == LS_RELIGHT_METHOD ||
                   option == LS_RELIGHT_CELLS || option == LS_RELIGHT_TIKHONOV ||
                   option == LS_RELIGHT_ROW_WEIGHTS;
    switch (option) {
    case LS_RELIGHT_RAW:
        out->raw = true;
        return LS_EXIT_OK;
    case LS_RELIGHT_SOLVE:
        return ls_light_solve_option(optarg, &out->solve.solve)
                   ? LS_EXIT_OK
                   : ls_command_wrong("--solve %s: expected spectral, tristimulus, shared or "
                                      "per-target",
                                      optarg);
    case LS_RELIGHT_METHOD:
        return ls_light_method_option(optarg, &out->solve.method)
                   ? LS_EXIT_OK
                   : ls_command_wrong("--method %s: expected nnls or least-squares", optarg);
    case LS_RELIGHT_TIKHONOV:
        out->solve.damped = true;
        return number(optarg, &out->solve.tikhonov) && out->solve.tikhonov >= 0
                   ? LS_EXIT_OK
                   : ls_command_wrong("--tikhonov %s: expected 0 or more, of the mean diagonal",
                                      optarg);
    case LS_RELIGHT_ROW_WEIGHTS:
        return read_rows(out);
    case LS_RELIGHT_CELLS:
        return ls_light_cells_option(optarg, &out->solve.smooth)
                   ? LS_EXIT_OK
                   : ls_command_wrong("--cells %s: expected nearest or smooth", optarg);
    case LS_RELIGHT_PROFILE:
        out->profile = ls_profile_find(optarg);
        return out->profile ? LS_EXIT_OK : ls_command_wrong("--profile %s: expected paper", optarg);
    case LS_RELIGHT_SPACE:
        out->space = strcmp(optarg, "camera-raw") == 0 ? LS_MAP_CAMERA_RAW : LS_MAP_REC709_LINEAR;
        if (out->space == LS_MAP_REC709_LINEAR && strcmp(optarg, "rec709-linear") != 0)
            return ls_command_wrong("--space %s: expected rec709-linear or camera-raw", optarg);
        return LS_EXIT_OK;
    case LS_RELIGHT_MAX_ERROR:
        return number(optarg, &out->max_error) && out->max_error >= 0
                   ? LS_EXIT_OK
                   : ls_command_wrong("--max-error %s: expected 0 or more", optarg);
    case LS_RELIGHT_CAMERA:
        return ls_camera_option(optarg, &out->camera);
    case LS_RELIGHT_LEVEL:
        return ls_level_option(optarg, &out->level);
    case LS_RELIGHT_REGION:
        return ls_region_option(optarg, &out->region);
    default:
        return ls_promotion_option(option, optarg, &out->promotion);
    }
}

int ls_relight_options_settle(struct ls_relight_options *out)
{
    out->solve.model = out->promotion.model;
    if (out->solve.solve == LS_LIGHT_TRISTIMULUS && (out->solve.damped || out->solve.rows))
        return ls_command_wrong("--solve tristimulus solves nothing: leave out --tikhonov and "
                                "--row-weights");
    return LS_EXIT_OK;
}

int ls_relight_use_profile(const struct ls_relight_options *options,
                           struct ls_take_document *document)
{
    if (!options->profile)
        return LS_EXIT_OK;
    if (!document->calibration)
        return ls_command_wrong("--profile %s: the take has no calibration to use it with",
                                options->profile->name);
    memcpy(document->calibration->m, options->profile->m, sizeof document->calibration->m);
    document->calibration->has_m = true;
    return LS_EXIT_OK;
}

/* ---- of relight alone ---- */

enum { OUTPUT = 1, PNG, ROTATE, EXPOSURE, WEIGHTS };

static int set(struct ls_relight_options *out, int option)
{
    out->solved |= option == ROTATE;
    switch (option) {
    case OUTPUT:
        out->exr = optarg;
        return LS_EXIT_OK;
    case PNG:
        out->png = optarg;
        return LS_EXIT_OK;
    case WEIGHTS:
        out->weights = true;
        out->lights[out->n_lights++] = optarg;
        return LS_EXIT_OK;
    case ROTATE:
        return set_turns(optarg, out)
                   ? LS_EXIT_OK
                   : ls_command_wrong("--rotate %s: expected degrees, or at most %d with commas "
                                      "between them",
                                      optarg, LS_RELIGHT_MAX_TURNS);
    case EXPOSURE:
        out->exposure_given = true;
        return number(optarg, &out->exposure) && fabs(out->exposure) <= 60
                   ? LS_EXIT_OK
                   : ls_command_wrong("--exposure %s: expected stops, -60 to 60", optarg);
    default:
        return ls_relight_option(out, option);
    }
}

static int keep_lights(const struct ls_relight_options *options)
{
    struct ls_kept_files kept = {0};
    int code = LS_EXIT_OK;
    if (!ls_kept_files_init(&kept, options->lights, options->n_lights))
        code = (ls_command_wrong("out of memory"), LS_EXIT_INTERNAL);
    for (uint32_t k = 0; k < ls_relight_pictures(options) && !code; k++) {
        char *exr = ls_relight_name(options->exr, k), *png = ls_relight_name(options->png, k);
        if (exr)
            code = ls_kept_files_check(&kept, "--output", exr);
        if (png && !code)
            code = ls_kept_files_check(&kept, "--png", png);
        free(exr);
        free(png);
    }
    ls_kept_files_finish(&kept);
    return code;
}

/* What is left of the command line, and what does not go together. */
static int check(int argc, char **argv, struct ls_relight_options *out)
{
    if (argc - optind < 1 || (out->weights ? argc - optind > 1 : argc - optind < 2))
        return ls_command_wrong("relight: expected %s; relight --help tells more",
                                out->weights ? "one TAKE with --weights"
                                             : "a TAKE and one ENVIRONMENT or more");
    if (out->weights && out->solved)
        return ls_command_wrong("relight: --weights are strengths already: leave out --solve, "
                                "--method, --tikhonov, --row-weights, --cells and --rotate");
    int code = ls_relight_options_settle(out);
    if (code)
        return code;
    out->take = argv[optind];
    for (int i = optind + 1; i < argc; i++)
        out->lights[out->n_lights++] = argv[i];
    if (!out->exr && !out->png)
        return ls_command_wrong("relight: --output FILE.exr or --png FILE.png is needed");
    for (int i = 0; i < 2; i++) {
        const char *name = i ? out->png : out->exr;
        if (name && ls_relight_pictures(out) > 1 && !ls_name_has_number(name))
            return ls_command_wrong("relight: %s for %u pictures: expected a number in the name, "
                                    "as in relit-%%02d.exr",
                                    name, ls_relight_pictures(out));
    }
    return keep_lights(out);
}

int ls_relight_options_parse(struct ls_command_context *context, int argc, char **argv,
                             struct ls_relight_options *out)
{
    static const struct option options[] = {{"output", required_argument, NULL, OUTPUT},
                                            {"png", required_argument, NULL, PNG},
                                            {"rotate", required_argument, NULL, ROTATE},
                                            {"exposure", required_argument, NULL, EXPOSURE},
                                            {"weights", required_argument, NULL, WEIGHTS},
                                            LS_RELIGHT_OPTIONS,
                                            LS_COMMON_OPTIONS};
    ls_relight_options_init(out);
    out->lights = calloc((size_t)argc, sizeof *out->lights);
    out->turns = calloc(LS_RELIGHT_MAX_TURNS, sizeof *out->turns);
    if (!out->lights || !out->turns)
        return ls_command_failed(context, ls_fail(&context->diag, LS_ERR_NOMEM, "out of memory"));
    out->n_turns = 1;
    for (int option;
         (option = ls_command_option(context, &ls_command_relight, argc, argv, options)) != -1;) {
        int code = set(out, option);
        if (code)
            return code;
    }
    return check(argc, argv, out);
}

void ls_relight_options_finish(struct ls_relight_options *options)
{
    free(options->lights);
    free(options->turns);
    ls_row_weights_finish(&options->rows);
    memset(options, 0, sizeof *options);
}

uint32_t ls_relight_pictures(const struct ls_relight_options *options)
{
    return options->n_lights * options->n_turns;
}

const char *ls_relight_light(const struct ls_relight_options *options, uint32_t picture)
{
    return options->lights[picture / options->n_turns];
}

double ls_relight_turn(const struct ls_relight_options *options, uint32_t picture)
{
    return options->turns[picture % options->n_turns];
}
