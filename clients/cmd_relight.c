#include "clients/command.h"
#include "clients/environment_file.h"
#include "clients/light_weights.h"
#include "clients/picture_attrs.h"
#include "clients/picture_file.h"
#include "clients/relight_options.h"
#include "clients/region_option.h"
#include "clients/relight_request.h"
#include "clients/relight_text.h"
#include "clients/relit_space.h"
#include "clients/weights_file.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Everything the command works on. */
struct work {
    struct ls_command_context *context;
    const struct ls_relight_options *options;
    const struct ls_take_document *document;
    uint32_t n;                       /* pictures */
    struct ls_light_weights *weights; /* [n] */
    struct ls_image *images;          /* [n], while they are made and written */
    struct ls_relit result;
    float shown_scale; /* of the pictures under one environment, as its first PNG has it */
    bool warned;
};

/* ---- writing ---- */

/* The picture in Rec. 709, if that can be had. */
static enum ls_err to_rec709(const struct ls_take_document *document,
                             const struct ls_light_weights *weights, const struct ls_image *raw,
                             struct ls_image *out, struct ls_diag *diag)
{
    size_t n = (size_t)raw->width * raw->height;
    enum ls_err err = ls_image_init(out, raw->width, raw->height, 3, SIZE_MAX, diag);
    if (err)
        return err;
    if (ls_relit_needs_m(document, weights))
        ls_relit_apply_m(document, raw->pixels, n, out->pixels);
    else
        memcpy(out->pixels, raw->pixels, n * 3 * sizeof(float));
    return LS_OK;
}

static enum ls_err write_exr(const struct work *work, uint32_t picture, const char *path,
                             const struct ls_image *image, bool rec709)
{
    const struct ls_relight_options *options = work->options;
    const struct ls_take_document *document = work->document;
    struct ls_exr_attrs attrs = {0};
    const struct ls_picture_place place =
        ls_level_place(&options->region, options->level, document->width, document->height);
    const char *light = ls_relight_light(options, picture), *file = strrchr(light, '/');
    ls_picture_attrs_take(document, work->result.calibrated, &attrs);
    ls_promotion_report_attrs(&work->result.report, options->solve.solve == LS_LIGHT_TRISTIMULUS,
                              &attrs);
    ls_exr_attrs_string(&attrs, "lightstage/environment", file ? file + 1 : light);
    ls_exr_attrs_string(&attrs, "lightstage/units", rec709 ? "rec709-linear" : "camera-raw");
    ls_exr_attrs_float(&attrs, "lightstage/rotation", (float)ls_relight_turn(options, picture));
    if (rec709)
        ls_picture_attrs_primaries(&ls_primaries_rec709, &attrs);
    enum ls_err err =
        ls_picture_file_exr(path, image, LS_EXR_FLOAT, &place, NULL, &attrs, &work->context->diag);
    ls_exr_attrs_finish(&attrs);
    return err;
}

/* What is shown automatically is shown alike however the environment is turned. */
static enum ls_err write_png(struct work *work, uint32_t picture, const char *path,
                             const struct ls_image *shown)
{
    const struct ls_relight_options *options = work->options;
    float scale = work->shown_scale;
    if (options->exposure_given)
        scale = exp2f((float)options->exposure);
    else if (picture % options->n_turns == 0)
        scale = 0;
    enum ls_err err = ls_picture_file_png(path, shown, scale, scale > 0 ? NULL : &work->shown_scale,
                                          &work->context->diag);
    return err;
}

static void warn_of_raw(struct work *work, bool rec709)
{
    if (!rec709 && !work->warned)
        fputs("lightstagectl: warning: the take has no matrix M: the picture stays in the camera's "
              "own colours\n",
              stderr);
    work->warned |= !rec709;
}

static enum ls_err write_picture(struct work *work, uint32_t picture, const char *exr,
                                 const char *png)
{
    const struct ls_relight_options *options = work->options;
    const struct ls_light_weights *weights = &work->weights[picture];
    const struct ls_image *image = &work->images[picture];
    struct ls_image shown = {0};
    bool rec709 = ls_relit_in_rec709(work->document, weights);
    enum ls_err err = to_rec709(work->document, weights, image, &shown, &work->context->diag);
    if (!err)
        warn_of_raw(work, rec709);
    if (!err && exr)
        err = write_exr(work, picture, exr, options->raw ? image : &shown,
                        rec709 && (!options->raw || weights->after_m));
    if (!err && png)
        err = write_png(work, picture, png, &shown);
    ls_image_finish(&shown);
    return err;
}

static enum ls_err write_numbered(struct work *work, uint32_t picture)
{
    char *exr = ls_relight_name(work->options->exr, picture),
         *png = ls_relight_name(work->options->png, picture);
    enum ls_err err = LS_OK;
    if ((work->options->exr && !exr) || (work->options->png && !png))
        err = ls_fail(&work->context->diag, LS_ERR_NOMEM, "out of memory");
    if (!err)
        err = write_picture(work, picture, exr, png);
    free(exr);
    free(png);
    return err;
}

/* ---- the command ---- */

/* Of one environment, for each turn. */
static enum ls_err solve_turns(struct work *work, uint32_t first)
{
    const struct ls_relight_options *options = work->options;
    const char *path = ls_relight_light(options, first);
    struct ls_diag *diag = &work->context->diag;
    struct ls_environment_file environment;
    enum ls_err err = LS_OK;
    const struct ls_environment_ball known = {work->document->calibration, options->profile};
    if (ls_environment_file_read(path, options->space, &known, &environment, diag))
        return LS_ERR_INVALID;
    for (uint32_t k = first; k < first + options->n_turns && !err; k++) {
        struct ls_light_options solve = options->solve;
        solve.turn_deg = ls_relight_turn(options, k);
        err = ls_light_weights_make(work->document, &environment, &solve, &work->weights[k], diag);
    }
    ls_environment_file_finish(&environment);
    return err;
}

static enum ls_err make_weights(struct work *work)
{
    const struct ls_relight_options *options = work->options;
    enum ls_err err = LS_OK;
    for (uint32_t k = 0; k < work->n && !err; k += options->n_turns) {
        if (!options->weights)
            err = solve_turns(work, k);
        else if (ls_weights_file_read(ls_relight_light(options, k), work->document,
                                      &work->weights[k], &work->context->diag))
            err = LS_ERR_INVALID;
    }
    return err;
}

static enum ls_err take_rows(void *user, const struct ls_relit_rows *rows, struct ls_diag *diag)
{
    struct ls_image *image = (struct ls_image *)user + rows->picture;
    size_t row = 3 * (size_t)rows->width;
    enum ls_err err = LS_OK;
    if (!image->pixels)
        err = ls_image_init(image, rows->width, rows->height, 3, (size_t)4 << 30, diag);
    if (!err && (rows->width != image->width || rows->height != image->height))
        err = ls_fail(diag, LS_ERR_INVALID, "the daemon sent rows that do not fit the picture");
    if (!err)
        memcpy(image->pixels + rows->first_row * row, rows->rgb,
               rows->n_rows * row * sizeof *rows->rgb);
    return err;
}

/* Some pictures at once, from the @first on; *n of them. */
static int make_some(struct work *work, uint32_t first, uint32_t *n)
{
    const struct ls_light_weights *weights = work->weights + first;
    enum ls_err err = LS_OK;
    *n = ls_relight_at_once(work->options, work->document, weights, work->n - first);
    int code = ls_relight_request(work->context, work->options, work->document, weights, *n,
                                  take_rows, work->images + first, &work->result);
    for (uint32_t k = first; k < first + *n && !code && !err; k++) {
        err = write_numbered(work, k);
        ls_image_finish(&work->images[k]);
    }
    return err ? ls_command_failed(work->context, err) : code;
}

static int make_all(struct work *work)
{
    enum ls_err err = make_weights(work);
    int code = err ? ls_command_failed(work->context, err) : LS_EXIT_OK;
    for (uint32_t first = 0, n = 0; first < work->n && !code; first += n)
        code = make_some(work, first, &n);
    if (!code)
        ls_relight_print(
            &(struct ls_relight_told){work->options, work->weights, &work->result, work->n},
            work->context->json);
    return code;
}

static int relight(struct ls_command_context *context, const struct ls_relight_options *options,
                   const struct ls_take_document *document)
{
    struct work work = {.context = context,
                        .options = options,
                        .document = document,
                        .n = ls_relight_pictures(options)};
    int code;
    work.weights = calloc(work.n, sizeof *work.weights);
    work.images = calloc(work.n, sizeof *work.images);
    if (work.weights && work.images)
        code = make_all(&work);
    else
        code = ls_command_failed(context, ls_fail(&context->diag, LS_ERR_NOMEM, "out of memory"));
    for (uint32_t k = 0; k < work.n && work.weights && work.images; k++) {
        ls_light_weights_finish(&work.weights[k]);
        ls_image_finish(&work.images[k]);
    }
    free(work.weights);
    free(work.images);
    return code;
}

static int run_with(struct ls_command_context *context, const struct ls_relight_options *options)
{
    struct ls_take_document *document = NULL;
    int code = ls_take_document_get(context, options->take, options->camera, &document);
    if (code)
        return code;
    code = ls_relight_use_profile(options, document);
    if (!code)
        code = relight(context, options, document);
    ls_take_document_destroy(document);
    return code;
}

static int run(struct ls_command_context *context, int argc, char **argv)
{
    struct ls_relight_options options = {0};
    int code = ls_relight_options_parse(context, argc, argv, &options);
    if (!code)
        code = run_with(context, &options);
    ls_relight_options_finish(&options);
    return code;
}

const struct ls_command ls_command_relight = {
    "relight",
    "A take under another light: a lat-long .hdr or .exr, or lobes or a captured light as .json",
    "TAKE ENVIRONMENT... --output FILE.exr [--png FILE.png] [--raw]\n" LS_RELIGHT_SOLVE_USAGE
    "         [--rotate DEG,DEG,...] [--space rec709-linear|camera-raw]\n" LS_PROMOTION_USAGE
    "         [--region X,Y,WIDTH,HEIGHT] [--level 0|1|2] [--exposure STOPS] [--max-error E]\n"
    "         [--camera N] [--json]\n"
    "         --space: what the numbers of a map are; --raw: the picture in the camera's colours\n"
    "       lightstagectl relight TAKE --weights FILE.json... --output FILE.exr [...]\n"
    "         instead of an environment: {\"W\": [one per light, radiance x sr], ...};\n"
    "         each more file is one more --weights\n"
    "       One picture for each environment and each DEG of --rotate, from one pass over the\n"
    "       take. Of several the names hold a number, from 1: --output relit-%02d.exr",
    run};
