#include "clients/command.h"
#include "clients/contact_sheet.h"
#include "clients/export_file.h"
#include "clients/export_list.h"
#include "clients/promotion_option.h"
#include "clients/region_option.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

struct options {
    const char *channels, *lights, *folder, *space;
    struct lightstage_promotion promotion;
    bool half, packed;
    uint32_t camera;
};

/* Everything the command works on. */
struct work {
    struct ls_command_context *context;
    const struct options *options;
    const struct ls_take_document *document;
    struct ls_export export;
    struct ls_export_list list;
    struct ls_contact_sheet sheet; /* of the first spectrum */
    float sheet_scale;
    uint32_t written, skipped;
};

static int parse(struct ls_command_context *context, int argc, char **argv, struct options *out)
{
    static const struct option options[] = {{"channels", required_argument, NULL, 1},
                                            {"lights", required_argument, NULL, 2},
                                            {"half", no_argument, NULL, 3},
                                            {"camera", required_argument, NULL, 4},
                                            {"packed", no_argument, NULL, 5},
                                            {"space", required_argument, NULL, 6},
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
        else if (option == 5)
            out->packed = true;
        else if (option == 6)
            out->space = optarg;
        else if ((code = option == 4 ? ls_camera_option(optarg, &out->camera)
                                     : ls_promotion_option(option, optarg, &out->promotion)))
            return code;
    }
    return ls_command_arguments(&ls_command_export, argc, 2) ? LS_EXIT_OK : LS_EXIT_USAGE;
}

/* ---- the lights ---- */

/* FOLDER/TAKE.@end */
static enum ls_err path_of(const struct work *work, const char *end, char *path, size_t n)
{
    if (snprintf(path, n, "%s/%s.%s", work->options->folder, work->document->id, end) >= (int)n)
        return ls_fail(&work->context->diag, LS_ERR_INVALID, "FOLDER: the path is too long");
    return LS_OK;
}

static enum ls_err export_light(struct work *work, uint32_t light)
{
    char path[4096], end[32];
    bool written = false;
    snprintf(end, sizeof end, "%04u.exr", light + 1);
    enum ls_err err = path_of(work, end, path, sizeof path);
    if (!err)
        err = ls_export_file(&work->export, light, path, &written);
    if (err)
        return err;
    const struct ls_exr_attr *gain =
        ls_exr_attrs_find(&work->export.spectra[0].attrs, "lightstage/gain");
    *(written ? &work->written : &work->skipped) += 1;
    err = ls_contact_sheet_add(&work->sheet, &work->export.spectra[0].image, light,
                               &work->context->diag);
    if (err)
        return err;
    return ls_export_list_add(&work->list, work->document, strrchr(path, '/') + 1, light,
                              gain ? (double)gain->f[0] : 1, &work->context->diag);
}

static enum ls_err export_lights(struct work *work)
{
    const char *text = work->options->lights;
    uint32_t *lights = NULL, limit = work->document->n_lights;
    size_t n = limit;
    bool terminal = isatty(STDERR_FILENO);
    enum ls_err err = LS_OK;
    if (text && !ls_lights_option(text, limit, &lights, &n))
        return ls_fail(&work->context->diag, LS_ERR_INVALID,
                       "--lights %s: expected numbers and ranges from 0 to %u, e.g. 0,5,7-9", text,
                       limit - 1);
    err = ls_contact_sheet_begin(&work->sheet, n,
                                 work->export.space.shown ? work->export.space.to_rec709 : NULL,
                                 &work->context->diag);
    for (size_t i = 0; i < n && !err; i++) {
        err = export_light(work, lights ? lights[i] : (uint32_t)i);
        if (terminal)
            fprintf(stderr, "\r%zu of %zu lights%s", i + 1, n, i + 1 == n || err ? "\n" : "");
    }
    free(lights);
    return err;
}

/* ---- the command ---- */

static enum ls_err write_list(struct work *work, const json_t *document)
{
    char json[4096], csv[4096];
    enum ls_err err = path_of(work, "json", json, sizeof json);
    if (!err)
        err = path_of(work, "csv", csv, sizeof csv);
    return err ? err : ls_export_list_write(&work->list, document, json, csv, &work->context->diag);
}

static enum ls_err write_sheet(struct work *work)
{
    char path[4096];
    enum ls_err err = path_of(work, "png", path, sizeof path);
    return err ? err
               : ls_contact_sheet_write(&work->sheet, path, &work->sheet_scale,
                                        &work->context->diag);
}

static enum ls_err report(struct work *work)
{
    enum ls_err err = write_sheet(work);
    if (err)
        return err;
    json_t *document =
        json_pack("{ss si si s{ss+ ss sf} sO}", "take", work->document->id, "written",
                  (int)work->written, "skipped", (int)work->skipped, "contact_sheet", "file",
                  work->document->id, ".png", "channel", work->export.spectra[0].name, "scale",
                  (double)work->sheet_scale, "frames", work->list.frames);
    err = write_list(work, document);
    if (!err && work->context->json)
        ls_command_print_json(json_incref(document));
    else if (!err)
        printf("%u files written, %u were there\n", work->written, work->skipped);
    json_decref(document);
    return err;
}

static enum ls_err export_take(struct work *work)
{
    struct ls_diag *diag = &work->context->diag;
    enum ls_err err =
        ls_export_space_begin(&work->export.space, work->options->space, work->document, diag);
    if (!err)
        err = ls_export_begin(&work->export, work->options->channels);
    if (!err && mkdir(work->options->folder, 0777) && errno != EEXIST)
        err = ls_fail(diag, LS_ERR_INVALID, "%s: %s", work->options->folder, strerror(errno));
    if (!err)
        err = ls_export_list_begin(&work->list, diag);
    if (!err)
        err = export_lights(work);
    return err ? err : report(work);
}

static int run(struct ls_command_context *context, int argc, char **argv)
{
    struct options options = {.space = "camera"};
    struct ls_take_document *document = NULL;
    int code = parse(context, argc, argv, &options);
    if (!code)
        code = ls_take_document_get(context, argv[optind], options.camera, &document);
    if (code)
        return code;
    options.folder = argv[optind + 1];
    struct work work = {.context = context,
                        .options = &options,
                        .document = document,
                        .export = {.context = context,
                                   .document = document,
                                   .promotion = options.promotion,
                                   .half = options.half,
                                   .packed = options.packed,
                                   .camera = options.camera}};
    enum ls_err err = export_take(&work);
    ls_export_forget(&work.export);
    ls_export_list_finish(&work.list);
    ls_contact_sheet_finish(&work.sheet);
    ls_take_document_destroy(document);
    return err ? ls_command_failed(context, err) : LS_EXIT_OK;
}

const struct ls_command ls_command_export = {
    "export", "Every light's spectra as one OpenEXR file; beside them a list and a contact sheet",
    "TAKE FOLDER [--channels W,R,...] [--lights 0,5,7-9] [--half] [--packed]\n" LS_PROMOTION_USAGE
    "         [--space camera|rec709|acescg] [--camera N] [--json]\n",
    run};
