#include "clients/command.h"
#include "clients/numbered_name.h"
#include "clients/picture_file.h"
#include "clients/region_option.h"

#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

struct options {
    uint32_t camera, frames; /* frames 0: until interrupted */
    double exposure_us, level;
    const char *light, *output;
};

/* ---- options ---- */

static bool read_number(const char *text, double low, double high, double *out)
{
    char *end;
    *out = strtod(text, &end);
    return *text && !*end && *out >= low && *out <= high;
}

static int read_option(int option, const char *text, struct options *o)
{
    double number = 0;
    switch (option) {
    case 'c':
        return ls_camera_option(text, &o->camera);
    case 'n':
        if (!read_number(text, 1, 1e9, &number) || number != floor(number))
            return ls_command_wrong("preview: --frames: expected 1 or more");
        o->frames = (uint32_t)number;
        return LS_EXIT_OK;
    case 'e':
        if (!read_number(text, 1, 1e6, &o->exposure_us))
            return ls_command_wrong("preview: --exposure: expected 1 to 1000000 us");
        return LS_EXIT_OK;
    case 'v':
        if (!read_number(text, 0, 100, &number) || number == 0)
            return ls_command_wrong("preview: --level: expected percent, above 0, at most 100");
        o->level = number / 100;
        return LS_EXIT_OK;
    case 'l':
        o->light = text;
        return LS_EXIT_OK;
    case 'o':
        o->output = text;
        return LS_EXIT_OK;
    }
    return LS_EXIT_USAGE;
}

static int parse(struct ls_command_context *context, int argc, char **argv, struct options *o)
{
    static const struct option options[] = {{"camera", required_argument, NULL, 'c'},
                                            {"exposure", required_argument, NULL, 'e'},
                                            {"light", required_argument, NULL, 'l'},
                                            {"level", required_argument, NULL, 'v'},
                                            {"frames", required_argument, NULL, 'n'},
                                            {"output", required_argument, NULL, 'o'},
                                            LS_COMMON_OPTIONS};
    *o = (struct options){.level = 0.1};
    for (int c; (c = ls_command_option(context, &ls_command_preview, argc, argv, options)) != -1;)
        if (read_option(c, optarg, o))
            return LS_EXIT_USAGE;
    if (!ls_command_arguments(&ls_command_preview, argc, 0))
        return LS_EXIT_USAGE;
    if (o->light && !o->exposure_us)
        return ls_command_wrong("preview: --light goes with --exposure US");
    if (o->output && ls_command_check_writable(o->output, &context->diag))
        return ls_command_wrong("%s", context->diag.text);
    return LS_EXIT_OK;
}

/* ---- a picture ---- */

static float linear(uint8_t code)
{
    double v = code / 255.0;
    return (float)(v <= 0.04045 ? v / 12.92 : pow((v + 0.055) / 1.055, 2.4));
}

static enum ls_err write_picture(const char *path, const struct lightstage_view *p,
                                 struct ls_diag *diag)
{
    size_t n = (size_t)p->width * p->height * 3;
    LS_CLEANUP_FREE float *pixels = malloc(n * sizeof *pixels + 1);
    if (!pixels)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    for (size_t i = 0; i < n; i++)
        pixels[i] = linear(p->rgb[i]);
    const struct ls_image image = {
        .width = p->width, .height = p->height, .n_channels = 3, .pixels = pixels};
    return ls_picture_file_png(path, &image, 1, NULL, diag);
}

static int save(struct ls_command_context *context, const struct options *o,
                const struct lightstage_view *p, uint32_t number)
{
    if (!o->output)
        return LS_EXIT_OK;
    LS_CLEANUP_FREE char *path = ls_name_numbered(o->output, number);
    enum ls_err err = path ? write_picture(path, p, &context->diag)
                           : ls_fail(&context->diag, LS_ERR_NOMEM, "out of memory");
    return err ? ls_command_wrong("%s", context->diag.text) : LS_EXIT_OK;
}

static void print_json(const struct lightstage_view *p, uint32_t number)
{
    json_t *clip = json_array();
    for (size_t i = 0; i < p->n_clip; i++)
        json_array_append_new(clip, json_real(p->clip[i]));
    json_t *line = json_pack("{sI sI sf sf so sI}", "picture", (json_int_t)number, "frame_id",
                             (json_int_t)p->frame_id, "exposure_us", p->exposure_us, "focus",
                             p->focus, "clip", clip, "skipped", (json_int_t)p->skipped);
    LS_CLEANUP_FREE char *text = json_dumps(line, JSON_COMPACT);
    json_decref(line);
    puts(text ? text : "{}");
}

static void print_text(const struct lightstage_view *p, uint32_t number)
{
    static const char *const colours[] = {"R", "G", "B"};
    printf("%6" PRIu32 "  focus %9.6f  clip", number, p->focus);
    for (size_t i = 0; i < p->n_clip && i < 3; i++)
        printf(" %s%.2f %%", p->n_clip == 3 ? colours[i] : "", 100 * p->clip[i]);
    printf("  %.0f us\n", p->exposure_us);
}

/* ---- the command ---- */

struct looking {
    struct ls_command_context *context;
    const struct options *options;
    uint32_t seen;
    int code;
};

static int look(const struct lightstage_view *view, void *user)
{
    struct looking *looking = user;
    uint32_t number = ++looking->seen;
    if (looking->context->json)
        print_json(view, number);
    else
        print_text(view, number);
    fflush(stdout);
    looking->code = save(looking->context, looking->options, view, number);
    return looking->code || number == looking->options->frames;
}

static int run(struct ls_command_context *context, int argc, char **argv)
{
    struct options o;
    struct looking looking = {.context = context, .options = &o};
    uint32_t request = 0;
    int code = parse(context, argc, argv, &o);
    if (!code)
        code = ls_command_open(context);
    if (code)
        return code;
    const struct lightstage_preview preview = {.size = sizeof preview,
                                               .exposure_us = o.exposure_us,
                                               .channel = o.light,
                                               .level = o.level,
                                               .camera = o.camera};
    code =
        ls_command_answered(context, lightstage_preview_begin(context->stage, &preview, look,
                                                              &looking, &request, &context->error));
    if (code)
        return code;
    if (!o.exposure_us && !context->json)
        fputs("waiting for frames of a take; --exposure US shows what a camera sees without one\n",
              stderr);
    uint32_t number = lightstage_wait(context->stage, request, &context->error);
    if (looking.code || (o.frames && looking.seen == o.frames))
        return looking.code;
    return ls_command_answered(context, number);
}

const struct ls_command ls_command_preview = {
    "preview", "What a camera sees, its focus and clipping, as it goes",
    "[--camera N] [--exposure US [--light CHANNEL] [--level PERCENT]]\n"
    "                             [--frames N] [--output FILE.png] [--json]\n"
    "  --exposure US    let the camera run freely, while no take runs; without it only takes are "
    "seen\n"
    "  --light CHANNEL  under every light of it, steadily\n"
    "  --level PERCENT  of its full strength (10)\n"
    "  --frames N       leave after N pictures; else Ctrl-C does\n"
    "  --output FILE    the latest picture, or each under its number where FILE holds %03d",
    run};
