#include "daemon/relight_job.h"

#include "core/level.h"
#include "core/relight.h"
#include "daemon/crew.h"
#include "daemon/picture_region.h"
#include "daemon/reduction.h"
#include "daemon/render.h"
#include "proto/frame.h"
#include "proto/message.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

struct relight_job {
    struct ls_job job;
    struct ls_field_cache *cache;
    struct ls_field_source *source; /* from the first step on */
    struct ls_render *render;       /* likewise */
    char take[128];
    uint32_t camera;
    struct ls_promotion promotion;
    Lightstage__WeightMode mode;
    char names[LS_FIELD_MAX_SPECTRA][32];
    uint32_t n_names, n_pictures, n_lights;
    uint32_t n_rows; /* of one picture */
    float *weights;  /* [n_pictures][n_rows][n_lights] as sent */
    double max_error;
    struct ls_demosaic_region region; /* full-size pixels, whole ones of the level */
    uint32_t level;
    struct ls_level_rows *rows; /* [n_pictures], if level > 0 */
    struct ls_demosaic_region band;
    float *pixels; /* of the band, [n_pictures][height][width][3]; NULL: none is being sent */
    uint32_t next_picture; /* of the band */
    bool complete;         /* no band follows */
    double seconds;
};

static void relight_destroy(struct ls_job *job)
{
    struct relight_job *self = (struct relight_job *)job;
    ls_render_close(self->render);
    if (self->source)
        ls_field_cache_put(self->cache, self->source);
    for (uint32_t i = 0; i < self->n_pictures && self->rows; i++)
        ls_level_rows_finish(&self->rows[i]);
    free(self->rows);
    free(self->pixels);
    free(self->weights);
    g_free(self);
}

/* ---- start: which terms ---- */

static enum ls_err channel_of(const struct relight_job *self, const char *name, uint32_t *out,
                              struct ls_diag *diag)
{
    int channel = ls_take_facts_channel(self->source->facts, name);
    if (channel < 0)
        return ls_fail(diag, LS_ERR_NOT_FOUND, "take %s has no channel \"%s\"", self->take, name);
    *out = (uint32_t)channel;
    return LS_OK;
}

/* White for R, G, B each, over p(0,c) of the camera channel (mono: its one channel). */
static void tristimulus_term(const struct relight_job *self, uint32_t c, double *weights,
                             struct ls_render_term *term)
{
    *term = (struct ls_render_term){
        .channel = self->source->channel_of[0], .weights = weights, .target = (int32_t)c};
    ls_relight_tristimulus(&self->source->field, c, weights);
}

static enum ls_err spectral_term(const struct relight_job *self, uint32_t row,
                                 const double *weights, struct ls_render_term *term,
                                 struct ls_diag *diag)
{
    bool shared = self->mode == LIGHTSTAGE__WEIGHT_MODE__SHARED;
    *term = (struct ls_render_term){.weights = weights,
                                    .target = shared ? -1 : (int32_t)(row / self->n_names)};
    return channel_of(self, self->names[row % self->n_names], &term->channel, diag);
}

static enum ls_err list_terms(const struct relight_job *self, double *weights,
                              struct ls_render_term *terms, struct ls_diag *diag)
{
    enum ls_err err = LS_OK;
    for (uint32_t n = 0; n < self->n_pictures * self->n_rows && !err; n++) {
        double *row = weights + (size_t)n * self->n_lights;
        for (uint32_t i = 0; i < self->n_lights; i++)
            row[i] = (double)self->weights[(size_t)n * self->n_lights + i];
        if (self->mode == LIGHTSTAGE__WEIGHT_MODE__TRISTIMULUS)
            tristimulus_term(self, n % self->n_rows, row, &terms[n]);
        else
            err = spectral_term(self, n % self->n_rows, row, &terms[n], diag);
        terms[n].picture = n / self->n_rows;
    }
    return err;
}

static enum ls_err open_render(struct relight_job *self, struct ls_diag *diag)
{
    size_t n = (size_t)self->n_pictures * self->n_rows;
    LS_CLEANUP_FREE struct ls_render_term *terms = calloc(n, sizeof *terms);
    LS_CLEANUP_FREE double *weights = malloc(n * self->n_lights * sizeof *weights);
    if (!terms || !weights)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    enum ls_err err = list_terms(self, weights, terms, diag);
    const struct ls_render_job job = {.promotion = self->promotion,
                                      .terms = terms,
                                      .n_terms = (uint32_t)n,
                                      .n_pictures = self->n_pictures,
                                      .region = self->region,
                                      .max_error = self->max_error,
                                      .n_threads = ls_crew_threads(),
                                      .asker = &self->job};
    return err ? err : ls_render_open(self->source, &job, &self->render, diag);
}

static enum ls_err begin_level(struct relight_job *self, struct ls_diag *diag)
{
    enum ls_err err = LS_OK;
    if (self->level == 0 || self->rows)
        return LS_OK;
    self->region = ls_level_needs(ls_level_region(self->region, self->level), self->level,
                                  self->source->width, self->source->height);
    self->rows = calloc(self->n_pictures, sizeof *self->rows);
    if (!self->rows)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    for (uint32_t i = 0; i < self->n_pictures && !err; i++)
        err = ls_level_rows_init(&self->rows[i], self->level, &self->region, 3, diag);
    return err;
}

static enum ls_err start(struct relight_job *self, struct ls_diag *diag)
{
    enum ls_err err = self->source ? LS_OK /* it waited for maps */
                                   : ls_field_cache_get(self->cache, self->take, self->camera,
                                                        &self->source, diag);
    if (err)
        return err;
    if (self->n_lights != self->source->field.n_lights)
        return ls_fail(diag, LS_ERR_LIMIT, "weights for %u lights, the take has %u", self->n_lights,
                       self->source->field.n_lights);
    err = ls_picture_region_check(&self->region, self->source->width, self->source->height, diag);
    if (!err)
        err = begin_level(self, diag);
    return err ? err : open_render(self, diag);
}

/* ---- bands ---- */

/* The band that was rendered becomes its level's, in the level's pixels; perhaps of no row. */
static enum ls_err reduce_band(struct relight_job *self, struct ls_diag *diag)
{
    struct ls_demosaic_region from = self->band, to = ls_level_region(from, self->level);
    size_t in = 3 * (size_t)from.width * from.height, room = 3 * (size_t)to.width * to.height;
    float *out = malloc(room * self->n_pictures * sizeof *out), *next = out;
    if (!out)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for a band of a picture");
    for (uint32_t i = 0; i < self->n_pictures; i++, next += 3 * (size_t)to.width * to.height)
        to.height = ls_level_rows_add(&self->rows[i], self->pixels + in * i, from.height, next);
    free(self->pixels);
    self->pixels = out;
    self->band = to;
    return LS_OK;
}

static void describe(const struct relight_job *self, Lightstage__RelightReply *body)
{
    lightstage__relight_reply__init(body);
    struct ls_demosaic_region sent = ls_level_region(self->region, self->level);
    body->width = sent.width;
    body->height = sent.height;
    body->level = self->level;
    body->calibrated = self->source->calibrated;
}

/* The next picture's part of the band: the last takes what is left of it. */
static enum ls_err take_part(struct relight_job *self, struct ls_chunk *chunk, struct ls_diag *diag)
{
    size_t bytes = (size_t)self->band.width * self->band.height * 3 * sizeof(float);
    uint8_t *all = (uint8_t *)self->pixels, *part = all;
    if (self->n_pictures > 1)
        part = malloc(bytes);
    if (!part)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for a band of a picture");
    if (part != all)
        memcpy(part, all + bytes * self->next_picture, bytes);
    if (++self->next_picture == self->n_pictures) {
        free(part == all ? NULL : all);
        self->pixels = NULL;
    }
    chunk->payload = part;
    chunk->payload_bytes = bytes;
    return LS_OK;
}

static enum ls_err send_band(struct relight_job *self, struct ls_chunk *chunk, struct ls_diag *diag)
{
    Lightstage__RelightReply body;
    enum ls_err err = LS_OK;
    if (!self->pixels) {
        self->next_picture = 0;
        err = ls_render_step(self->render, &self->band, &self->pixels, &self->complete, diag);
        if (!err && self->level > 0)
            err = reduce_band(self, diag);
    }
    if (err)
        return err;
    if (self->band.height == 0) { /* the next one completes its row */
        free(self->pixels);
        self->pixels = NULL;
        return LS_OK;
    }
    describe(self, &body);
    body.first_row = self->band.y - (self->region.y >> self->level);
    body.n_rows = self->band.height;
    body.picture = self->next_picture;
    err = take_part(self, chunk, diag);
    return err ? err
               : ls_message_frame(LS_MESSAGE_RELIGHT | LS_MESSAGE_REPLY, self->job.request, 0,
                                  &body.base, chunk->payload_bytes, &chunk->head,
                                  &chunk->head_bytes, diag);
}

static enum ls_err send_report(struct relight_job *self, struct ls_chunk *chunk,
                               struct ls_diag *diag)
{
    Lightstage__RelightReply body;
    Lightstage__SpectrumReport *spectra[LS_MAX_CHANNELS];
    struct ls_render_report report;
    ls_render_report(self->render, &report);
    for (uint32_t i = 0; i < report.n_spectra; i++)
        spectra[i] = &report.spectra[i];
    describe(self, &body);
    body.first_row = body.height;
    body.lights_used = report.lights_used;
    body.lights_skipped = self->n_lights - report.lights_used;
    body.tiles_skipped = report.tiles_skipped;
    body.error_bound = report.error_bound;
    body.seconds = self->seconds;
    body.n_spectra = report.n_spectra;
    body.spectra = spectra;
    return ls_message_frame(LS_MESSAGE_RELIGHT | LS_MESSAGE_REPLY, self->job.request, LS_FRAME_LAST,
                            &body.base, 0, &chunk->head, &chunk->head_bytes, diag);
}

static enum ls_err next_frame(struct relight_job *self, struct ls_chunk *chunk, bool *last,
                              struct ls_diag *diag)
{
    if (!self->complete || self->pixels)
        return send_band(self, chunk, diag);
    *last = true;
    return send_report(self, chunk, diag);
}

static enum ls_err relight_step(struct ls_job *job, struct ls_chunk *chunk, bool *last,
                                struct ls_diag *diag)
{
    struct relight_job *self = (struct relight_job *)job;
    int64_t began = g_get_monotonic_time();
    enum ls_err err = self->render ? next_frame(self, chunk, last, diag) : start(self, diag);
    if (!err)
        err = ls_field_source_sound(self->source, *last, diag);
    self->seconds += (double)(g_get_monotonic_time() - began) * 1e-6;
    return err;
}

/* ---- making ---- */

static size_t pictures_of(const Lightstage__Relight *relight)
{
    return relight->n_pictures ? relight->n_pictures : 1;
}

static enum ls_err check(const Lightstage__Relight *relight, uint32_t n_rows, size_t payload_bytes,
                         struct ls_diag *diag)
{
    size_t n_pictures = pictures_of(relight);
    bool tristimulus = relight->mode == LIGHTSTAGE__WEIGHT_MODE__TRISTIMULUS;
    enum ls_err err = ls_reduction_check_level(relight->level, diag);
    if (err)
        return err;
    if (relight->mode > LIGHTSTAGE__WEIGHT_MODE__PER_TARGET)
        return ls_fail(diag, LS_ERR_UNSUPPORTED, "relight: weight mode %d is not known",
                       (int)relight->mode);
    if (relight->n_channels > LS_FIELD_MAX_SPECTRA || tristimulus != (relight->n_channels == 0))
        return ls_fail(diag, LS_ERR_INVALID,
                       "relight: %zu channels: expected 1 to %d, or none for tristimulus weights",
                       relight->n_channels, LS_FIELD_MAX_SPECTRA);
    if (relight->n_lights < 1 || relight->n_lights > LS_MAX_LIGHTS)
        return ls_fail(diag, LS_ERR_INVALID, "relight: %u lights: expected 1 to %d",
                       relight->n_lights, LS_MAX_LIGHTS);
    if (n_pictures * n_rows > LS_RENDER_MAX_TERMS)
        return ls_fail(diag, LS_ERR_LIMIT,
                       "relight: %zu pictures of %u rows of weights: expected at most %d rows in "
                       "all; ask for fewer pictures at once",
                       n_pictures, n_rows, LS_RENDER_MAX_TERMS);
    if (payload_bytes != n_pictures * n_rows * relight->n_lights * sizeof(float))
        return ls_fail(
            diag, LS_ERR_INVALID,
            "relight: a payload of %zu bytes, expected %zu rows of %u weights of 4 bytes",
            payload_bytes, n_pictures * n_rows, relight->n_lights);
    if (!(relight->max_error >= 0) || !isfinite(relight->max_error))
        return ls_fail(diag, LS_ERR_INVALID, "relight: max_error: expected 0 or more");
    for (size_t i = 0; i < relight->n_channels; i++)
        if (strlen(relight->channels[i]) < 1 || strlen(relight->channels[i]) > 31)
            return ls_fail(diag, LS_ERR_INVALID, "relight: channel %zu: expected a name", i);
    return LS_OK;
}

static enum ls_err check_finite(const struct relight_job *self, struct ls_diag *diag)
{
    for (size_t i = 0; i < (size_t)self->n_pictures * self->n_rows * self->n_lights; i++)
        if (!isfinite(self->weights[i]))
            return ls_fail(diag, LS_ERR_INVALID, "relight: the weight of row %zu, light %zu is %g",
                           i / self->n_lights, i % self->n_lights, (double)self->weights[i]);
    return LS_OK;
}

static uint32_t rows_of(const Lightstage__Relight *relight)
{
    uint32_t n = (uint32_t)relight->n_channels;
    if (relight->mode == LIGHTSTAGE__WEIGHT_MODE__TRISTIMULUS)
        return 3;
    return relight->mode == LIGHTSTAGE__WEIGHT_MODE__PER_TARGET ? 3 * n : n;
}

enum ls_err ls_relight_job_create(uint32_t request, struct ls_field_cache *cache,
                                  const Lightstage__Relight *relight, const uint8_t *payload,
                                  size_t payload_bytes, struct ls_job **out, struct ls_diag *diag)
{
    static const struct ls_job_ops ops = {"relight", relight_step, relight_destroy};
    uint32_t n_rows = rows_of(relight);
    enum ls_err err = check(relight, n_rows, payload_bytes, diag);
    if (err)
        return err;
    struct ls_promotion promotion;
    err = ls_promotion_read(relight->promotion, LIGHTSTAGE__MODEL__SPHERE, &promotion, diag);
    if (err)
        return err;
    struct relight_job *self = g_new0(struct relight_job, 1);
    self->promotion = promotion;
    self->job = (struct ls_job){.ops = &ops, .request = request};
    self->cache = cache;
    snprintf(self->take, sizeof self->take, "%s", relight->take);
    self->job.take = self->take;
    self->camera = relight->camera;
    self->mode = relight->mode;
    self->n_names = (uint32_t)relight->n_channels;
    for (uint32_t i = 0; i < self->n_names; i++)
        snprintf(self->names[i], sizeof self->names[i], "%s", relight->channels[i]);
    self->n_pictures = (uint32_t)pictures_of(relight);
    self->n_rows = n_rows;
    self->n_lights = relight->n_lights;
    self->max_error = relight->max_error;
    self->level = relight->level;
    self->region = ls_picture_region_of(relight->region);
    self->weights = g_memdup2(payload, payload_bytes);
    err = check_finite(self, diag);
    if (err)
        relight_destroy(&self->job);
    else
        *out = &self->job;
    return err;
}
