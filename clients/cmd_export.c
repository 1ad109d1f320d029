#include "clients/command.h"
#include "clients/picture_attrs.h"
#include "clients/promotion_option.h"
#include "clients/promotion_report.h"
#include "clients/received_band.h"
#include "clients/region_option.h"
#include "clients/take_document.h"
#include "core/exr.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

static const size_t file_limit = (size_t)8 << 30;

struct options {
    const char *channels, *lights;
    struct lightstage_promotion promotion;
    bool half;
    uint32_t camera;
};

/* One spectrum of the light that is being written: a part of its file. */
struct spectrum {
    const char *name;
    bool photographed; /* light by light */
    struct ls_image image;
    struct ls_exr_attrs attrs;
    struct ls_exr_channel channels[3];
};

struct export
{
    struct ls_command_context *context;
    const struct options *options;
    const struct ls_take_document *document;
    const char *folder;
    struct spectrum spectra[LS_DOCUMENT_CHANNELS];
    uint32_t n_spectra;
    char recipe[512]; /* what a file must have been made by to be left as it is */
    json_t *frames;
    char *csv; /* text of the list, malloc */
    size_t csv_bytes;
    FILE *csv_stream; /* into it */
    uint32_t written, skipped;
};

static int parse(struct ls_command_context *context, int argc, char **argv, struct options *out)
{
    static const struct option options[] = {{"channels", required_argument, NULL, 1},
                                            {"lights", required_argument, NULL, 2},
                                            {"half", no_argument, NULL, 3},
                                            {"camera", required_argument, NULL, 4},
                                            LS_PROMOTION_OPTIONS,
                                            LS_COMMON_OPTIONS};
    out->promotion =
        (struct lightstage_promotion){.size = sizeof out->promotion, .model = LIGHTSTAGE_SPHERE};
    for (int option, code;
         (option = ls_command_option(context, &ls_command_export, argc, argv, options)) != -1;) {
        if (option == 1)
            out->channels = optarg;
        else if (option == 2)
            out->lights = optarg;
        else if (option == 3)
            out->half = true;
        else if (option == 4 && !ls_camera_option(optarg, &out->camera))
            return ls_command_wrong("--camera %s: expected the number of a camera, from 0", optarg);
        else if (option != 4 && (code = ls_promotion_option(option, optarg, &out->promotion)))
            return code;
    }
    return ls_command_arguments(&ls_command_export, argc, 2) ? LS_EXIT_OK : LS_EXIT_USAGE;
}

/* ---- which spectra ---- */

/* Does "W,R" name it? */
static bool is_named(const char *list, const char *name)
{
    size_t n = strlen(name);
    for (const char *at = list; at; at = strchr(at, ','), at = at ? at + 1 : NULL)
        if (strncmp(at, name, n) == 0 && (at[n] == ',' || at[n] == '\0'))
            return true;
    return false;
}

static enum ls_err choose_spectra(struct export *export)
{
    const struct ls_take_document *d = export->document;
    const char *list = export->options->channels;
    size_t wanted = list ? 1 : 0;
    for (const char *at = list; at && (at = strchr(at, ',')); at++)
        wanted++;
    for (uint32_t c = 0; c < d->n_channels; c++) {
        bool had = d->channels[c].spectrum && (d->channels[c].each || d->channels[c].sphere ||
                                               d->channels[c].headlight || d->channels[c].segments);
        if (list ? is_named(list, d->channels[c].name) : had)
            export->spectra[export->n_spectra++] =
                (struct spectrum){.name = d->channels[c].name, .photographed = d->channels[c].each};
    }
    if (export->n_spectra && (!list || export->n_spectra == wanted))
        return LS_OK;
    return ls_fail(&export->context->diag, LS_ERR_INVALID,
                   list ? "--channels %s: expected different channels of the take, e.g. W,R"
                        : "the take has no spectra%s",
                   list ? list : "");
}

static void make_recipe(struct export *export)
{
    const struct lightstage_promotion *p = &export->options->promotion;
    size_t n = (size_t)snprintf(export->recipe, sizeof export->recipe, "%s %u %d%d%d %s",
                                lightstage_model_name(p->model), export->options->camera,
                                (int)p->reference, p->ideal_polarisation, p->plain_conductors,
                                export->options->half ? "half" : "float");
    for (uint32_t s = 0; s < export->n_spectra && n < sizeof export->recipe; s++)
        n += (size_t)snprintf(export->recipe + n, sizeof export->recipe - n, " %s",
                              export->spectra[s].name);
}

/* ---- one light ---- */

static void describe(struct export *export, struct spectrum *spectrum, uint32_t light,
                     const struct lightstage_band *band)
{
    struct ls_promotion_report report = {0};
    struct ls_exr_attrs *attrs = &spectrum->attrs;
    if (band->report)
        ls_promotion_report_keep(&report, &band->report, 1);
    ls_picture_attrs_take(export->document, band->calibrated, attrs);
    ls_promotion_report_attrs(&report, false, attrs);
    ls_picture_attrs_fetched(export->document, band, spectrum->name, attrs);
    ls_picture_attrs_light(export->document, light, attrs);
    ls_exr_attrs_string(attrs, "lightstage/cfa", "none");
    ls_exr_attrs_string(attrs, "lightstage/units", "R");
    ls_exr_attrs_string(attrs, "lightstage/positionUnits",
                        "m from the stage's centre: x camera-right, y up, z to the camera");
    ls_exr_attrs_string(attrs, "lightstage/export", export->recipe);
}

/* A picture that is being received. */
struct received {
    struct export *export;
    struct spectrum *spectrum;
    uint32_t light;
    bool whole;
    enum ls_err err;
};

static int take_band(const struct lightstage_band *band, void *user)
{
    struct received *r = user;
    struct ls_pixel_quality none = {0};
    if (!band->first_row)
        describe(r->export, r->spectrum, r->light, band);
    r->err =
        ls_received_band(&r->spectrum->image, &none, band, &r->whole, &r->export->context->diag);
    return r->err != LS_OK;
}

static enum ls_err fetch(struct export *export, struct spectrum *spectrum, uint32_t light)
{
    static const struct lightstage_promotion measured = {.size = sizeof measured};
    struct ls_command_context *context = export->context;
    const struct lightstage_fetch wish = {
        .size = sizeof wish,
        .take = export->document->id,
        .channel = spectrum->name,
        .lights = &light,
        .n_lights = 1,
        .promotion = spectrum->photographed ? &measured : &export->options->promotion,
        .layout = export->document->mono ? LIGHTSTAGE_MONO : LIGHTSTAGE_RGB,
        .sample = export->options->half ? LIGHTSTAGE_HALF : LIGHTSTAGE_FLOAT,
        .camera = export->options->camera,
    };
    struct received r = {.export = export, .spectrum = spectrum, .light = light};
    uint32_t number = lightstage_fetch(context->stage, &wish, take_band, &r, &context->error);
    if (r.err)
        return r.err;
    if (number)
        return ls_command_said(context, number);
    return r.whole ? LS_OK
                   : ls_fail(&context->diag, LS_ERR_INVALID, "the daemon sent less than a picture");
}

static struct ls_exr_part part_of(const struct export *export, struct spectrum *spectrum)
{
    static const char *const rgb[] = {"R", "G", "B"}, *const grey[] = {"Y"};
    const struct ls_image *image = &spectrum->image;
    uint32_t n = image->n_channels;
    for (uint32_t c = 0; c < n; c++)
        spectrum->channels[c] =
            (struct ls_exr_channel){.name = n == 3 ? rgb[c] : grey[c],
                                    .type = export->options->half ? LS_EXR_HALF : LS_EXR_FLOAT,
                                    .source = LS_EXR_FROM_FLOAT,
                                    .pixels = image->pixels + c,
                                    .pixel_stride_bytes = n * sizeof(float),
                                    .row_stride_bytes = (size_t)image->width * n * sizeof(float)};
    return (struct ls_exr_part){.name = spectrum->name,
                                .width = image->width,
                                .height = image->height,
                                .channels = spectrum->channels,
                                .n_channels = n,
                                .attrs = &spectrum->attrs};
}

static enum ls_err write_light(struct export *export, uint32_t light, const char *path)
{
    struct ls_diag *diag = &export->context->diag;
    struct ls_exr_part parts[LS_DOCUMENT_CHANNELS];
    uint8_t *bytes = NULL;
    size_t size = 0;
    enum ls_err err = LS_OK;
    for (uint32_t s = 0; s < export->n_spectra && !err; s++) {
        err = fetch(export, &export->spectra[s], light);
        parts[s] = part_of(export, &export->spectra[s]);
    }
    if (!err)
        err = ls_exr_write(parts, export->n_spectra, &bytes, &size, diag);
    if (!err)
        err = ls_command_write_file(path, bytes, size, diag);
    free(bytes);
    export->written += !err;
    return err;
}

static bool says(const struct ls_exr_attrs *attrs, const char *name, const char *text)
{
    const struct ls_exr_attr *attr = ls_exr_attrs_find(attrs, name);
    return attr && attr->kind == LS_EXR_ATTR_STRING && strcmp(attr->text, text) == 0;
}

/* Is every part of the file there, readable, and of this export? Then its pictures are read. */
static bool is_whole(struct export *export, uint32_t light, const char *path)
{
    struct ls_diag diag = {0};
    char *bytes = NULL;
    size_t size = 0;
    bool good = !ls_command_read_file(path, file_limit, &bytes, &size, &diag);
    for (uint32_t s = 0; s < export->n_spectra && good; s++) {
        struct spectrum *spectrum = &export->spectra[s];
        good = !ls_exr_read(bytes, size, spectrum->name, file_limit, &spectrum->image,
                            &spectrum->attrs, &diag);
        const struct ls_exr_attr *number = ls_exr_attrs_find(&spectrum->attrs, "lightstage/light");
        good = good && number && number->i == (int32_t)light &&
               says(&spectrum->attrs, "lightstage/take", export->document->id) &&
               says(&spectrum->attrs, "lightstage/export", export->recipe);
    }
    free(bytes);
    export->skipped += good;
    return good;
}

static void forget(struct export *export)
{
    for (uint32_t s = 0; s < export->n_spectra; s++) {
        ls_image_finish(&export->spectra[s].image);
        ls_exr_attrs_finish(&export->spectra[s].attrs);
        export->spectra[s].image = (struct ls_image){0};
    }
}

static enum ls_err record(struct export *export, uint32_t light, const char *path)
{
    const float *v = export->document->direction[light];
    double omega = export->document->omega_sr[light];
    const struct ls_exr_attr *gain =
        ls_exr_attrs_find(&export->spectra[0].attrs, "lightstage/gain");
    double weight = gain ? (double)gain->f[0] : 1;
    const char *file = strrchr(path, '/') + 1;
    json_array_append_new(export->frames,
                          json_pack("{ss sI s[fff] sf sf}", "file", file, "light",
                                    (json_int_t)light, "direction", (double)v[0], (double)v[1],
                                    (double)v[2], "solid_angle_sr", omega, "weight", weight));
    if (fprintf(export->csv_stream, "%s,%u,%.9g,%.9g,%.9g,%.9g,%.9g\n", file, light, (double)v[0],
                (double)v[1], (double)v[2], omega, weight) < 0)
        return ls_fail(&export->context->diag, LS_ERR_NOMEM, "out of memory");
    return LS_OK;
}

static enum ls_err path_of(struct export *export, const char *end, char *path, size_t n)
{
    if (snprintf(path, n, "%s/%s.%s", export->folder, export->document->id, end) >= (int)n)
        return ls_fail(&export->context->diag, LS_ERR_INVALID, "FOLDER: the path is too long");
    return LS_OK;
}

static enum ls_err export_light(struct export *export, uint32_t light)
{
    char path[4096], end[32];
    snprintf(end, sizeof end, "%04u.exr", light + 1);
    enum ls_err err = path_of(export, end, path, sizeof path);
    if (!err && !is_whole(export, light, path)) {
        forget(export);
        err = write_light(export, light, path);
    }
    if (!err)
        err = record(export, light, path);
    forget(export);
    return err;
}

/* ---- the command ---- */

static enum ls_err export_lights(struct export *export)
{
    const char *text = export->options->lights;
    uint32_t *lights = NULL, limit = export->document->n_lights;
    size_t n = limit;
    bool terminal = isatty(STDERR_FILENO);
    enum ls_err err = LS_OK;
    if (text && !ls_lights_option(text, limit, &lights, &n))
        return ls_fail(&export->context->diag, LS_ERR_INVALID,
                       "--lights %s: expected numbers and ranges from 0 to %u, e.g. 0,5,7-9", text,
                       limit - 1);
    for (size_t i = 0; i < n && !err; i++) {
        err = export_light(export, lights ? lights[i] : (uint32_t)i);
        if (terminal)
            fprintf(stderr, "\r%zu of %zu lights%s", i + 1, n, i + 1 == n || err ? "\n" : "");
    }
    free(lights);
    return err;
}

static enum ls_err write_list(struct export *export, const json_t *document)
{
    char path[4096];
    char *text = json_dumps(document, JSON_INDENT(1) | JSON_REAL_PRECISION(9));
    enum ls_err err = text ? path_of(export, "json", path, sizeof path)
                           : ls_fail(&export->context->diag, LS_ERR_NOMEM, "out of memory");
    if (!err)
        err = ls_command_write_file(path, text, strlen(text), &export->context->diag);
    free(text);
    if (!err)
        err = path_of(export, "csv", path, sizeof path);
    return err ? err
               : ls_command_write_file(path, export->csv, export->csv_bytes,
                                       &export->context->diag);
}

static enum ls_err prepare(struct export *export)
{
    struct ls_diag *diag = &export->context->diag;
    enum ls_err err = choose_spectra(export);
    if (err)
        return err;
    make_recipe(export);
    if (mkdir(export->folder, 0777) && errno != EEXIST)
        return ls_fail(diag, LS_ERR_INVALID, "%s: %s", export->folder, strerror(errno));
    export->frames = json_array();
    export->csv_stream = open_memstream(&export->csv, &export->csv_bytes);
    if (!export->frames || !export->csv_stream ||
        fputs("file,light,x,y,z,solid_angle_sr,weight\n", export->csv_stream) < 0)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    return LS_OK;
}

static enum ls_err export_take(struct export *export)
{
    enum ls_err err = prepare(export);
    if (!err)
        err = export_lights(export);
    if (export->csv_stream && fclose(export->csv_stream) && !err)
        err = ls_fail(&export->context->diag, LS_ERR_NOMEM, "out of memory");
    if (err)
        return err;
    json_t *document =
        json_pack("{ss si si sO}", "take", export->document->id, "written", (int)export->written,
                  "skipped", (int)export->skipped, "frames", export->frames);
    err = write_list(export, document);
    if (!err && export->context->json)
        ls_command_print_json(json_incref(document));
    else if (!err)
        printf("%u files written, %u were there\n", export->written, export->skipped);
    json_decref(document);
    return err;
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
    struct export export = {
        .context = context, .options = &options, .document = document, .folder = argv[optind + 1]};
    enum ls_err err = export_take(&export);
    json_decref(export.frames);
    free(export.csv);
    ls_take_document_destroy(document);
    return err ? ls_command_failed(context, err) : LS_EXIT_OK;
}

const struct ls_command ls_command_export = {
    "export", "Every light's spectra as one OpenEXR file, with a JSON and a CSV list beside them",
    "TAKE FOLDER [--channels W,R,...] [--lights 0,5,7-9] [--half]\n" LS_PROMOTION_USAGE
    "         [--camera N] [--json]\n",
    run};
