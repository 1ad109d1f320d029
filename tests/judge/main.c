/*
 * lightstage-judge: compare a take and pictures relit from it with the simulator's truth, and print
 * the numbers as one JSON object.
 */
#include "judge.h"

#include "core/exr.h"
#include "core/png.h"
#include "daemon/file.h"
#include "proto/models.h"
#include "sim/config.h"

#include <getopt.h>
#include <jansson.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum {
    LOG_MAX_BYTES = 1 << 30,
    FILE_MAX_BYTES = 1 << 30,
    SHEET_COLUMNS = 4,
    SHEET_SIDE_PX = 384,
    MAX_THUMBS = 16,
    EXIT_USAGE = 2,
};

static const char usage[] =
    "usage: lightstage-judge --simulator FILE --take FOLDER [--log FILE] [--environment FILE]\n"
    "           [--relit EXR --tristimulus EXR] [--sheet PNG] [--model MODEL]\n"
    "\n"
    "  --simulator FILE    configuration the take was simulated with\n"
    "  --take FOLDER       the take\n"
    "  --log FILE          what the simulator truly showed: count mislabeled frames\n"
    "  --environment FILE  spectral lobes (JSON): judge the field, relit by them\n"
    "  --relit EXR         picture relit with that environment, camera RGB\n"
    "  --tristimulus EXR   the same by the baseline\n"
    "  --sheet PNG         write a contact sheet\n"
    "  --model MODEL       of the field: sphere (default), headlight, separated, linear, "
    "measured\n";

struct options {
    const char *simulator, *take, *log, *environment, *relit, *tristimulus, *sheet, *model;
};

/* Everything opened for judging. */
struct bench {
    struct options o;
    struct ls_takedir *take;
    struct sim_config config;
    struct sim_scene *scene;
    struct ls_lobes *lobes;
    struct judge judge;
    struct ls_image truth, specular, relit, tristimulus, sphere[LS_FIELD_MAX_SPECTRA], light;
    json_t *result;
};

static struct options parse_options(int argc, char **argv)
{
    static const struct option longs[] = {
        {"simulator", required_argument, NULL, 's'},
        {"take", required_argument, NULL, 't'},
        {"log", required_argument, NULL, 'l'},
        {"environment", required_argument, NULL, 'e'},
        {"relit", required_argument, NULL, 'r'},
        {"tristimulus", required_argument, NULL, 'b'},
        {"sheet", required_argument, NULL, 'p'},
        {"model", required_argument, NULL, 'm'},
        {0},
    };
    struct options o = {.model = "sphere"};
    for (int c; (c = getopt_long(argc, argv, "", longs, NULL)) != -1;) {
        const char **target = c == 's'   ? &o.simulator
                              : c == 't' ? &o.take
                              : c == 'l' ? &o.log
                              : c == 'e' ? &o.environment
                              : c == 'r' ? &o.relit
                              : c == 'b' ? &o.tristimulus
                              : c == 'p' ? &o.sheet
                              : c == 'm' ? &o.model
                                         : NULL;
        if (!target) {
            fputs(usage, stderr);
            exit(EXIT_USAGE);
        }
        *target = optarg;
    }
    Lightstage__Model model;
    if (optind != argc || !o.simulator || !o.take || (o.relit && !o.environment) ||
        !ls_model_by_name(o.model, &model)) {
        fputs(usage, stderr);
        exit(EXIT_USAGE);
    }
    return o;
}

static void put(struct bench *b, const char *key, double value)
{
    json_object_set_new(b->result, key, isfinite(value) ? json_real(value) : json_null());
}

static void put_count(struct bench *b, const char *key, uint64_t value)
{
    json_object_set_new(b->result, key, json_integer((json_int_t)value));
}

/* Every planned shot, by its tickets: stored if one arrived, repaired if not the first. */
static void count_shots(struct bench *b)
{
    uint32_t stored = 0, repaired = 0;
    uint64_t first_us = UINT64_MAX, last_us = 0;
    for (uint32_t shot = 0; shot < b->take->n_shots; shot++) {
        const struct ls_ticket *t = ls_takedir_ticket(b->take, shot);
        stored += t != NULL;
        repaired += t && t->attempt > 0;
        if (!t)
            continue;
        first_us = t->controller_us < first_us ? t->controller_us : first_us;
        last_us = t->controller_us > last_us ? t->controller_us : last_us;
    }
    put_count(b, "shots_planned", b->take->n_shots);
    put_count(b, "shots_stored", stored);
    put_count(b, "shots_lost", b->take->n_shots - stored);
    put_count(b, "shots_repaired", repaired);
    double seconds = stored > 1 ? (double)(last_us - first_us) * 1e-6 : 0;
    put(b, "take_seconds", seconds);
    put(b, "frames_per_second", seconds > 0 ? (stored - 1) / seconds : 0);
}

static enum ls_err check_labels(struct bench *b, struct ls_diag *diag)
{
    if (!b->o.log)
        return LS_OK;
    LS_CLEANUP_FREE char *text = NULL;
    size_t length = 0;
    struct judge_labels labels;
    enum ls_err err = ls_file_read(b->o.log, LOG_MAX_BYTES, &text, &length, diag);
    if (!err)
        err = judge_check_labels(b->take, text, &labels, diag);
    if (err)
        return err;
    put_count(b, "frames_mislabeled", labels.mislabeled);
    if (labels.first[0])
        fprintf(stderr, "lightstage-judge: %s\n", labels.first);
    return LS_OK;
}

static enum ls_err open_field(struct bench *b, struct ls_diag *diag)
{
    char storage[4096];
    snprintf(storage, sizeof storage, "%s/..", b->o.take);
    LS_CLEANUP_FREE char *json = NULL;
    size_t length = 0;
    enum ls_err err = sim_scene_create(&b->config.scene, &b->scene, diag);
    if (!err)
        err = ls_field_source_open(storage, b->take->id, 0, &b->judge.source, diag);
    if (!err)
        err = ls_file_read(b->o.environment, FILE_MAX_BYTES, &json, &length, diag);
    if (!err)
        err = ls_lobes_parse_json(json, length, &b->lobes, diag);
    b->judge.scene = b->scene;
    b->judge.lobes = b->lobes;
    ls_model_by_name(b->o.model, &b->judge.promotion.model);
    return err;
}

static enum ls_err judge_field(struct bench *b, struct ls_diag *diag)
{
    struct judge_field_errors e;
    const struct ls_field_source *source = b->judge.source;
    enum ls_err err = judge_field_errors(&b->judge, &e, diag);
    if (err)
        return err;
    put_count(b, "lights", source->field.n_lights);
    put_count(b, "channels", source->facts->n_channels);
    put_count(b, "width", source->width);
    put_count(b, "height", source->height);
    json_object_set_new(b->result, "calibration", json_string("given"));
    json_object_set_new(b->result, "model", json_string(b->o.model));
    put(b, "promotion_error_percent", e.promotion);
    json_t *by_channel = json_object();
    for (uint32_t s = 1; s < source->field.n_spectra; s++)
        json_object_set_new(by_channel, source->facts->channels[source->channel_of[s]].name,
                            json_real(e.promotion_by_spectrum[s]));
    json_object_set_new(b->result, "promotion_error_by_channel", by_channel);
    put(b, "olat_mae_percent", e.olat_mae);
    put(b, "field_rms_percent", e.field_rms);
    put(b, "interreflection_rms_percent", e.interreflection_rms);
    put(b, "highlight_rms_percent", e.highlight_rms);
    put(b, "black_mean_sigma", e.black_mean_sigma);
    return LS_OK;
}

static enum ls_err read_exr(const char *path, struct ls_image *image, struct ls_diag *diag)
{
    LS_CLEANUP_FREE char *bytes = NULL;
    size_t length = 0;
    enum ls_err err = ls_file_read(path, FILE_MAX_BYTES, &bytes, &length, diag);
    return err ? err : ls_exr_read(bytes, length, NULL, FILE_MAX_BYTES, image, NULL, diag);
}

static enum ls_err judge_picture(struct bench *b, const char *path, struct ls_image *image,
                                 const char *key, struct ls_diag *diag)
{
    double error;
    enum ls_err err = read_exr(path, image, diag);
    if (!err)
        err = judge_picture_error(image, &b->truth, &b->specular, &error, diag);
    if (!err)
        put(b, key, error);
    return err;
}

static enum ls_err judge_as_the_paper(struct bench *b, struct ls_diag *diag)
{
    double chart, fabric, rms;
    enum ls_err err =
        judge_paper_error(&b->judge, &b->relit, &b->truth, &chart, &fabric, &rms, diag);
    if (err)
        return err;
    put(b, "paper_mse_chart_percent", chart);
    put(b, "paper_mse_fabric_percent", fabric);
    put(b, "paper_rms_percent", rms);
    return LS_OK;
}

static enum ls_err judge_pictures(struct bench *b, struct ls_diag *diag)
{
    enum ls_err err = judge_true_picture(&b->judge, &b->truth, &b->specular, diag);
    if (!err && b->o.relit)
        err = judge_picture(b, b->o.relit, &b->relit, "relight_error_percent", diag);
    if (!err && b->o.relit)
        err = judge_as_the_paper(b, diag);
    if (!err && b->o.tristimulus)
        err =
            judge_picture(b, b->o.tristimulus, &b->tristimulus, "tristimulus_error_percent", diag);
    return err;
}

/* The 99th percentile of green, to make a picture visible. */
static int by_value(const void *a, const void *b)
{
    float x = *(const float *)a, y = *(const float *)b;
    return x < y ? -1 : x > y;
}

static double exposure_gain(const struct ls_image *image)
{
    size_t n = (size_t)image->width * image->height;
    float *green = malloc(n * sizeof *green);
    double gain = 1;
    for (size_t i = 0; green && i < n; i++)
        green[i] = image->pixels[i * image->n_channels + (image->n_channels == 3)];
    if (green) {
        qsort(green, n, sizeof *green, by_value);
        gain = green[n / 100 * 99] > 0 ? 0.9 / green[n / 100 * 99] : 1;
    }
    free(green);
    return gain;
}

/* |relit - truth|, ten times. */
static enum ls_err difference(const struct ls_image *a, const struct ls_image *b,
                              struct ls_image *out, struct ls_diag *diag)
{
    enum ls_err err = ls_image_init(out, a->width, a->height, 3, FILE_MAX_BYTES, diag);
    for (size_t i = 0; !err && i < 3 * (size_t)a->width * a->height; i++)
        out->pixels[i] = 10 * fabsf(a->pixels[i] - b->pixels[i]);
    return err;
}

static enum ls_err write_sheet(struct bench *b, struct ls_diag *diag)
{
    const struct ls_calibration *c = b->judge.source->facts->calibration;
    const double *m = c->has_m ? &c->m[0][0] : NULL;
    struct ls_image sheet = {0}, ours = {0}, theirs = {0};
    struct judge_thumb thumbs[MAX_THUMBS];
    uint32_t n = 0;
    double gain = exposure_gain(&b->truth);
    enum ls_err err = difference(&b->relit, &b->truth, &ours, diag);
    if (!err)
        err = difference(&b->tristimulus, &b->truth, &theirs, diag);
    if (!err) {
        thumbs[n++] = (struct judge_thumb){&b->truth, m, gain};
        thumbs[n++] = (struct judge_thumb){&b->relit, m, gain};
        thumbs[n++] = (struct judge_thumb){&b->tristimulus, m, gain};
        thumbs[n++] = (struct judge_thumb){&ours, NULL, gain};
        for (uint32_t s = 0; s < b->judge.source->field.n_spectra && n + 2 < MAX_THUMBS; s++)
            thumbs[n++] = (struct judge_thumb){&b->sphere[s], m, exposure_gain(&b->sphere[s])};
        thumbs[n++] = (struct judge_thumb){&b->light, m, exposure_gain(&b->light)};
        thumbs[n++] = (struct judge_thumb){&theirs, NULL, gain};
        err = judge_contact_sheet(thumbs, n, SHEET_COLUMNS, SHEET_SIDE_PX, &sheet, diag);
    }
    uint8_t *bytes = NULL;
    size_t n_bytes = 0;
    if (!err)
        err = ls_png_write(&sheet, 1.0f, &bytes, &n_bytes, diag);
    FILE *file = err ? NULL : fopen(b->o.sheet, "wbe");
    if (!err && (!file || fwrite(bytes, 1, n_bytes, file) != n_bytes))
        err = ls_fail(diag, LS_ERR_OS, "%s: %m", b->o.sheet);
    if (file && fclose(file) && !err)
        err = ls_fail(diag, LS_ERR_OS, "%s: %m", b->o.sheet);
    free(bytes);
    ls_image_finish(&sheet);
    ls_image_finish(&ours);
    ls_image_finish(&theirs);
    return err;
}

static enum ls_err judge_all(struct bench *b, struct ls_diag *diag)
{
    enum ls_err err = ls_takedir_open(b->o.take, &b->take, diag);
    if (!err)
        err = sim_config_load(b->o.simulator, &b->config, diag);
    if (err)
        return err;
    count_shots(b);
    err = check_labels(b, diag);
    if (err || !b->o.environment)
        return err;
    err = open_field(b, diag);
    if (!err)
        err = judge_field(b, diag);
    if (!err)
        err = judge_pictures(b, diag);
    if (!err && b->o.sheet && b->o.relit && b->o.tristimulus)
        err = judge_view_field(&b->judge, b->sphere, &b->light, diag);
    if (!err && b->o.sheet && b->o.relit && b->o.tristimulus)
        err = write_sheet(b, diag);
    return err;
}

static void finish(struct bench *b)
{
    for (uint32_t s = 0; s < LS_FIELD_MAX_SPECTRA; s++)
        ls_image_finish(&b->sphere[s]);
    ls_image_finish(&b->light);
    ls_image_finish(&b->truth);
    ls_image_finish(&b->specular);
    ls_image_finish(&b->relit);
    ls_image_finish(&b->tristimulus);
    ls_lobes_destroy(b->lobes);
    ls_field_source_close(b->judge.source);
    sim_scene_destroy(b->scene);
    ls_takedir_close(b->take);
    json_decref(b->result);
}

int main(int argc, char **argv)
{
    struct bench b = {.o = parse_options(argc, argv), .result = json_object()};
    struct ls_diag diag = {0};
    enum ls_err err = judge_all(&b, &diag);
    if (err)
        fprintf(stderr, "lightstage-judge: %s\n", diag.text);
    else
        err = json_dumpf(b.result, stdout, JSON_INDENT(1)) || putchar('\n') == EOF ? LS_ERR_OS
                                                                                   : LS_OK;
    finish(&b);
    return err ? EXIT_FAILURE : EXIT_SUCCESS;
}
