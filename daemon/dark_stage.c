#include "daemon/dark_stage.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

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
    }
    ls_pixel_list_finish(&stage->defects);
    pthread_mutex_destroy(&stage->lock);
}

enum ls_err ls_dark_stage_expect(struct ls_dark_stage *stage, uint32_t exposure,
                                 struct ls_diag *diag)
{
    return ls_dark_create(stage->format, stage->width, stage->height,
                          &stage->exposures[exposure].sum, diag);
}

static enum ls_err find_defects(struct ls_dark_stage *stage, const struct ls_dark *dark,
                                struct ls_diag *diag)
{
    struct ls_pixel_list hot = {0};
    enum ls_err err = ls_dark_hot_pixels(dark, &hot);
    if (!err)
        err = ls_pixel_list_join(&stage->defects, &hot);
    ls_pixel_list_finish(&hot);
    return err ? ls_fail(diag, err, "darks: %s while looking for hot pixels", ls_err_name(err))
               : LS_OK;
}

/* The mean as one 16-bit frame, scaled to use the bits a narrower format leaves. */
static enum ls_err search_mean(struct ls_dark_stage *stage, const float *mean_dn,
                               struct ls_diag *diag)
{
    size_t n = (size_t)stage->width * stage->height;
    struct ls_pixel_format wide = *stage->format;
    wide.bits = wide.bits_per_pixel = 16;
    wide.packing = LS_PACKING_16;
    double scale = 65535.0 / ls_pixel_max_dn(stage->format);
    LS_CLEANUP_FREE uint16_t *frame = malloc(n * sizeof *frame);
    struct ls_dark *dark = NULL;
    if (!frame)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    for (size_t i = 0; i < n; i++)
        frame[i] = (uint16_t)fmin(65535, fmax(0, round((double)mean_dn[i] * scale)));
    enum ls_err err = ls_dark_create(&wide, stage->width, stage->height, &dark, diag);
    if (!err)
        err = ls_dark_add(dark, frame);
    if (!err)
        err = find_defects(stage, dark, diag);
    ls_dark_destroy(dark);
    return err;
}

enum ls_err ls_dark_stage_adopt(struct ls_dark_stage *stage, uint32_t exposure,
                                const float *mean_dn, struct ls_diag *diag)
{
    size_t n = (size_t)stage->width * stage->height;
    struct ls_dark_exposure *e = &stage->exposures[exposure];
    e->mean_dn = malloc(n * sizeof *e->mean_dn);
    if (!e->mean_dn)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    memcpy(e->mean_dn, mean_dn, n * sizeof *e->mean_dn);
    return search_mean(stage, mean_dn, diag);
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

static enum ls_err check(const struct ls_dark_stage *stage, const struct ls_dark *dark,
                         struct ls_diag *diag)
{
    struct ls_dark_stats stats;
    if (!stage->black_check)
        return LS_OK;
    enum ls_err err = ls_dark_stats(dark, &stats);
    return err ? ls_fail(diag, err, "darks: %s", ls_err_name(err))
               : ls_dark_check_black(&stats, diag);
}

enum ls_err ls_dark_stage_close(struct ls_dark_stage *stage, uint32_t exposure,
                                struct ls_diag *diag)
{
    size_t n = (size_t)stage->width * stage->height;
    struct ls_dark_exposure *e = &stage->exposures[exposure];
    LS_CLEANUP_FREE float *mean = malloc(n * sizeof *mean);
    if (!mean)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    enum ls_err err = check(stage, e->sum, diag);
    if (!err)
        err = ls_dark_mean(e->sum, mean);
    pthread_mutex_lock(&stage->lock);
    if (!err)
        err = find_defects(stage, e->sum, diag);
    pthread_mutex_unlock(&stage->lock);
    if (err)
        return err;
    ls_dark_destroy(e->sum);
    e->sum = NULL;
    e->mean_dn = mean;
    mean = NULL;
    return LS_OK;
}
