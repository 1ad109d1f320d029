#include "clients/export_list.h"
#include "clients/fetch_coefficients.h"
#include "clients/fetch_factored.h"
#include "clients/fetch_options.h"
#include "clients/picture_attrs.h"
#include "clients/picture_file.h"
#include "clients/pixel_quality.h"
#include "clients/promotion_option.h"
#include "clients/promotion_report.h"
#include "clients/received_band.h"
#include "clients/region_option.h"
#include "clients/take_document.h"
#include "clients/tiled_band.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* The picture being received, and the files written so far. */
struct fetch {
    struct ls_command_context *context;
    const struct ls_fetch_options *options;
    const struct ls_take_document *document;
    struct ls_fetch_factored factored; /* several spectra, factored or not */
    const char *channel;               /* of the picture that is written */
    struct ls_image image;
    struct ls_pixel_quality quality;
    struct ls_promotion_report report; /* of the last picture that came with one */
    struct ls_export_list list;
    struct ls_tiled_band tiled; /* with max_error */
    double error_bound;         /* of what was left out */
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
    ls_picture_attrs_fetched(d, band, fetch->channel, attrs);
    ls_exr_attrs_string(attrs, "lightstage/cfa",
                        o->layout != LIGHTSTAGE_MOSAIC ? "none" : ls_cfa_name(d->cfa));
    ls_exr_attrs_string(attrs, "lightstage/units",
                        o->estimate ? "full scale / s x referenceExposure" : "R");
    if (o->max_error > 0)
        ls_exr_attrs_float(attrs, "lightstage/maxError", (float)o->max_error);
    if (!o->full_sphere)
        ls_picture_attrs_light(d, band->light, attrs);
}

/* What it is a picture of, and what is known of its pixels. */
static enum ls_err record(struct fetch *fetch, const char *path, const struct lightstage_band *band,
                          struct ls_diag *diag)
{
    const struct ls_take_document *d = fetch->document;
    struct ls_export_list *list = &fetch->list;
    json_t *flags = ls_pixel_quality_json(&fetch->quality, (size_t)band->width * band->height);
    enum ls_err err = LS_OK;
    if (fetch->options->full_sphere || band->light >= d->n_lights)
        json_array_append_new(list->frames, json_pack("{ss}", "file", path));
    else
        err = ls_export_list_add(list, d, path, band->light, band->gain_k, diag);
    json_t *frame = json_array_get(list->frames, json_array_size(list->frames) - 1);
    if (fetch->factored.n > 0)
        json_object_set_new(frame, "channel", json_string(fetch->channel));
    if (flags)
        json_object_set_new(frame, "validity", flags);
    return err;
}

/* PREFIX.exr, PREFIX.0001.exr, PREFIX.R.0001.exr, PREFIX.R.exr */
static int name_picture(const struct fetch *fetch, uint32_t light, char *path, size_t size)
{
    const struct ls_fetch_options *o = fetch->options;
    char number[16] = "";
    if (!o->full_sphere)
        snprintf(number, sizeof number, ".%04u", light + 1);
    bool several = fetch->factored.n > 0;
    return snprintf(path, size, "%s%s%s%s.exr", o->output, several ? "." : "",
                    several ? fetch->channel : "", number);
}

static enum ls_err write_picture(struct fetch *fetch, const struct lightstage_band *band,
                                 struct ls_diag *diag)
{
    char path[4096];
    const struct ls_fetch_options *o = fetch->options;
    struct ls_exr_attrs attrs = {0};
    const struct ls_picture_place place =
        ls_level_place(&o->region, o->level, fetch->document->width, fetch->document->height);
    if (name_picture(fetch, band->light, path, sizeof path) >= (int)sizeof path)
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

/* Of each light as it comes, under every spectrum. */
static enum ls_err put_factor(struct fetch *fetch, const struct lightstage_band *band)
{
    struct ls_fetch_factored *f = &fetch->factored;
    bool whole = false;
    enum ls_err err = ls_fetch_factored_take(f, band, &whole, &fetch->diag);
    for (uint32_t s = 0; s < f->n && whole && !err; s++) {
        fetch->channel = f->spectra[s];
        fetch->report = f->reports[s];
        err = ls_fetch_factored_expand(f, s, band->gain, &fetch->image, &fetch->diag);
        if (!err)
            err = write_picture(fetch, band, &fetch->diag);
    }
    return err;
}

/* What is said of the picture that a band belongs to. */
static enum ls_err take_report(struct fetch *fetch, const struct lightstage_band *band)
{
    struct ls_fetch_factored *f = &fetch->factored;
    uint32_t s = band->spectrum_number;
    if (s >= (f->n > 0 ? f->n : 1))
        return ls_fail(&fetch->diag, LS_ERR_INVALID, "the daemon sent a spectrum not asked for");
    if (band->report)
        ls_promotion_report_keep(f->n > 0 ? &f->reports[s] : &fetch->report, &band->report, 1);
    if (f->n > 0) {
        fetch->channel = f->spectra[s];
        fetch->report = f->reports[s];
    }
    return LS_OK;
}

static enum ls_err put_band(struct fetch *fetch, const struct lightstage_band *band)
{
    if (fetch->options->factored)
        return put_factor(fetch, band);
    bool whole = false;
    enum ls_err err = ls_received_band(&fetch->image, &fetch->quality, band, &whole, &fetch->diag);
    if (!err)
        err = take_report(fetch, band);
    return err || !whole ? err : write_picture(fetch, band, &fetch->diag);
}

static int take_band(const struct lightstage_band *band, void *user)
{
    struct fetch *fetch = user;
    fetch->err = put_band(fetch, band);
    return fetch->err != LS_OK;
}

static int take_tile(const struct lightstage_tile *tile, void *user)
{
    struct fetch *fetch = user;
    struct lightstage_band band;
    bool there = false;
    fetch->err = ls_tiled_band_take(&fetch->tiled, tile, &there, &band, &fetch->diag);
    if (!fetch->err && there)
        fetch->err = put_band(fetch, &band);
    fetch->error_bound = tile->picture->error_bound;
    return fetch->err != LS_OK;
}

/* ---- the command ---- */

/* In tiles, where some may stay away. */
static uint32_t receive(struct fetch *fetch, const struct lightstage_fetch *wish)
{
    struct ls_command_context *context = fetch->context;
    const struct lightstage_region *r = &wish->region;
    if (wish->max_error == 0)
        return lightstage_fetch(context->stage, wish, take_band, fetch, &context->error);
    fetch->tiled =
        (struct ls_tiled_band){.region = {r->x, r->y, r->width, r->height}, .level = wish->level};
    if (r->width == 0)
        fetch->tiled.region = (struct ls_demosaic_region){.width = fetch->document->width,
                                                          .height = fetch->document->height};
    return lightstage_fetch_tiles(context->stage, wish, NULL, take_tile, fetch, &context->error);
}

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
        .channel = fetch->factored.n > 0 ? NULL : o->channel,
        .factored = o->factored,
        .spectra = fetch->factored.spectra,
        .n_spectra = fetch->factored.n,
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
        .max_error = o->max_error,
    };
    enum ls_err err = ls_command_said(context, receive(fetch, &wish));
    return fetch->err ? ls_fail(&context->diag, fetch->err, "%s", fetch->diag.text) : err;
}

/* Of every spectrum, where there are several. */
static void gather_reports(struct fetch *fetch)
{
    const struct ls_fetch_factored *f = &fetch->factored;
    for (uint32_t s = 0; s < f->n; s++)
        fetch->report.spectrum[s] = f->reports[s].spectrum[0];
    fetch->report.n = f->n > 0 ? f->n : fetch->report.n;
}

static void tell(const struct fetch *fetch, json_t *document)
{
    if (fetch->context->json) {
        ls_command_print_json(json_incref(document));
        return;
    }
    printf("%zu pictures\n", json_array_size(fetch->list.frames));
    if (fetch->options->max_error > 0)
        printf("error bound %.3g\n", fetch->error_bound);
    ls_promotion_report_print(&fetch->report);
}

static enum ls_err write_list(struct fetch *fetch, const json_t *document)
{
    char json[4096], csv[4096];
    const char *output = fetch->options->output;
    snprintf(csv, sizeof csv, "%s.csv", output);
    if (snprintf(json, sizeof json, "%s.json", output) >= (int)sizeof json)
        return ls_fail(&fetch->context->diag, LS_ERR_INVALID, "--output: the path is too long");
    return ls_export_list_write(&fetch->list, document, json, csv, &fetch->context->diag);
}

static enum ls_err fetch_pictures(struct fetch *fetch)
{
    struct ls_diag *diag = &fetch->context->diag;
    enum ls_err err = ls_export_list_begin(&fetch->list, diag);
    if (!err && (fetch->options->factored || strchr(fetch->channel, ',')))
        err = ls_fetch_factored_init(&fetch->factored, fetch->channel, diag);
    if (!err)
        err = ask(fetch);
    if (err)
        return err;
    gather_reports(fetch);
    json_t *document = json_pack(
        "{ss ss so sO}", "take", fetch->document->id, "channel", fetch->options->channel, "spectra",
        ls_promotion_report_json(&fetch->report), "frames", fetch->list.frames);
    if (fetch->options->max_error > 0)
        json_object_set_new(document, "error_bound", json_real(fetch->error_bound));
    err = write_list(fetch, document);
    if (!err)
        tell(fetch, document);
    json_decref(document);
    return err;
}

static void finish(struct fetch *fetch)
{
    ls_export_list_finish(&fetch->list);
    ls_image_finish(&fetch->image);
    ls_pixel_quality_finish(&fetch->quality);
    ls_fetch_factored_finish(&fetch->factored);
    ls_tiled_band_finish(&fetch->tiled);
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
        .channel = options.channel,
        .quality = {.want_variance = options.variance, .want_validity = options.validity}};
    enum ls_err err = fetch_pictures(&fetch);
    finish(&fetch);
    ls_take_document_destroy(document);
    return err ? ls_command_failed(context, err) : LS_EXIT_OK;
}

const struct ls_command ls_command_fetch = {
    "fetch", "Pictures of the field as OpenEXR, with a JSON and a CSV list beside them",
    "TAKE --channel NAME,... --output PREFIX [--lights 0,5,7-9]\n" LS_PROMOTION_USAGE
    "         [--full-sphere] [--layout mosaic|rgb|mono] [--estimate] [--half]\n"
    "         [--validity] [--variance] [--region X,Y,WIDTH,HEIGHT] [--level 0|1|2]\n"
    "         [--camera N] [--max-error E] [--json]\n"
    "   or: TAKE --channel NAME,... --output PREFIX --factored --layout rgb --half ...\n"
    "         several spectra by sphere or headlight for the bytes of one: PREFIX.NAME.0001.exr\n"
    "   or: TAKE --channel NAME --output PREFIX --coefficients harmonics|gradients ...",
    run};
