#include "sim/truth.h"

#include "core/exr.h"
#include "sim/file.h"
#include "sim/truth_options.h"
#include "sim/world.h"

#include <errno.h>
#include <jansson.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum {
    EXIT_USAGE = 2,
    ENVIRONMENT_DIRECTIONS = 400000,
    MAX_FILE_BYTES = 64 << 20,
};

static const char usage_text[] =
    "usage: lightstage-sim describe    [--camera N] [--pixel-format NAME] [--duty D,...]\n"
    "                                  --output FOLDER\n"
    "       lightstage-sim field       --lights N,N-M --channels NAME,... [--mosaic]\n"
    "                                  [--camera N] [--region X,Y,W,H] --output FOLDER\n"
    "       lightstage-sim relit       --weights FILE [--mosaic] [...] --output FILE.exr\n"
    "       lightstage-sim environment --lobes FILE [--mosaic] [...] --output FILE.exr\n"
    "       lightstage-sim samples     [--camera N]\n"
    "       lightstage-sim masks       [--lights N,N-M] [...] --output FOLDER\n"
    "all take --config FILE, the simulator's own\n"
    "\n"
    "describe writes calibration.json and positions.csv. field writes CHANNEL.NNNN.exr, number =\n"
    "light + 1. --weights: {\"channel\": [one per light], ...}. --lobes: as sim/environment.json.\n"
    "samples prints JSON. masks writes bounced.exr (share of bounced light under all white lights;\n"
    "the mask is > 0.2) and specular.NNNN.exr per light (> 0.5).\n";

/* ---- files ---- */

static enum ls_err write_file(const char *folder, const char *name, const void *bytes, size_t size,
                              struct ls_diag *diag)
{
    char path[2048];
    snprintf(path, sizeof path, "%s%s%s", folder ? folder : "", folder ? "/" : "", name);
    FILE *file = fopen(path, "wb");
    size_t written = file ? fwrite(bytes, 1, size, file) : 0;
    if (!file || fclose(file) || written != size)
        return ls_fail(diag, LS_ERR_OS, "%s: cannot be written: %s", path, strerror(errno));
    return LS_OK;
}

/* ---- pictures ---- */

struct picture {
    const struct sim_scene *scene;
    struct sim_region region;
    int mosaic;
};

/* Pick each pixel's own channel, in place of the first plane. */
static void to_mosaic(const struct picture *p, const float *rgb, float *mosaic)
{
    uint32_t colours = sim_truth_colours(p->scene, p->region.camera);
    const struct sim_region *r = &p->region;
    for (uint32_t y = 0; y < r->height; y++)
        for (uint32_t x = 0; x < r->width; x++) {
            size_t at = (size_t)y * r->width + x;
            uint32_t c = ls_cfa_channel(p->scene->view[r->camera].cfa, r->x + x, r->y + y);
            mosaic[at] = rgb[at * colours + (colours == 1 ? 0 : c)];
        }
}

static enum ls_err write_exr(const struct picture *p, float *pixels, uint32_t colours,
                             const char *folder, const char *name, struct ls_diag *diag)
{
    uint8_t *bytes = NULL;
    size_t size = 0;
    struct ls_image image = {p->region.width, p->region.height, colours, pixels};
    enum ls_err err = ls_exr_write_image(&image, LS_EXR_FLOAT, NULL, &bytes, &size, diag);
    if (!err)
        err = write_file(folder, name, bytes, size, diag);
    free(bytes);
    return err;
}

static enum ls_err write_picture(const struct picture *p, float *pixels, const char *folder,
                                 const char *name, struct ls_diag *diag)
{
    uint32_t colours = sim_truth_colours(p->scene, p->region.camera);
    if (!p->mosaic)
        return write_exr(p, pixels, colours, folder, name, diag);
    LS_CLEANUP_FREE float *mosaic =
        malloc((size_t)p->region.width * p->region.height * sizeof *mosaic);
    if (!mosaic)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for a mosaic");
    to_mosaic(p, pixels, mosaic);
    return write_exr(p, mosaic, 1, folder, name, diag);
}

static size_t picture_values(const struct picture *p)
{
    return (size_t)p->region.width * p->region.height *
           sim_truth_colours(p->scene, p->region.camera);
}

/* ---- subcommands ---- */

static enum ls_err write_positions(const struct sim_scene *scene, const char *folder,
                                   struct ls_diag *diag)
{
    const struct sim_geometry *g = sim_scene_geometry(scene);
    size_t size = 0;
    char *text = NULL;
    FILE *out = open_memstream(&text, &size);
    if (!out)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for positions");
    fprintf(out, "# x,y,z of every light in m: right, up, towards the camera\n");
    for (uint32_t i = 0; i < g->n_lights; i++)
        fprintf(out, "%.9g,%.9g,%.9g\n", (double)g->position_m[i][0], (double)g->position_m[i][1],
                (double)g->position_m[i][2]);
    fclose(out);
    enum ls_err err = write_file(folder, "positions.csv", text, size, diag);
    free(text);
    return err;
}

static enum ls_err describe(const struct sim_scene *scene, const struct sim_truth_options *o,
                            struct ls_diag *diag)
{
    struct ls_calibration *calibration = NULL;
    char *text = NULL;
    enum ls_err err = sim_truth_calibration(scene, o->region.camera, o->pixel_format, o->duties,
                                            o->n_duties, &calibration, diag);
    if (!err)
        err = ls_calibration_write(calibration, &text, diag);
    if (!err)
        err = write_file(o->output, "calibration.json", text, strlen(text), diag);
    if (!err)
        err = write_positions(scene, o->output, diag);
    free(text);
    ls_calibration_destroy(calibration);
    return err;
}

static enum ls_err field(const struct sim_scene *scene, const struct sim_truth_options *o,
                         struct ls_diag *diag)
{
    struct picture p = {scene, o->region, o->mosaic};
    size_t n = picture_values(&p);
    LS_CLEANUP_FREE float *all = malloc(n * sim_scene_config(scene)->n_channels * sizeof *all);
    enum ls_err err = all ? LS_OK : ls_fail(diag, LS_ERR_NOMEM, "out of memory for a field");
    for (uint32_t i = 0; i < o->n_lights && !err; i++) {
        err = sim_truth_field(scene, &p.region, o->lights[i], all, diag);
        for (uint32_t s = 0; s < o->n_channels && !err; s++) {
            char name[64];
            snprintf(name, sizeof name, "%s.%04u.exr",
                     sim_scene_config(scene)->channels[o->channels[s]].name, o->lights[i] + 1);
            err = write_picture(&p, all + o->channels[s] * n, o->output, name, diag);
        }
    }
    return err;
}

static enum ls_err weights_of(const struct sim_scene *scene, const char *path, float *weights,
                              struct ls_diag *diag)
{
    json_error_t where;
    json_t *root = json_load_file(path, JSON_REJECT_DUPLICATES, &where);
    uint32_t lights = sim_scene_geometry(scene)->n_lights;
    const struct sim_scene_config *config = sim_scene_config(scene);
    if (!root)
        return ls_fail(diag, LS_ERR_INVALID, "%s:%d: %.200s", path, where.line, where.text);
    enum ls_err err = LS_OK;
    for (uint32_t s = 0; s < config->n_channels && !err; s++) {
        const json_t *list = json_object_get(root, config->channels[s].name);
        if (list && json_array_size(list) != lights)
            err = ls_fail(diag, LS_ERR_INVALID, "%s: %s: expected an array of %u weights", path,
                          config->channels[s].name, lights);
        for (uint32_t i = 0; list && i < lights && !err; i++)
            weights[s * lights + i] = (float)json_number_value(json_array_get(list, i));
    }
    json_decref(root);
    return err;
}

static enum ls_err relit(const struct sim_scene *scene, const struct sim_truth_options *o,
                         struct ls_diag *diag)
{
    struct picture p = {scene, o->region, o->mosaic};
    LS_CLEANUP_FREE float *out = malloc(picture_values(&p) * sizeof *out);
    LS_CLEANUP_FREE float *weights = calloc((size_t)sim_scene_geometry(scene)->n_lights *
                                                SIM_MAX_CHANNELS, sizeof *weights);
    if (!out || !weights)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for a picture");
    enum ls_err err = weights_of(scene, o->weights, weights, diag);
    if (!err)
        err = sim_truth_relight(scene, &p.region, weights, 1, out, diag);
    return err ? err : write_picture(&p, out, NULL, o->output, diag);
}

static enum ls_err environment(const struct sim_scene *scene, const struct sim_truth_options *o,
                               struct ls_diag *diag)
{
    struct picture p = {scene, o->region, o->mosaic};
    struct ls_lobes *lobes = NULL;
    LS_CLEANUP_FREE char *text = NULL;
    LS_CLEANUP_FREE float *out = malloc(picture_values(&p) * sizeof *out);
    size_t size = 0;
    if (!out)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for a picture");
    enum ls_err err = sim_file_read(o->lobes, MAX_FILE_BYTES, &text, &size, diag);
    if (!err)
        err = ls_lobes_parse_json(text, size, &lobes, diag);
    if (!err)
        err = sim_truth_environment(scene, &p.region, lobes, ENVIRONMENT_DIRECTIONS, out, NULL,
                                    diag);
    if (!err)
        err = write_picture(&p, out, NULL, o->output, diag);
    ls_lobes_destroy(lobes);
    return err;
}

static enum ls_err samples(const struct sim_scene *scene, const struct sim_truth_options *o,
                           struct ls_diag *diag)
{
    struct sim_sample list[SIM_SAMPLES];
    enum ls_err err = sim_truth_samples(scene, o->region.camera, list, diag);
    if (err)
        return err;
    json_t *out = json_array();
    for (int k = 0; k < SIM_SAMPLES; k++)
        json_array_append_new(out, json_pack("{s:s, s:s, s:i, s:i, s:i, s:i}", "name", list[k].name,
                                             "group", list[k].group, "x", (int)list[k].x, "y",
                                             (int)list[k].y, "width", (int)list[k].width, "height",
                                             (int)list[k].height));
    int failed = json_dumpf(out, stdout, JSON_INDENT(1)) || puts("") < 0;
    json_decref(out);
    return failed ? ls_fail(diag, LS_ERR_OS, "cannot write to standard output") : LS_OK;
}

static enum ls_err masks(const struct sim_scene *scene, const struct sim_truth_options *o,
                         struct ls_diag *diag)
{
    struct picture p = {scene, o->region, 0};
    LS_CLEANUP_FREE float *out =
        malloc((size_t)p.region.width * p.region.height * sizeof *out);
    if (!out)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for a mask");
    enum ls_err err = sim_truth_bounced(scene, &p.region, out, diag);
    if (!err)
        err = write_exr(&p, out, 1, o->output, "bounced.exr", diag);
    for (uint32_t i = 0; i < o->n_lights && !err; i++) {
        char name[64];
        snprintf(name, sizeof name, "specular.%04u.exr", o->lights[i] + 1);
        err = sim_truth_specular(scene, &p.region, o->lights[i], out, diag);
        if (!err)
            err = write_exr(&p, out, 1, o->output, name, diag);
    }
    return err;
}

/* ---- the whole ---- */

struct command {
    const char *name;
    enum ls_err (*run)(const struct sim_scene *scene, const struct sim_truth_options *options,
                       struct ls_diag *diag);
    unsigned needs; /* enum sim_truth_need */
};

static const struct command commands[] = {
    {"describe", describe, SIM_NEED_OUTPUT},
    {"field", field, SIM_NEED_OUTPUT | SIM_NEED_LIGHTS | SIM_NEED_CHANNELS},
    {"relit", relit, SIM_NEED_OUTPUT | SIM_NEED_WEIGHTS},
    {"environment", environment, SIM_NEED_OUTPUT | SIM_NEED_LOBES},
    {"samples", samples, 0},
    {"masks", masks, SIM_NEED_OUTPUT},
};

static const struct command *find_command(const char *name)
{
    for (size_t i = 0; i < sizeof commands / sizeof *commands; i++)
        if (!strcmp(commands[i].name, name))
            return &commands[i];
    return NULL;
}

bool sim_truth_has(const char *name)
{
    return find_command(name) != NULL;
}

const char *sim_truth_usage(void)
{
    return usage_text;
}

static int fail(const struct ls_diag *diag)
{
    fprintf(stderr, "lightstage-sim: %s\n", diag->text);
    return EXIT_FAILURE;
}

int sim_truth_main(const struct sim_scene_config *config, int argc, char **argv)
{
    struct ls_diag diag = {{0}};
    struct sim_truth_options options;
    struct sim_scene *scene = NULL;
    const struct command *command = argc > 0 ? find_command(argv[0]) : NULL;
    if (!command) {
        fputs(usage_text, stderr);
        return EXIT_USAGE;
    }
    enum ls_err err = sim_scene_create(config, &scene, &diag);
    if (err)
        return fail(&diag);
    err = sim_truth_options_parse(scene, argc, argv, command->needs, &options, &diag);
    if (err) {
        fprintf(stderr, "lightstage-sim %s: %s\n%s", argv[0], diag.text, usage_text);
        sim_scene_destroy(scene);
        return EXIT_USAGE;
    }
    err = command->run(scene, &options, &diag);
    sim_scene_destroy(scene);
    return err ? fail(&diag) : EXIT_SUCCESS;
}
