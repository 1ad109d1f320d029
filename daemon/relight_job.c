#include "daemon/relight_job.h"

#include "core/relight.h"
#include "daemon/picture_region.h"
#include "proto/frame.h"
#include "proto/message.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { MAX_SUMS = 3 * LS_FIELD_MAX_SPECTRA };

/* One weighted sum of the white field, and what becomes of it. */
struct sum {
    uint32_t spectrum;
    int32_t channel;    /* as ls_relight_term */
    uint32_t weights;   /* row of the request's weights */
    const float *ratio; /* whole picture; NULL = white */
};

struct relight_job {
    struct ls_job job;
    struct ls_field_cache *cache;
    struct ls_field_source *source; /* from the first step on */
    char take[128];
    uint32_t camera;
    Lightstage__WeightMode mode;
    char names[LS_FIELD_MAX_SPECTRA][32];
    uint32_t n_names, n_rows, n_lights;
    float *weights; /* [n_rows][n_lights] as sent */
    double max_error;
    struct ls_demosaic_region region;

    struct sum sums[MAX_SUMS];
    uint32_t n_sums;
    float *rows; /* [n_sums][n_lights], for ls_accumulate */
    uint32_t lights_used;

    uint32_t tile_row;                /* next to accumulate */
    uint32_t out_y;                   /* next row to send, in the picture */
    float *mosaics;                   /* [n_sums][window.height][window.width] */
    struct ls_demosaic_region window; /* what they hold */
    struct ls_accumulate_report report;
    double seconds;
};

static void relight_destroy(struct ls_job *job)
{
    struct relight_job *self = (struct relight_job *)job;
    if (self->source)
        ls_field_cache_put(self->cache, self->source);
    free(self->weights);
    free(self->rows);
    free(self->mosaics);
    g_free(self);
}

/* ---- start: which sums ---- */

static bool row_is_zero(const struct relight_job *self, uint32_t row)
{
    const float *w = self->weights + (size_t)row * self->n_lights;
    for (uint32_t i = 0; i < self->n_lights; i++)
        if (w[i] != 0)
            return false;
    return true;
}

static enum ls_err spectrum_of(const struct relight_job *self, const char *name, uint32_t *out,
                               struct ls_diag *diag)
{
    const struct ls_field_source *source = self->source;
    int channel = ls_take_facts_channel(source->facts, name);
    if (channel < 0)
        return ls_fail(diag, LS_ERR_NOT_FOUND, "take %s has no channel \"%s\"", self->take, name);
    int s = ls_field_source_spectrum(source, (uint32_t)channel);
    if (s < 0)
        return ls_fail(diag, LS_ERR_STATE,
                       "take %s has no full sphere of channel %s: it cannot be promoted",
                       self->take, name);
    *out = (uint32_t)s;
    return LS_OK;
}

static enum ls_err add_sum(struct relight_job *self, uint32_t spectrum, int32_t channel,
                           uint32_t row, struct ls_diag *diag)
{
    struct sum sum = {.spectrum = spectrum, .channel = channel, .weights = row};
    if (row_is_zero(self, row))
        return LS_OK;
    enum ls_err err =
        spectrum == 0 ? LS_OK : ls_field_source_ratio(self->source, spectrum, &sum.ratio, diag);
    if (!err)
        self->sums[self->n_sums++] = sum;
    return err;
}

static enum ls_err choose_sums(struct relight_job *self, struct ls_diag *diag)
{
    enum ls_err err = LS_OK;
    if (self->mode == LIGHTSTAGE__WEIGHT_MODE__TRISTIMULUS) {
        for (uint32_t c = 0; c < 3 && !err; c++)
            err = add_sum(self, 0, (int32_t)c, c, diag);
        return err;
    }
    bool shared = self->mode == LIGHTSTAGE__WEIGHT_MODE__SHARED;
    for (uint32_t n = 0; n < self->n_names && !err; n++) {
        uint32_t s = 0;
        err = spectrum_of(self, self->names[n], &s, diag);
        if (!err && shared)
            err = add_sum(self, s, -1, n, diag);
        for (uint32_t c = 0; c < 3 && !shared && !err; c++)
            err = add_sum(self, s, (int32_t)c, c * self->n_names + n, diag);
    }
    return err;
}

static void fill_row(struct relight_job *self, uint32_t q, double *w)
{
    const struct ls_field *field = &self->source->field;
    const struct sum *sum = &self->sums[q];
    float *row = self->rows + (size_t)q * self->n_lights;
    for (uint32_t i = 0; i < self->n_lights; i++)
        w[i] = (double)self->weights[(size_t)sum->weights * self->n_lights + i];
    if (self->mode == LIGHTSTAGE__WEIGHT_MODE__TRISTIMULUS)
        ls_relight_tristimulus_row(field, w, 1, field->n_channels == 1 ? 0 : (uint32_t)sum->channel,
                                   row);
    else
        ls_relight_row(field, w, 1, row);
}

static enum ls_err check_lights(struct relight_job *self, struct ls_diag *diag)
{
    uint32_t missing = 0, first = 0;
    for (uint32_t i = 0; i < self->n_lights; i++) {
        bool used = false;
        for (uint32_t q = 0; q < self->n_sums; q++)
            used |= self->rows[(size_t)q * self->n_lights + i] != 0;
        self->lights_used += used;
        if (used && self->source->white[i].tiles == self->source->no_tiles && missing++ == 0)
            first = i;
    }
    if (missing > 0)
        return ls_fail(diag, LS_ERR_STATE,
                       "take %s lacks the pictures of %u lights that this light needs (light %u is "
                       "the first); resume the take",
                       self->take, missing, first);
    return LS_OK;
}

static enum ls_err fill_rows(struct relight_job *self, struct ls_diag *diag)
{
    double *w = malloc(self->n_lights * sizeof *w);
    self->rows = calloc((size_t)(self->n_sums ? self->n_sums : 1) * self->n_lights, sizeof(float));
    if (!w || !self->rows) {
        free(w);
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    }
    for (uint32_t q = 0; q < self->n_sums; q++)
        fill_row(self, q, w);
    free(w);
    return check_lights(self, diag);
}

static struct ls_tile_region columns(const struct relight_job *self)
{
    const struct ls_demosaic_region *r = &self->region;
    return ls_region_of_pixels(&self->source->field, r->x, r->y, r->x + r->width, r->y + r->height,
                               LS_DEMOSAIC_HALO);
}

static enum ls_err start(struct relight_job *self, struct ls_diag *diag)
{
    enum ls_err err =
        ls_field_cache_get(self->cache, self->take, self->camera, &self->source, diag);
    if (err)
        return err;
    if (self->n_lights != self->source->field.n_lights)
        return ls_fail(diag, LS_ERR_LIMIT, "weights for %u lights, the take has %u", self->n_lights,
                       self->source->field.n_lights);
    err = ls_picture_region_check(&self->region, self->source->width, self->source->height, diag);
    if (!err)
        err = choose_sums(self, diag);
    if (!err)
        err = fill_rows(self, diag);
    if (err)
        return err;
    struct ls_tile_region tiles = columns(self);
    self->out_y = self->region.y;
    self->tile_row = tiles.y0;
    self->window.x = tiles.x0 * LS_TILE_SIDE;
    self->window.width = ls_region_width_px(&self->source->field, &tiles);
    self->window.y = tiles.y0 * LS_TILE_SIDE;
    return LS_OK;
}

/* ---- bands ---- */

/*
 * What an error of one sum can become in the picture, before promotion: the gradient filter's
 * coefficients add to 20/8 in magnitude (core/demosaic.c), and several sums meet in one channel.
 */
static double amplification(const struct relight_job *self)
{
    double filter = self->source->field.n_channels > 1 ? 2.5 : 1;
    switch (self->mode) {
    case LIGHTSTAGE__WEIGHT_MODE__TRISTIMULUS:
        return filter;
    case LIGHTSTAGE__WEIGHT_MODE__PER_TARGET:
        return filter * self->n_sums / 3;
    default:
        return filter * self->n_sums;
    }
}

static void add_report(struct relight_job *self, const struct ls_accumulate_report *report)
{
    if (report->bound > self->report.bound)
        self->report.bound = report->bound;
    self->report.tiles_read += report->tiles_read;
    self->report.tiles_skipped += report->tiles_skipped;
    self->report.not_finite += report->not_finite;
}

static enum ls_err accumulate(struct relight_job *self, const struct ls_tile_region *tiles,
                              float *fresh, struct ls_diag *diag)
{
    const struct ls_field *field = &self->source->field;
    struct ls_accumulate_report report = {0};
    struct ls_accumulate_job job = {.pictures = field->white,
                                    .n_pictures = field->n_lights,
                                    .n_sums = self->n_sums,
                                    .weights = self->rows};
    if (self->max_error > 0) {
        job.tile_max = self->source->tile_max;
        job.max_error = self->max_error / (field->scale * amplification(self));
    }
    enum ls_err err = ls_accumulate(field, &job, tiles, fresh, &report, diag);
    add_report(self, &report);
    return err;
}

/* New mosaics: the rows of the old window from @keep_y on, then the fresh tile row. */
static enum ls_err append(struct relight_job *self, const float *fresh, uint32_t rows,
                          uint32_t keep_y, struct ls_diag *diag)
{
    size_t width = self->window.width, old_rows = self->window.height;
    size_t kept = self->window.y + old_rows - keep_y, skip = old_rows - kept;
    float *grown = malloc(self->n_sums * (kept + rows) * width * sizeof(float));
    if (!grown)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    for (uint32_t q = 0; q < self->n_sums; q++) {
        float *to = grown + q * (kept + rows) * width;
        if (kept > 0)
            memcpy(to, self->mosaics + (q * old_rows + skip) * width, kept * width * sizeof(float));
        memcpy(to + kept * width, fresh + q * rows * width, rows * width * sizeof(float));
    }
    free(self->mosaics);
    self->mosaics = grown;
    self->window.y = keep_y;
    self->window.height = (uint32_t)kept + rows;
    return LS_OK;
}

static enum ls_err read_tile_row(struct relight_job *self, struct ls_diag *diag)
{
    const struct ls_field *field = &self->source->field;
    struct ls_tile_region tiles = columns(self);
    tiles.y0 = self->tile_row;
    tiles.y1 = self->tile_row + 1;
    uint32_t rows = ls_region_height_px(field, &tiles);
    uint32_t need = self->out_y > LS_DEMOSAIC_HALO ? self->out_y - LS_DEMOSAIC_HALO : 0;
    uint32_t end = self->window.y + self->window.height;
    self->tile_row++;
    if (self->n_sums == 0)
        return LS_OK;
    float *fresh = malloc((size_t)self->n_sums * rows * self->window.width * sizeof(float));
    if (!fresh)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    enum ls_err err = accumulate(self, &tiles, fresh, diag);
    if (!err)
        err = append(self, fresh, rows,
                     need < self->window.y ? self->window.y
                     : need < end          ? need
                                           : end,
                     diag);
    free(fresh);
    return err;
}

/* Rows of a whole-picture ratio for a band, contiguous. */
static void cut_ratio(const struct relight_job *self, const float *ratio,
                      struct ls_demosaic_region band, float *out)
{
    size_t colours = self->source->field.n_channels, row = band.width * colours;
    for (uint32_t y = 0; y < band.height; y++)
        memcpy(out + y * row,
               ratio + ((size_t)(band.y + y) * self->source->width + band.x) * colours,
               row * sizeof(float));
}

static enum ls_err finish_band(const struct relight_job *self, struct ls_demosaic_region band,
                               float *ratios, float *out, struct ls_diag *diag)
{
    const struct ls_field *field = &self->source->field;
    struct ls_relight_term terms[MAX_SUMS];
    size_t window = (size_t)self->window.width * self->window.height;
    size_t pixels = (size_t)band.width * band.height * field->n_channels;
    for (uint32_t q = 0; q < self->n_sums; q++) {
        float *ratio = self->sums[q].ratio ? ratios + q * pixels : NULL;
        if (ratio)
            cut_ratio(self, self->sums[q].ratio, band, ratio);
        terms[q] = (struct ls_relight_term){
            .sum = self->mosaics + q * window, .ratio = ratio, .channel = self->sums[q].channel};
    }
    return ls_relight_finish(field, self->window, band, terms, self->n_sums, NULL, out, diag);
}

static enum ls_err make_band(const struct relight_job *self, struct ls_demosaic_region band,
                             struct ls_chunk *chunk, struct ls_diag *diag)
{
    size_t pixels = (size_t)band.width * band.height;
    enum ls_err err = LS_OK;
    chunk->payload_bytes = pixels * 3 * sizeof(float);
    chunk->payload = calloc(1, chunk->payload_bytes);
    float *ratios =
        malloc((self->n_sums + 1) * pixels * self->source->field.n_channels * sizeof(float));
    if (!chunk->payload || !ratios)
        err = ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    else if (self->n_sums > 0)
        err = finish_band(self, band, ratios, (float *)chunk->payload, diag);
    free(ratios);
    return err;
}

static enum ls_err send_band(struct relight_job *self, uint32_t end_y, struct ls_chunk *chunk,
                             struct ls_diag *diag)
{
    Lightstage__RelightReply body = LIGHTSTAGE__RELIGHT_REPLY__INIT;
    struct ls_demosaic_region band = {self->region.x, self->out_y, self->region.width,
                                      end_y - self->out_y};
    enum ls_err err = make_band(self, band, chunk, diag);
    if (err)
        return err;
    body.width = self->region.width;
    body.height = self->region.height;
    body.first_row = band.y - self->region.y;
    body.n_rows = band.height;
    body.calibrated = self->source->calibrated;
    self->out_y = end_y;
    return ls_message_frame(LS_MESSAGE_RELIGHT | LS_MESSAGE_REPLY, self->job.request, 0, &body.base,
                            chunk->payload_bytes, &chunk->head, &chunk->head_bytes, diag);
}

static enum ls_err send_report(struct relight_job *self, struct ls_chunk *chunk,
                               struct ls_diag *diag)
{
    Lightstage__RelightReply body = LIGHTSTAGE__RELIGHT_REPLY__INIT;
    body.width = self->region.width;
    body.height = self->region.height;
    body.first_row = self->region.height;
    body.lights_used = self->lights_used;
    body.lights_skipped = self->n_lights - self->lights_used;
    body.tiles_skipped = self->report.tiles_skipped;
    body.error_bound = self->report.bound * self->source->field.scale * amplification(self);
    body.seconds = self->seconds;
    body.calibrated = self->source->calibrated;
    return ls_message_frame(LS_MESSAGE_RELIGHT | LS_MESSAGE_REPLY, self->job.request, LS_FRAME_LAST,
                            &body.base, 0, &chunk->head, &chunk->head_bytes, diag);
}

static enum ls_err next_frame(struct relight_job *self, struct ls_chunk *chunk, bool *last,
                              struct ls_diag *diag)
{
    uint32_t end = self->region.y + self->region.height, height = self->source->height;
    enum ls_err err = LS_OK;
    if (self->out_y == end) {
        *last = true;
        return send_report(self, chunk, diag);
    }
    uint32_t have = self->tile_row * LS_TILE_SIDE, need = end + LS_DEMOSAIC_HALO;
    if (have < (need < height ? need : height))
        err = read_tile_row(self, diag);
    have = self->tile_row * LS_TILE_SIDE;
    uint32_t ready = have >= height ? height : have - LS_DEMOSAIC_HALO;
    ready = ready < end ? ready : end;
    return err || ready <= self->out_y ? err : send_band(self, ready, chunk, diag);
}

static enum ls_err relight_step(struct ls_job *job, struct ls_chunk *chunk, bool *last,
                                struct ls_diag *diag)
{
    struct relight_job *self = (struct relight_job *)job;
    int64_t began = g_get_monotonic_time();
    enum ls_err err = self->source ? next_frame(self, chunk, last, diag) : start(self, diag);
    if (!err)
        err = ls_field_source_sound(self->source, *last, diag);
    self->seconds += (double)(g_get_monotonic_time() - began) * 1e-6;
    return err;
}

/* ---- making ---- */

static enum ls_err check(const Lightstage__Relight *relight, uint32_t n_rows, size_t payload_bytes,
                         struct ls_diag *diag)
{
    bool tristimulus = relight->mode == LIGHTSTAGE__WEIGHT_MODE__TRISTIMULUS;
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
    if (payload_bytes != (size_t)n_rows * relight->n_lights * sizeof(float))
        return ls_fail(diag, LS_ERR_INVALID,
                       "relight: a payload of %zu bytes, expected %u rows of %u weights of 4 bytes",
                       payload_bytes, n_rows, relight->n_lights);
    if (!(relight->max_error >= 0) || !isfinite(relight->max_error))
        return ls_fail(diag, LS_ERR_INVALID, "relight: max_error: expected 0 or more");
    for (size_t i = 0; i < relight->n_channels; i++)
        if (strlen(relight->channels[i]) < 1 || strlen(relight->channels[i]) > 31)
            return ls_fail(diag, LS_ERR_INVALID, "relight: channel %zu: expected a name", i);
    return LS_OK;
}

static enum ls_err check_finite(const struct relight_job *self, struct ls_diag *diag)
{
    for (size_t i = 0; i < (size_t)self->n_rows * self->n_lights; i++)
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
    struct relight_job *self = g_new0(struct relight_job, 1);
    self->job = (struct ls_job){.ops = &ops, .request = request};
    self->cache = cache;
    snprintf(self->take, sizeof self->take, "%s", relight->take);
    self->camera = relight->camera;
    self->mode = relight->mode;
    self->n_names = (uint32_t)relight->n_channels;
    for (uint32_t i = 0; i < self->n_names; i++)
        snprintf(self->names[i], sizeof self->names[i], "%s", relight->channels[i]);
    self->n_rows = n_rows;
    self->n_lights = relight->n_lights;
    self->max_error = relight->max_error;
    self->region = ls_picture_region_of(relight->region);
    self->weights = g_memdup2(payload, payload_bytes);
    err = check_finite(self, diag);
    if (err)
        relight_destroy(&self->job);
    else
        *out = &self->job;
    return err;
}
