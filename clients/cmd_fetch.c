#include "clients/fetch_coefficients.h"
#include "clients/fetch_options.h"
#include "clients/picture_attrs.h"
#include "clients/picture_file.h"
#include "clients/pixel_quality.h"
#include "clients/promotion_option.h"
#include "clients/promotion_report.h"
#include "clients/received_band.h"
#include "clients/region_option.h"
#include "clients/take_document.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* The picture being received, and the files written so far. */
struct fetch {
    struct ls_command_context *context;
    const struct ls_fetch_options *options;
    const struct ls_take_document *document;
    struct ls_image image;
    struct ls_pixel_quality quality;
    struct ls_promotion_report report; /* of the last picture that came with one */
    json_t *frames;
    char *csv; /* text of the list, malloc */
    size_t csv_bytes;
    FILE *csv_stream; /* into it */
    enum ls_err err;
    struct ls_diag diag; /* of err */
};

/* ---- one picture ---- */

static void fill_attributes(const struct fetch *fetch, const struct lightstage_band *band,
                            struct ls_exr_attrs *attrs)
{
    const struct ls_fetch_options *o = fetch->options;
    const struct ls_take_document *d = fetch->document;
    ls_picture_attrs_take(d, band->calibrated, attrs);
    ls_promotion_report_attrs(&fetch->report, false, attrs);
    ls_picture_attrs_fetched(d, band, o->channel, attrs);
    ls_exr_attrs_string(attrs, "lightstage/cfa",
                        o->layout != LIGHTSTAGE_MOSAIC ? "none" : ls_cfa_name(d->cfa));
    ls_exr_attrs_string(attrs, "lightstage/units",
                        o->estimate ? "full scale / s x referenceExposure" : "R");
    if (!o->full_sphere)
        ls_picture_attrs_light(d, band->light, attrs);
}

static enum ls_err record(struct fetch *fetch, const char *path, const struct lightstage_band *band,
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

static enum ls_err write_picture(struct fetch *fetch, const struct lightstage_band *band,
                                 struct ls_diag *diag)
{
    char path[4096];
    const struct ls_fetch_options *o = fetch->options;
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

static enum ls_err put_band(struct fetch *fetch, const struct lightstage_band *band)
{
    bool whole = false;
    enum ls_err err = ls_received_band(&fetch->image, &fetch->quality, band, &whole, &fetch->diag);
    if (!err && band->report)
        ls_promotion_report_keep(&fetch->report, &band->report, 1);
    return whole ? write_picture(fetch, band, &fetch->diag) : err;
}

static int take_band(const struct lightstage_band *band, void *user)
{
    struct fetch *fetch = user;
    fetch->err = put_band(fetch, band);
    return fetch->err != LS_OK;
}

/* ---- the command ---- */

static enum ls_err ask(struct fetch *fetch)
{
    const struct ls_fetch_options *o = fetch->options;
    struct ls_command_context *context = fetch->context;
    LS_CLEANUP_FREE uint32_t *lights = NULL;
    size_t n = 0;
    if (o->lights && !ls_lights_option(o->lights, fetch->document->n_lights, &lights, &n))
        return ls_fail(&context->diag, LS_ERR_INVALID,
                       "--lights %s: expected numbers and ranges from 0 to %u, e.g. 0,5,7-9",
                       o->lights, fetch->document->n_lights - 1);
    const struct lightstage_fetch wish = {
        .size = sizeof wish,
        .take = fetch->document->id,
        .channel = o->channel,
        .lights = lights,
        .n_lights = n,
        .full_sphere = o->full_sphere,
        .region = o->region,
        .promotion = &o->promotion,
        .layout = o->layout,
        .quantity = o->estimate ? LIGHTSTAGE_ESTIMATE : LIGHTSTAGE_REFLECTANCE,
        .sample = o->half ? LIGHTSTAGE_HALF : LIGHTSTAGE_FLOAT,
        .camera = o->camera,
        .level = o->level,
        .variance = o->variance,
        .validity = o->validity,
    };
    enum ls_err err = ls_command_said(
        context, lightstage_fetch(context->stage, &wish, take_band, fetch, &context->error));
    return fetch->err ? ls_fail(&context->diag, fetch->err, "%s", fetch->diag.text) : err;
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
    enum ls_err err = open_list(fetch);
    if (!err)
        err = ask(fetch);
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
                              const struct ls_fetch_options *o)
{
    const struct ls_fetch_coefficients wanted = {
        .take = take,
        .channel = o->channel,
        .output = o->output,
        .gradients = strcmp(o->coefficients, "gradients") == 0,
        .rgb = o->layout == LIGHTSTAGE_RGB,
        .half = o->half,
        .camera = o->camera,
        .region = o->region,
    };
    return ls_fetch_coefficients(context, &wanted);
}

static int run(struct ls_command_context *context, int argc, char **argv)
{
    struct ls_fetch_options options;
    struct ls_take_document *document = NULL;
    int code = ls_fetch_options_parse(context, argc, argv, &options);
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
