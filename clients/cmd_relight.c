#include "clients/command.h"
#include "clients/environment_file.h"
#include "clients/light_weights.h"
#include "clients/picture_attrs.h"
#include "clients/picture_file.h"
#include "clients/promotion_option.h"
#include "clients/promotion_report.h"
#include "clients/region_option.h"
#include "clients/take_document.h"
#include "clients/weights_file.h"
#include "core/profile.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

struct options {
    const char *exr, *png;
    const char *light; /* what the take is relit with: the environment, or weights */
    bool weights;
    bool solved; /* an option of the environment's solve was given */
    bool raw;
    struct ls_light_options solve;
    const struct ls_profile *profile;
    double exposure, max_error;
    bool exposure_given;
    Lightstage__Promotion promotion;
    enum ls_map_space space;
    uint32_t camera;
    Lightstage__Region region;
};

/* What came back. */
struct result {
    struct ls_image image;
    struct ls_promotion_report report;
    uint32_t lights_used, lights_skipped;
    uint64_t tiles_skipped;
    double bound, seconds;
    bool calibrated;
};

/* ---- command line ---- */

static bool number(const char *text, double *out)
{
    char *end = NULL;
    *out = strtod(text, &end);
    return end != text && *end == '\0' && isfinite(*out);
}

/* One option; LS_EXIT_OK or the exit code. */
static int set(struct options *out, int option)
{
    enum { OUTPUT = 1, PNG, SOLVE, ROTATE, RAW, SPACE, REGION, EXPOSURE, MAX_ERROR, WEIGHTS,
           CAMERA, METHOD, CELLS, PROFILE };
    out->solved |= option == SOLVE || option == METHOD || option == CELLS || option == ROTATE;
    switch (option) {
    case OUTPUT:
        out->exr = optarg;
        return LS_EXIT_OK;
    case PNG:
        out->png = optarg;
        return LS_EXIT_OK;
    case WEIGHTS:
        out->weights = true;
        out->light = optarg;
        return LS_EXIT_OK;
    case RAW:
        out->raw = true;
        return LS_EXIT_OK;
    case SOLVE:
        return ls_light_solve_option(optarg, &out->solve.solve)
                   ? LS_EXIT_OK
                   : ls_command_wrong("--solve %s: expected spectral, tristimulus, shared or "
                                      "per-target", optarg);
    case METHOD:
        return ls_light_method_option(optarg, &out->solve.method)
                   ? LS_EXIT_OK
                   : ls_command_wrong("--method %s: expected nnls or least-squares", optarg);
    case CELLS:
        return ls_light_cells_option(optarg, &out->solve.smooth)
                   ? LS_EXIT_OK
                   : ls_command_wrong("--cells %s: expected nearest or smooth", optarg);
    case PROFILE:
        out->profile = ls_profile_find(optarg);
        return out->profile ? LS_EXIT_OK
                            : ls_command_wrong("--profile %s: expected paper", optarg);
    case SPACE:
        out->space = strcmp(optarg, "camera-raw") == 0 ? LS_MAP_CAMERA_RAW : LS_MAP_REC709_LINEAR;
        if (out->space == LS_MAP_REC709_LINEAR && strcmp(optarg, "rec709-linear") != 0)
            return ls_command_wrong("--space %s: expected rec709-linear or camera-raw", optarg);
        return LS_EXIT_OK;
    case ROTATE:
        return number(optarg, &out->solve.turn_deg)
                   ? LS_EXIT_OK
                   : ls_command_wrong("--rotate %s: expected degrees", optarg);
    case EXPOSURE:
        out->exposure_given = true;
        return number(optarg, &out->exposure) && fabs(out->exposure) <= 60
                   ? LS_EXIT_OK
                   : ls_command_wrong("--exposure %s: expected stops, -60 to 60", optarg);
    case MAX_ERROR:
        return number(optarg, &out->max_error) && out->max_error >= 0
                   ? LS_EXIT_OK
                   : ls_command_wrong("--max-error %s: expected 0 or more", optarg);
    case CAMERA:
        return ls_camera_option(optarg, &out->camera)
                   ? LS_EXIT_OK
                   : ls_command_wrong("--camera %s: expected the number of a camera, from 0",
                                      optarg);
    case REGION:
        return ls_region_option(optarg, &out->region)
                   ? LS_EXIT_OK
                   : ls_command_wrong("--region %s: expected X,Y,WIDTH,HEIGHT", optarg);
    default:
        return ls_promotion_option(option, optarg, &out->promotion);
    }
}

static int parse(struct ls_command_context *context, int argc, char **argv, struct options *out)
{
    static const struct option options[] = {{"output", required_argument, NULL, 1},
                                            {"png", required_argument, NULL, 2},
                                            {"solve", required_argument, NULL, 3},
                                            {"rotate", required_argument, NULL, 4},
                                            {"raw", no_argument, NULL, 5},
                                            {"space", required_argument, NULL, 6},
                                            {"region", required_argument, NULL, 7},
                                            {"exposure", required_argument, NULL, 8},
                                            {"max-error", required_argument, NULL, 9},
                                            {"weights", required_argument, NULL, 10},
                                            {"camera", required_argument, NULL, 11},
                                            {"method", required_argument, NULL, 12},
                                            {"cells", required_argument, NULL, 13},
                                            {"profile", required_argument, NULL, 14},
                                            LS_PROMOTION_OPTIONS,
                                            LS_COMMON_OPTIONS};
    lightstage__promotion__init(&out->promotion);
    out->promotion.model = LIGHTSTAGE__MODEL__SPHERE;
    lightstage__region__init(&out->region);
    for (int option;
         (option = ls_command_option(context, &ls_command_relight, argc, argv, options)) != -1;) {
        int code = set(out, option);
        if (code)
            return code;
    }
    if (!ls_command_arguments(&ls_command_relight, argc, out->weights ? 1 : 2))
        return LS_EXIT_USAGE;
    if (out->weights && out->solved)
        return ls_command_wrong("relight: --weights are strengths already: leave out --solve, "
                                "--method, --cells and --rotate");
    out->solve.model = out->promotion.model;
    if (!out->weights)
        out->light = argv[optind + 1];
    if (!out->exr && !out->png)
        return ls_command_wrong("relight: --output FILE.exr or --png FILE.png is needed");
    return LS_EXIT_OK;
}

/* ---- asking ---- */

static enum ls_err place_band(struct result *result, const struct ls_reply *reply,
                              struct ls_diag *diag)
{
    const Lightstage__RelightReply *band = (const Lightstage__RelightReply *)reply->message;
    enum ls_err err = LS_OK;
    if (!result->image.pixels)
        err = ls_image_init(&result->image, band->width, band->height, 3, (size_t)4 << 30, diag);
    if (err)
        return err;
    size_t row = (size_t)result->image.width * 3 * sizeof(float);
    if (band->first_row > result->image.height ||
        band->n_rows > result->image.height - band->first_row ||
        reply->payload_bytes != band->n_rows * row)
        return ls_fail(diag, LS_ERR_INVALID, "the daemon sent rows that do not fit the picture");
    if (band->n_rows > 0)
        memcpy(result->image.pixels + (size_t)band->first_row * result->image.width * 3,
               reply->payload, reply->payload_bytes);
    ls_promotion_report_keep(&result->report, band->spectra, band->n_spectra);
    result->calibrated = band->calibrated;
    result->lights_used = band->lights_used;
    result->lights_skipped = band->lights_skipped;
    result->tiles_skipped = band->tiles_skipped;
    result->bound = band->error_bound;
    result->seconds = band->seconds;
    return LS_OK;
}

static enum ls_err receive(struct ls_connection *connection, uint32_t request,
                           struct result *result, struct ls_diag *diag)
{
    for (bool last = false; !last;) {
        struct ls_reply reply;
        enum ls_err err = ls_connection_receive(connection, request, &reply, diag);
        if (!err && reply.type != (LS_MESSAGE_RELIGHT | LS_MESSAGE_REPLY))
            err = ls_fail(diag, LS_ERR_INVALID, "the daemon answered with another message");
        if (!err)
            err = place_band(result, &reply, diag);
        last = reply.last;
        ls_reply_finish(&reply);
        if (err)
            return err;
    }
    return LS_OK;
}

static int ask(struct ls_command_context *context, const char *take, const struct options *options,
               struct ls_light_weights *weights, struct result *result)
{
    Lightstage__Relight body = LIGHTSTAGE__RELIGHT__INIT;
    Lightstage__Region region = options->region;
    Lightstage__Promotion promotion = options->promotion;
    uint32_t request = 0;
    body.promotion = &promotion;
    body.take = (char *)take;
    body.mode = weights->mode;
    body.n_channels = weights->n_names;
    body.channels = weights->names;
    body.n_lights = weights->n_lights;
    body.region = &region;
    body.max_error = options->max_error;
    body.camera = options->camera;
    enum ls_err err = ls_connection_send(
        context->connection, LS_MESSAGE_RELIGHT, &body.base, weights->rows,
        (size_t)weights->n_rows * weights->n_lights * sizeof(float), &request, &context->diag);
    if (!err)
        err = receive(context->connection, request, result, &context->diag);
    return err ? ls_command_failed(context, err) : LS_EXIT_OK;
}

/* One channel of the picture from camera RGB: a row of M. */
static enum ls_err place_target(const double row[3], int target, const struct ls_image *raw,
                                struct ls_image *out, struct ls_diag *diag)
{
    enum ls_err err = LS_OK;
    if (!out->pixels)
        err = ls_image_init(out, raw->width, raw->height, 3, (size_t)4 << 30, diag);
    for (size_t i = 0; !err && i < (size_t)out->width * out->height; i++) {
        const float *v = raw->pixels + 3 * i;
        out->pixels[3 * i + (size_t)target] =
            (float)(row[0] * (double)v[0] + row[1] * (double)v[1] + row[2] * (double)v[2]);
    }
    return err;
}

/* Per-target strengths after M: out_t = M_t . (field weighted with the strengths of t). */
static int ask_by_target(struct ls_command_context *context,
                         const struct ls_take_document *document, const struct options *options,
                         const struct ls_light_weights *weights, struct result *result)
{
    struct ls_image picture = {0};
    double bound = 0, seconds = 0;
    enum ls_err err = LS_OK;
    for (int t = 0; !err && t < 3; t++) {
        const double *row = document->calibration->m[t];
        struct ls_light_weights one = *weights;
        one.n_rows = weights->n_names;
        one.rows += (size_t)t * weights->n_names * weights->n_lights;
        ls_image_finish(&result->image);
        int code = ask(context, document->id, options, &one, result);
        if (code) {
            ls_image_finish(&picture);
            return code;
        }
        bound = fmax(bound, result->bound * (fabs(row[0]) + fabs(row[1]) + fabs(row[2])));
        seconds += result->seconds;
        err = place_target(row, t, &result->image, &picture, &context->diag);
    }
    ls_image_finish(&result->image);
    result->image = picture;
    result->bound = bound;
    result->seconds = seconds;
    return err ? ls_command_failed(context, err) : LS_EXIT_OK;
}

/* ---- writing ---- */

static void apply_m(const struct ls_take_document *document, const struct ls_image *in,
                    struct ls_image *out)
{
    const double(*m)[3] = (const double(*)[3])document->calibration->m;
    for (size_t i = 0; i < (size_t)in->width * in->height; i++)
        for (int r = 0; r < 3; r++) {
            const float *v = in->pixels + 3 * i;
            out->pixels[3 * i + r] =
                (float)(m[r][0] * (double)v[0] + m[r][1] * (double)v[1] + m[r][2] * (double)v[2]);
        }
}

/* The picture in Rec. 709, if that can be had. *in_rec709 says. */
static enum ls_err to_rec709(const struct ls_take_document *document,
                             const struct ls_light_weights *weights, const struct ls_image *raw,
                             struct ls_image *out, bool *in_rec709, struct ls_diag *diag)
{
    enum ls_err err = ls_image_init(out, raw->width, raw->height, 3, SIZE_MAX, diag);
    bool has_m = document->calibration && document->calibration->has_m && !document->mono;
    *in_rec709 = has_m || weights->after_m;
    if (err)
        return err;
    if (has_m && !weights->after_m)
        apply_m(document, raw, out);
    else
        memcpy(out->pixels, raw->pixels, (size_t)raw->width * raw->height * 3 * sizeof(float));
    return LS_OK;
}

static enum ls_err write_exr(const struct options *options, const struct ls_take_document *document,
                             const struct ls_image *image, const struct result *result,
                             bool rec709, struct ls_diag *diag)
{
    static const float primaries[8] = {0.64f, 0.33f, 0.30f, 0.60f, 0.15f, 0.06f, 0.3127f, 0.3290f};
    struct ls_exr_attrs attrs = {0};
    const struct ls_picture_place place = {(int32_t)options->region.x, (int32_t)options->region.y,
                                           document->width, document->height};
    const char *file = strrchr(options->light, '/');
    ls_picture_attrs_take(document, result->calibrated, &attrs);
    ls_promotion_report_attrs(&result->report, options->solve.solve == LS_LIGHT_TRISTIMULUS,
                              &attrs);
    ls_exr_attrs_string(&attrs, "lightstage/environment", file ? file + 1 : options->light);
    ls_exr_attrs_string(&attrs, "lightstage/units", rec709 ? "rec709-linear" : "camera-raw");
    ls_exr_attrs_float(&attrs, "lightstage/rotation", (float)options->solve.turn_deg);
    if (rec709)
        ls_exr_attrs_chromaticities(&attrs, "chromaticities", primaries);
    enum ls_err err =
        ls_picture_file_exr(options->exr, image, LS_EXR_FLOAT, &place, &attrs, diag);
    ls_exr_attrs_finish(&attrs);
    return err;
}

static enum ls_err write_pictures(const struct options *options,
                                  const struct ls_take_document *document,
                                  const struct ls_light_weights *weights,
                                  const struct result *result, struct ls_diag *diag)
{
    struct ls_image shown = {0};
    bool rec709 = false;
    float scale = options->exposure_given ? exp2f((float)options->exposure) : 0;
    enum ls_err err = to_rec709(document, weights, &result->image, &shown, &rec709, diag);
    if (!err && !rec709)
        fputs("lightstagectl: warning: the take has no matrix M: the picture stays in the camera's "
              "own colours\n", stderr);
    if (!err && options->exr)
        err = write_exr(options, document, options->raw ? &result->image : &shown, result,
                        rec709 && (!options->raw || weights->after_m), diag);
    if (!err && options->png)
        err = ls_picture_file_png(options->png, &shown, scale, NULL, diag);
    ls_image_finish(&shown);
    return err;
}

/* What the solve of the strengths was, and how well it went; NULL where there was none. */
static json_t *solve_json(const struct ls_light_weights *weights)
{
    const struct ls_lighting_solution *solution = &weights->solution;
    if (!weights->solved)
        return NULL;
    json_t *json = json_pack(
        "{ss ss sf sf si}", "mode", solution->mode == LS_SOLVE_SHARED ? "shared" : "per-target",
        "space", solution->space == LS_SOLVE_AFTER_M ? "after-M" : "camera-raw", "residual",
        weights->residual, "worst_residual", solution->worst.relative, "rank",
        (int)solution->worst.rank);
    if (isfinite(solution->worst.condition))
        json_object_set_new(json, "condition", json_real(solution->worst.condition));
    return json;
}

static void print_result(const struct ls_command_context *context, const struct options *options,
                         const struct ls_light_weights *weights, const struct result *result)
{
    if (weights->warning)
        fprintf(stderr, "lightstagectl: warning: %s\n", weights->warning);
    if (weights->left_out[0])
        fprintf(stderr, "lightstagectl: warning: %s\n", weights->left_out);
    if (weights->unreachable > 0.001)
        fprintf(stderr,
                "lightstagectl: warning: %.1f %% of the map's light has colours no light can have; "
                "the nearest were taken\n", weights->unreachable * 100);
    if (!context->json) {
        printf("%u lights used, %u skipped, error bound %.3g, %.2f s\n", result->lights_used,
               result->lights_skipped, result->bound, result->seconds);
        ls_promotion_report_print(&result->report);
        return;
    }
    ls_command_print_json(json_pack(
        "{si si sI sf sf sf sf sb so* so ss* ss*}", "lights_used", (int)result->lights_used,
        "lights_skipped", (int)result->lights_skipped, "tiles_skipped",
        (json_int_t)result->tiles_skipped, "error_bound", result->bound, "seconds",
        result->seconds, "solve_residual", weights->solution.worst.relative, "unreachable",
        weights->unreachable, "calibrated", result->calibrated, "solve", solve_json(weights),
        "spectra", ls_promotion_report_json(&result->report), "output", options->exr, "png",
        options->png));
}

/* ---- the command ---- */

static enum ls_err make_weights(const struct options *options,
                                const struct ls_take_document *document,
                                struct ls_light_weights *weights, struct ls_diag *diag)
{
    struct ls_environment_file environment;
    if (options->weights)
        return ls_weights_file_read(options->light, document, weights, diag)
                   ? LS_ERR_INVALID
                   : LS_OK;
    if (ls_environment_file_read(options->light, options->space, options->profile, &environment, diag))
        return LS_ERR_INVALID;
    enum ls_err err = ls_light_weights_make(document, &environment, &options->solve, weights, diag);
    ls_environment_file_finish(&environment);
    return err;
}

static int relight(struct ls_command_context *context, const struct options *options,
                   const struct ls_take_document *document)
{
    struct ls_light_weights weights = {0};
    struct result result = {0};
    enum ls_err err = make_weights(options, document, &weights, &context->diag);
    if (err)
        return ls_command_failed(context, err);
    int code = weights.by_target ? ask_by_target(context, document, options, &weights, &result)
                                 : ask(context, document->id, options, &weights, &result);
    if (code == LS_EXIT_OK) {
        err = write_pictures(options, document, &weights, &result, &context->diag);
        if (err)
            code = ls_command_failed(context, err);
        else
            print_result(context, options, &weights, &result);
    }
    ls_image_finish(&result.image);
    ls_light_weights_finish(&weights);
    return code;
}

/* A matrix that was asked for by name takes the place of the calibration's. */
static int use_profile(const struct options *options, struct ls_take_document *document)
{
    if (!document->calibration)
        return ls_command_wrong("--profile %s: the take has no calibration to use it with",
                                options->profile->name);
    memcpy(document->calibration->m, options->profile->m, sizeof document->calibration->m);
    document->calibration->has_m = true;
    return LS_EXIT_OK;
}

static int run(struct ls_command_context *context, int argc, char **argv)
{
    struct options options = {0};
    struct ls_take_document *document = NULL;
    int code = parse(context, argc, argv, &options);
    if (!code)
        code = ls_take_document_get(context, argv[optind], options.camera, &document);
    if (code)
        return code;
    if (options.profile)
        code = use_profile(&options, document);
    if (!code)
        code = relight(context, &options, document);
    ls_take_document_destroy(document);
    return code;
}

const struct ls_command ls_command_relight = {
    "relight", "A take under another light: a lat-long .hdr or .exr, or lobes or a captured light as .json",
    "TAKE ENVIRONMENT --output FILE.exr [--png FILE.png] [--raw]\n"
    "         [--solve spectral|tristimulus|shared|per-target] [--method nnls|least-squares]\n"
    "         [--cells nearest|smooth] [--profile paper]\n"
    "         [--rotate DEG] [--space rec709-linear|camera-raw]\n"
    LS_PROMOTION_USAGE
    "         [--region X,Y,WIDTH,HEIGHT] [--exposure STOPS] [--max-error E]\n"
    "         [--camera N] [--json]\n"
    "       lightstagectl relight TAKE --weights FILE.json --output FILE.exr [...]\n"
    "         instead of an environment: {\"W\": [one per light, radiance x sr], ...}",
    run};
