#include "daemon/dark_stage.h"

#include "core/merge.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { VARIANCE_FRAMES = 8, DRIFT_SIGMAS = 5 };

void ls_dark_stage_init(struct ls_dark_stage *stage, const struct ls_pixel_format *format,
                        uint32_t width, uint32_t height, bool black_check)
{
    *stage = (struct ls_dark_stage){
        .format = format, .width = width, .height = height, .black_check = black_check};
    pthread_mutex_init(&stage->lock, NULL);
}

void ls_dark_stage_finish(struct ls_dark_stage *stage)
{
    for (uint32_t i = 0; i < LS_MAX_EXPOSURES; i++) {
        ls_dark_destroy(stage->exposures[i].sum);
        free(stage->exposures[i].mean_dn);
        free(stage->exposures[i].validity);
    }
    ls_dark_destroy(stage->watch);
    ls_pixel_list_finish(&stage->defects);
    pthread_mutex_destroy(&stage->lock);
}

enum ls_err ls_dark_stage_expect(struct ls_dark_stage *stage, uint32_t exposure,
                                 struct ls_diag *diag)
{
    return ls_dark_create(stage->format, stage->width, stage->height,
                          &stage->exposures[exposure].sum, diag);
}

static enum ls_err flag(struct ls_dark_stage *stage, uint32_t exposure,
                        const struct ls_pixel_list *hot)
{
    uint8_t *validity = NULL;
    if (hot->n > 0 && !(validity = calloc((size_t)stage->width * stage->height, 1)))
        return LS_ERR_NOMEM;
    for (uint32_t i = 0; i < hot->n; i++)
        validity[hot->index[i]] = LS_VALIDITY_GAP;
    free(stage->exposures[exposure].validity);
    stage->exposures[exposure].validity = validity;
    return LS_OK;
}

/* @variance_dn2 may be NULL. */
static enum ls_err find_defects(struct ls_dark_stage *stage, uint32_t exposure,
                                const float *mean_dn, const float *variance_dn2,
                                struct ls_diag *diag)
{
    struct ls_pixel_list hot = {0};
    enum ls_err err =
        ls_hot_pixels(mean_dn, variance_dn2, stage->format->cfa, stage->width, stage->height, &hot);
    stage->exposures[exposure].n_defects = hot.n;
    if (!err)
        err = ls_pixel_list_join(&stage->defects, &hot);
    if (!err)
        err = flag(stage, exposure, &hot);
    ls_pixel_list_finish(&hot);
    return err ? ls_fail(diag, err, "%s while looking for hot pixels", ls_err_name(err)) : LS_OK;
}

static double mean_over(const float *dn, size_t n)
{
    double sum = 0;
    for (size_t i = 0; i < n; i++)
        sum += dn[i];
    return sum / (double)n;
}

enum ls_err ls_dark_stage_adopt(struct ls_dark_stage *stage, uint32_t exposure, uint32_t n_frames,
                                const float *mean_dn, struct ls_diag *diag)
{
    size_t n = (size_t)stage->width * stage->height;
    struct ls_dark_exposure *e = &stage->exposures[exposure];
    e->mean_dn = malloc(n * sizeof *e->mean_dn);
    if (!e->mean_dn)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    memcpy(e->mean_dn, mean_dn, n * sizeof *e->mean_dn);
    e->stats = (struct ls_dark_stats){.n_frames = n_frames,
                                      .mean_dn = mean_over(mean_dn, n),
                                      .zero_fraction = NAN,
                                      .clipped_fraction = NAN,
                                      .read_noise_dn = NAN};
    return find_defects(stage, exposure, mean_dn, NULL, diag);
}

enum ls_err ls_dark_stage_know(struct ls_dark_stage *stage, const struct ls_pixel_list *defects,
                               struct ls_diag *diag)
{
    enum ls_err err = ls_pixel_list_join(&stage->defects, defects);
    return err ? ls_fail(diag, err, "out of memory") : LS_OK;
}

enum ls_err ls_dark_stage_add(struct ls_dark_stage *stage, uint32_t exposure, const void *raw,
                              struct ls_diag *diag)
{
    struct ls_dark *sum = stage->exposures[exposure].sum;
    if (!sum)
        return ls_fail(diag, LS_ERR_BUG, "a dark frame came for a dark that is finished");
    pthread_mutex_lock(&stage->lock);
    enum ls_err err = ls_dark_add(sum, raw);
    pthread_mutex_unlock(&stage->lock);
    return err ? ls_fail(diag, err, "darks: %s", ls_err_name(err)) : LS_OK;
}

/* Statistics of the closed sum; the variance of few frames says nothing about single pixels. */
static enum ls_err examine(struct ls_dark_stage *stage, uint32_t exposure, const float *mean_dn,
                           float *variance_dn2, struct ls_diag *diag)
{
    const struct ls_dark *sum = stage->exposures[exposure].sum;
    struct ls_dark_stats *stats = &stage->exposures[exposure].stats;
    enum ls_err err = ls_dark_stats(sum, stats);
    if (!err && stage->black_check)
        err = ls_dark_check_black(stats, diag);
    bool enough = !err && stats->n_frames >= VARIANCE_FRAMES;
    if (enough)
        err = ls_dark_variance(sum, variance_dn2);
    if (err)
        return err;
    pthread_mutex_lock(&stage->lock);
    err = find_defects(stage, exposure, mean_dn, enough ? variance_dn2 : NULL, diag);
    pthread_mutex_unlock(&stage->lock);
    return err;
}

enum ls_err ls_dark_stage_close(struct ls_dark_stage *stage, uint32_t exposure,
                                struct ls_diag *diag)
{
    size_t n = (size_t)stage->width * stage->height;
    struct ls_dark_exposure *e = &stage->exposures[exposure];
    LS_CLEANUP_FREE float *mean = malloc(n * sizeof *mean);
    LS_CLEANUP_FREE float *variance = malloc(n * sizeof *variance);
    if (!mean || !variance)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    enum ls_err err = ls_dark_mean(e->sum, mean);
    if (!err)
        err = examine(stage, exposure, mean, variance, diag);
    if (err)
        return err;
    ls_dark_destroy(e->sum);
    e->sum = NULL;
    e->mean_dn = mean;
    mean = NULL;
    return LS_OK;
}

/* ---- watches ---- */

enum ls_err ls_dark_stage_watch(struct ls_dark_stage *stage, const void *raw, struct ls_diag *diag)
{
    enum ls_err err = LS_OK;
    pthread_mutex_lock(&stage->lock);
    if (!stage->watch)
        err = ls_dark_create(stage->format, stage->width, stage->height, &stage->watch, diag);
    if (!err)
        err = ls_dark_add(stage->watch, raw);
    pthread_mutex_unlock(&stage->lock);
    return err ? ls_fail(diag, err, "watch: %s", ls_err_name(err)) : LS_OK;
}

void ls_dark_stage_drop_watch(struct ls_dark_stage *stage)
{
    pthread_mutex_lock(&stage->lock);
    ls_dark_destroy(stage->watch);
    stage->watch = NULL;
    pthread_mutex_unlock(&stage->lock);
}

/* Squared standard error of a mean over all pixels. */
static double error2(double noise_dn, double n_frames, double n_px)
{
    return (noise_dn * noise_dn + 1.0 / 12) / (n_frames * n_px);
}

static struct ls_dark_drift compare(const struct ls_dark_stage *stage,
                                    const struct ls_dark_stats *dark,
                                    const struct ls_dark_stats *watch)
{
    double n_px = (double)stage->width * stage->height;
    double noise = isfinite(dark->read_noise_dn) ? dark->read_noise_dn : watch->read_noise_dn;
    double error = sqrt(error2(noise, dark->n_frames, n_px) +
                        error2(watch->read_noise_dn, watch->n_frames, n_px));
    return (struct ls_dark_drift){.difference_dn = watch->mean_dn - dark->mean_dn,
                                  .allowed_dn = fmax(LS_DARK_DRIFT_DN, DRIFT_SIGMAS * error)};
}

enum ls_err ls_dark_stage_close_watch(struct ls_dark_stage *stage, uint32_t exposure,
                                      float *mean_dn, struct ls_dark_drift *drift,
                                      struct ls_diag *diag)
{
    struct ls_dark_stats stats;
    enum ls_err err = ls_dark_mean(stage->watch, mean_dn);
    if (!err)
        err = ls_dark_stats(stage->watch, &stats);
    if (err)
        return ls_fail(diag, err, "watch: %s", ls_err_name(err));
    *drift = compare(stage, &stage->exposures[exposure].stats, &stats);
    ls_dark_stage_drop_watch(stage);
    return LS_OK;
}
