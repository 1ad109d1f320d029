#include "judge.h"

#include "core/demosaic.h"
#include "sim/subject.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { TRUTH_DIRECTIONS = 200000, IMAGE_LIMIT_BYTES = 1 << 30 };

static enum ls_err demosaic(const struct ls_field *f, const float *mosaic, struct ls_image *image)
{
    const struct ls_demosaic_region all = {0, 0, f->width, f->height};
    const struct ls_demosaic_source source = {mosaic, f->width, all, f->width, f->height, f->cfa};
    const struct ls_demosaic_target target = {
        {image->pixels, image->pixels + 1, image->pixels + 2}, 3, 3 * (size_t)f->width};
    return ls_demosaic(&source, all, LS_DEMOSAIC_GRADIENT, &target);
}

/* RGB at every pixel -> mosaic -> RGB, as the camera and the take have it. */
static enum ls_err through_mosaic(const struct ls_field *f, struct ls_image *image,
                                  struct ls_diag *diag)
{
    LS_CLEANUP_FREE float *mosaic = malloc((size_t)f->width * f->height * sizeof *mosaic);
    if (!mosaic)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for a mosaic");
    for (uint32_t y = 0; y < f->height; y++)
        for (uint32_t x = 0; x < f->width; x++) {
            size_t j = (size_t)y * f->width + x;
            mosaic[j] = image->pixels[3 * j + ls_cfa_channel(f->cfa, x, y)];
        }
    return demosaic(f, mosaic, image);
}

enum ls_err judge_true_picture(const struct judge *judge, struct ls_image *image,
                               struct ls_image *specular, struct ls_diag *diag)
{
    const struct sim_region region = {judge->source->camera, 0, 0, judge->source->width,
                                      judge->source->height};
    struct ls_image out = {0}, share = {0};
    enum ls_err err =
        ls_image_init(&out, region.width, region.height, JUDGE_COLOURS, IMAGE_LIMIT_BYTES, diag);
    if (!err)
        err = ls_image_init(&share, region.width, region.height, 1, IMAGE_LIMIT_BYTES, diag);
    if (!err)
        err = sim_truth_environment(judge->scene, &region, judge->lobes, TRUTH_DIRECTIONS,
                                    out.pixels, share.pixels, diag);
    if (!err)
        err = through_mosaic(&judge->source->field, &out, diag);
    if (err) {
        ls_image_finish(&out);
        ls_image_finish(&share);
        return err;
    }
    *image = out;
    *specular = share;
    return LS_OK;
}

enum ls_err judge_picture_error(const struct ls_image *relit, const struct ls_image *truth,
                                const struct ls_image *specular, double *percent,
                                struct ls_diag *diag)
{
    if (relit->width != truth->width || relit->height != truth->height || relit->n_channels != 3)
        return ls_fail(diag, LS_ERR_INVALID, "relit picture is %ux%ux%u, the truth %ux%ux3",
                       relit->width, relit->height, relit->n_channels, truth->width, truth->height);
    double difference = 0, total = 0;
    for (size_t j = 0; j < (size_t)truth->width * truth->height; j++)
        for (int c = 0; c < JUDGE_COLOURS && !(specular->pixels[j] > 0.5f); c++) {
            double d = (double)relit->pixels[3 * j + c] - truth->pixels[3 * j + c];
            difference += d * d;
            total += (double)truth->pixels[3 * j + c] * truth->pixels[3 * j + c];
        }
    *percent = 100 * sqrt(difference / total);
    return LS_OK;
}

/* A sample's mean pixel after M. */
static void sample_mean(const struct ls_image *image, const struct sim_sample *r,
                        const double m[3][3], double out[JUDGE_COLOURS])
{
    double mean[JUDGE_COLOURS] = {0};
    for (uint32_t y = r->y; y < r->y + r->height; y++)
        for (uint32_t x = r->x; x < r->x + r->width; x++)
            for (int c = 0; c < JUDGE_COLOURS; c++)
                mean[c] += image->pixels[((size_t)y * image->width + x) * 3 + c] /
                           ((double)r->width * r->height);
    for (int c = 0; c < JUDGE_COLOURS; c++)
        out[c] = m[c][0] * mean[0] + m[c][1] * mean[1] + m[c][2] * mean[2];
}

/* Mean square over the samples of a group, of a true white patch that is 1. */
static double group_error(const struct sim_sample *samples, const char *group,
                          const struct ls_image *relit, const struct ls_image *truth,
                          const double m[3][3])
{
    double sum = 0, white = NAN;
    unsigned n = 0;
    for (uint32_t k = 0; k < SIM_SAMPLES; k++) {
        double a[JUDGE_COLOURS], b[JUDGE_COLOURS];
        sample_mean(relit, &samples[k], m, a);
        sample_mean(truth, &samples[k], m, b);
        if (!strcmp(samples[k].name, "white"))
            white = fmax(b[0], fmax(b[1], b[2]));
        for (int c = 0; c < JUDGE_COLOURS && !strcmp(samples[k].group, group); c++, n++)
            sum += (a[c] - b[c]) * (a[c] - b[c]);
    }
    return sum / n / (white * white);
}

enum ls_err judge_paper_error(const struct judge *judge, const struct ls_image *relit,
                              const struct ls_image *truth, double *chart, double *fabric,
                              double *rms, struct ls_diag *diag)
{
    const struct ls_calibration *calibration = judge->source->facts->calibration;
    struct sim_sample samples[SIM_SAMPLES];
    *chart = *fabric = *rms = NAN;
    if (!calibration || !calibration->has_m)
        return LS_OK;
    if (relit->width != truth->width || relit->height != truth->height || relit->n_channels != 3)
        return ls_fail(diag, LS_ERR_INVALID, "relit picture is %ux%ux%u, the truth %ux%ux3",
                       relit->width, relit->height, relit->n_channels, truth->width, truth->height);
    enum ls_err err = sim_truth_samples(judge->scene, judge->source->camera, samples, diag);
    if (err)
        return err;
    double patches = group_error(samples, "chart", relit, truth, calibration->m);
    double fabrics = group_error(samples, "fabric", relit, truth, calibration->m);
    *chart = 100 * patches;
    *fabric = 100 * fabrics;
    *rms = 100 * sqrt((SIM_CHART_PATCHES * patches + SIM_FABRICS * fabrics) /
                      (SIM_CHART_PATCHES + SIM_FABRICS));
    return LS_OK;
}

/* A mapped mosaic as RGB. */
static enum ls_err view(const struct ls_field *f, const struct ls_picture *picture,
                        struct ls_image *out, struct ls_diag *diag)
{
    const struct ls_demosaic_region all = {0, 0, f->width, f->height};
    LS_CLEANUP_FREE float *mosaic = malloc((size_t)f->width * f->height * sizeof *mosaic);
    if (!mosaic)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for a mosaic");
    enum ls_err err =
        ls_image_init(out, f->width, f->height, JUDGE_COLOURS, IMAGE_LIMIT_BYTES, diag);
    if (err)
        return err;
    judge_load(f, picture, &all, mosaic);
    return demosaic(f, mosaic, out);
}

/* The light whose direction is closest to camera-left, above, in front. */
static uint32_t key_light(const struct ls_field *f)
{
    static const float wanted[3] = {-0.58f, 0.58f, 0.58f};
    uint32_t best = 0;
    float nearest = -2;
    for (uint32_t i = 0; i < f->n_lights; i++) {
        const float *d = f->directions[i];
        float cosine = d[0] * wanted[0] + d[1] * wanted[1] + d[2] * wanted[2];
        if (cosine > nearest) {
            nearest = cosine;
            best = i;
        }
    }
    return best;
}

enum ls_err judge_view_field(const struct judge *judge, struct ls_image *spheres,
                             struct ls_image *light, struct ls_diag *diag)
{
    const struct ls_field *f = &judge->source->field;
    enum ls_err err = view(f, &f->white[key_light(f)], light, diag);
    for (uint32_t s = 0; s < f->n_spectra && !err; s++)
        err = view(f, &f->sphere[s], &spheres[s], diag);
    return err;
}
