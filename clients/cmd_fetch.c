#include "clients/command.h"
#include "clients/fetch_coefficients.h"
#include "clients/picture_attrs.h"
#include "clients/picture_file.h"
#include "clients/pixel_quality.h"
#include "clients/promotion_option.h"
#include "clients/promotion_report.h"
#include "clients/received_band.h"
#include "clients/region_option.h"
#include "clients/take_document.h"
#include "proto/models.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

struct options {
    const char *channel, *lights, *output;
    const char *coefficients; /* "harmonics", "gradients", or NULL: lights */
    Lightstage__Promotion promotion;
    Lightstage__Layout layout;
    bool estimate, half, full_sphere, promoted, validity, variance;
    uint32_t camera, level;
    Lightstage__Region region;
};

/* The picture being received, and the files written so far. */
struct fetch {
    struct ls_command_context *context;
    const struct options *options;
    const struct ls_take_document *document;
    struct ls_image image;
    struct ls_pixel_quality quality;
    struct ls_promotion_report report; /* of the last picture that came with one */
    json_t *frames;
    char *csv; /* text of the list, malloc */
    size_t csv_bytes;
    FILE *csv_stream; /* into it */
};

static int layout_option(const char *text, Lightstage__Layout *out)
{
    static const char *const names[] = {"mosaic", "rgb", "mono"};
    for (size_t i = 0; i < sizeof names / sizeof *names; i++)
        if (strcmp(text, names[i]) == 0) {
            *out = (Lightstage__Layout)i;
            return LS_EXIT_OK;
        }
    return ls_command_wrong("--layout %s: expected mosaic, rgb or mono", text);
}

static int parse_option(struct options *out, int option)
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
        return ls_region_option(optarg, &out->region)
                   ? LS_EXIT_OK
                   : ls_command_wrong("--region %s: expected X,Y,WIDTH,HEIGHT", optarg);
    case 10:
        return ls_camera_option(optarg, &out->camera)
                   ? LS_EXIT_OK
                   : ls_command_wrong("--camera %s: expected the number of a camera, from 0",
                                      optarg);
    case 14:
        return ls_level_option(optarg, &out->level)
                   ? LS_EXIT_OK
                   : ls_command_wrong("--level %s: expected 0 (full size), 1 or 2", optarg);
    case 12:
        out->validity = true;
        return LS_EXIT_OK;
    case 13:
        out->variance = true;
        return LS_EXIT_OK;
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
static int check_promotion(const struct options *o)
{
    const char *model = ls_model_name(o->promotion.model);
    if (o->promotion.model == LIGHTSTAGE__MODEL__MEASURED)
        return LS_EXIT_OK;
    if (o->full_sphere)
        return ls_command_wrong("fetch: --full-sphere is photographed: leave out --model %s",
                                model);
    if (o->estimate)
        return ls_command_wrong("fetch: --estimate is photographed: leave out --model %s", model);
    if (o->layout == LIGHTSTAGE__LAYOUT__MOSAIC)
        return ls_command_wrong("fetch: --model %s makes RGB pictures, as ratios are formed after "
                                "demosaicing: add --layout rgb or mono",
                                model);
    return LS_EXIT_OK;
}

static int parse(struct ls_command_context *context, int argc, char **argv, struct options *out)
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
                                            LS_PROMOTION_OPTIONS,
                                            LS_COMMON_OPTIONS};
    lightstage__promotion__init(&out->promotion);
    lightstage__region__init(&out->region);
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
    if (out->coefficients && (out->level || out->layout == LIGHTSTAGE__LAYOUT__MONO))
        return ls_command_wrong("fetch: --coefficients come full size, as mosaic or rgb");
    if ((out->validity || out->variance) &&
        (out->layout != LIGHTSTAGE__LAYOUT__MOSAIC || out->level || out->coefficients))
        return ls_command_wrong(
            "fetch: --validity and --variance are of photographed pixels: leave "
            "out --layout, --level and --coefficients");
    return check_promotion(out);
}

/* ---- one picture ---- */

static void fill_attributes(const struct fetch *fetch, const Lightstage__FetchReply *band,
                            struct ls_exr_attrs *attrs)
{
    const struct options *o = fetch->options;
    const struct ls_take_document *d = fetch->document;
    ls_picture_attrs_take(d, band->calibrated, attrs);
    ls_promotion_report_attrs(&fetch->report, false, attrs);
    ls_picture_attrs_fetched(d, band, o->channel, attrs);
    ls_exr_attrs_string(attrs, "lightstage/cfa",
                        o->layout != LIGHTSTAGE__LAYOUT__MOSAIC ? "none" : ls_cfa_name(d->cfa));
    ls_exr_attrs_string(attrs, "lightstage/units",
                        o->estimate ? "full scale / s x referenceExposure" : "R");
    if (!o->full_sphere)
        ls_picture_attrs_light(d, band->light, attrs);
}

static enum ls_err record(struct fetch *fetch, const char *path, const Lightstage__FetchReply *band,
                          struct ls_diag *diag)
{
    const struct ls_take_document *d = fetch->document;
    json_t *flags = ls_pixel_quality_json(&fetch->quality, (size_t)band->width * band->height);
    if (fetch->options->full_sphere || band->light >= d->n_lights) {
        json_array_append_new(fetch->frames,
                              json_pack("{ss so*}", "file", path, "validity", flags));
        return LS_OK;
    }
    const float *v = d->direction[band->light];
    double omega = d->omega_sr[band->light];
    json_array_append_new(fetch->frames,
                          json_pack("{ss sI s[fff] sf sf so*}", "file", path, "light",
                                    (json_int_t)band->light, "direction", (double)v[0],
                                    (double)v[1], (double)v[2], "solid_angle_sr", omega, "weight",
                                    band->gain_k, "validity", flags));
    if (fprintf(fetch->csv_stream, "%s,%u,%.9g,%.9g,%.9g,%.9g,%.9g\n", path, band->light,
                (double)v[0], (double)v[1], (double)v[2], omega, band->gain_k) < 0)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for the list of pictures");
    return LS_OK;
}

static enum ls_err write_picture(struct fetch *fetch, const Lightstage__FetchReply *band,
                                 struct ls_diag *diag)
{
    char path[4096];
    const struct options *o = fetch->options;
    struct ls_exr_attrs attrs = {0};
    const struct ls_picture_place place =
        ls_level_place(&o->region, o->level, fetch->document->width, fetch->document->height);
    int n = o->full_sphere ? snprintf(path, sizeof path, "%s.exr", o->output)
                           : snprintf(path, sizeof path, "%s.%04u.exr", o->output, band->light + 1);
    if (n >= (int)sizeof path)
        return ls_fail(diag, LS_ERR_INVALID, "--output: the path is too long");
    fill_attributes(fetch, band, &attrs);
    enum ls_err err = ls_picture_file_exr(path, &fetch->image, o->half ? LS_EXR_HALF : LS_EXR_FLOAT,
                                          &place, &fetch->quality, &attrs, diag);
    ls_exr_attrs_finish(&attrs);
    if (!err)
        err = record(fetch, path, band, diag);
    ls_image_finish(&fetch->image);
    ls_pixel_quality_finish(&fetch->quality);
    return err;
}

static enum ls_err take_band(struct fetch *fetch, const struct ls_reply *reply,
                             struct ls_diag *diag)
{
    bool whole = false;
    enum ls_err err = ls_received_band(&fetch->image, &fetch->quality, reply, &whole, diag);
    if (err)
        return err;
    const Lightstage__FetchReply *band = (const Lightstage__FetchReply *)reply->message;
    if (band->spectrum)
        ls_promotion_report_keep(&fetch->report,
                                 (Lightstage__SpectrumReport *const *)&band->spectrum, 1);
    return whole ? write_picture(fetch, band, diag) : LS_OK;
}

/* ---- the command ---- */

static enum ls_err receive(struct fetch *fetch, uint32_t request)
{
    struct ls_diag *diag = &fetch->context->diag;
    for (bool last = false; !last;) {
        struct ls_reply reply;
        enum ls_err err = ls_connection_receive(fetch->context->connection, request, &reply, diag);
        if (!err)
            err = take_band(fetch, &reply, diag);
        last = reply.last;
        ls_reply_finish(&reply);
        if (err)
            return err;
    }
    return LS_OK;
}

static enum ls_err send_request(struct fetch *fetch, uint32_t *request)
{
    const struct options *o = fetch->options;
    Lightstage__Fetch body = LIGHTSTAGE__FETCH__INIT;
    Lightstage__Region region = o->region;
    struct ls_diag *diag = &fetch->context->diag;
    uint32_t *lights = NULL;
    size_t n = 0;
    if (o->lights && !ls_lights_option(o->lights, fetch->document->n_lights, &lights, &n))
        return ls_fail(diag, LS_ERR_INVALID,
                       "--lights %s: expected numbers and ranges from 0 to %u, e.g. 0,5,7-9",
                       o->lights, fetch->document->n_lights - 1);
    body.take = (char *)fetch->document->id;
    body.channel = (char *)o->channel;
    body.lights = lights;
    body.n_lights = n;
    body.region = &region;
    Lightstage__Promotion promotion = o->promotion;
    body.promotion = &promotion;
    body.layout = o->layout;
    body.level = o->level;
    body.quantity =
        o->estimate ? LIGHTSTAGE__QUANTITY__ESTIMATE : LIGHTSTAGE__QUANTITY__REFLECTANCE;
    body.sample = o->half ? LIGHTSTAGE__SAMPLE__HALF : LIGHTSTAGE__SAMPLE__FLOAT;
    body.full_sphere = o->full_sphere;
    body.camera = o->camera;
    body.validity = o->validity;
    body.variance = o->variance;
    enum ls_err err = ls_connection_send(fetch->context->connection, LS_MESSAGE_FETCH, &body.base,
                                         NULL, 0, request, diag);
    free(lights);
    return err;
}

static enum ls_err write_sidecars(struct fetch *fetch, const json_t *document)
{
    char path[4096];
    char *text = json_dumps(document, JSON_INDENT(1) | JSON_REAL_PRECISION(9));
    if (!text)
        return ls_fail(&fetch->context->diag, LS_ERR_NOMEM, "out of memory");
    snprintf(path, sizeof path, "%s.json", fetch->options->output);
    enum ls_err err = ls_command_write_file(path, text, strlen(text), &fetch->context->diag);
    free(text);
    snprintf(path, sizeof path, "%s.csv", fetch->options->output);
    return err ? err
               : ls_command_write_file(path, fetch->csv, fetch->csv_bytes, &fetch->context->diag);
}

static enum ls_err open_list(struct fetch *fetch)
{
    fetch->frames = json_array();
    fetch->csv_stream = open_memstream(&fetch->csv, &fetch->csv_bytes);
    if (!fetch->frames || !fetch->csv_stream ||
        fputs("file,light,x,y,z,solid_angle_sr,weight\n", fetch->csv_stream) < 0)
        return ls_fail(&fetch->context->diag, LS_ERR_NOMEM, "out of memory");
    return LS_OK;
}

static enum ls_err close_list(struct fetch *fetch)
{
    int failed = fetch->csv_stream && fclose(fetch->csv_stream);
    fetch->csv_stream = NULL;
    return failed ? ls_fail(&fetch->context->diag, LS_ERR_NOMEM, "out of memory") : LS_OK;
}

static void tell(const struct fetch *fetch, json_t *document)
{
    if (fetch->context->json) {
        ls_command_print_json(json_incref(document));
        return;
    }
    printf("%zu pictures\n", json_array_size(fetch->frames));
    ls_promotion_report_print(&fetch->report);
}

static int fetch_pictures(struct fetch *fetch)
{
    uint32_t request = 0;
    enum ls_err err = open_list(fetch);
    if (!err)
        err = send_request(fetch, &request);
    if (!err)
        err = receive(fetch, request);
    enum ls_err closed = close_list(fetch);
    err = err ? err : closed;
    json_t *document =
        json_pack("{ss ss so sO}", "take", fetch->document->id, "channel", fetch->options->channel,
                  "spectra", ls_promotion_report_json(&fetch->report), "frames", fetch->frames);
    if (!err)
        err = write_sidecars(fetch, document);
    if (!err)
        tell(fetch, document);
    json_decref(document);
    json_decref(fetch->frames);
    free(fetch->csv);
    ls_image_finish(&fetch->image);
    ls_pixel_quality_finish(&fetch->quality);
    return err ? ls_command_failed(fetch->context, err) : LS_EXIT_OK;
}

static int fetch_coefficients(struct ls_command_context *context, const char *take,
                              const struct options *o)
{
    const struct ls_fetch_coefficients wanted = {
        .take = take,
        .channel = o->channel,
        .output = o->output,
        .gradients = strcmp(o->coefficients, "gradients") == 0,
        .rgb = o->layout == LIGHTSTAGE__LAYOUT__RGB,
        .half = o->half,
        .camera = o->camera,
        .region = o->region,
    };
    return ls_fetch_coefficients(context, &wanted);
}

static int run(struct ls_command_context *context, int argc, char **argv)
{
    struct options options = {0};
    struct ls_take_document *document = NULL;
    int code = parse(context, argc, argv, &options);
    if (code)
        return code;
    if (options.coefficients)
        return fetch_coefficients(context, argv[optind], &options);
    code = ls_take_document_get(context, argv[optind], options.camera, &document);
    if (code)
        return code;
    struct fetch fetch = {
        .context = context,
        .options = &options,
        .document = document,
        .quality = {.want_variance = options.variance, .want_validity = options.validity}};
    code = fetch_pictures(&fetch);
    ls_take_document_destroy(document);
    return code;
}

const struct ls_command ls_command_fetch = {
    "fetch", "Pictures of the field as OpenEXR, with a JSON and a CSV list beside them",
    "TAKE --channel NAME --output PREFIX [--lights 0,5,7-9] [--full-sphere]\n" LS_PROMOTION_USAGE
    "         [--layout mosaic|rgb|mono] [--estimate] [--half] [--validity] [--variance]\n"
    "         [--region X,Y,WIDTH,HEIGHT] [--level 0|1|2] [--camera N] [--json]\n"
    "   or: TAKE --channel NAME --output PREFIX --coefficients harmonics|gradients ...",
    run};
