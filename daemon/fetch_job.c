#include "daemon/fetch_job.h"

#include "core/half.h"
#include "core/promote.h"
#include "core/relight.h"
#include "daemon/picture_region.h"
#include "proto/frame.h"
#include "proto/message.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { BAND_ROWS = 64 };

struct fetch_job {
    struct ls_job job;
    struct ls_field_cache *cache;
    struct ls_field_source *source; /* from the first step on */
    char take[128], channel_name[32];
    uint32_t camera;
    bool full_sphere, rgb, promoted, estimate, half;
    struct ls_demosaic_region region;
    uint32_t *lights;       /* NULL = all, until the first step */
    size_t n_lights, light; /* current index */
    uint32_t row;           /* next, in the region */
    uint32_t channel;
    const float *ratio; /* whole picture, or NULL */
};

static void fetch_destroy(struct ls_job *job)
{
    struct fetch_job *self = (struct fetch_job *)job;
    if (self->source)
        ls_field_cache_put(self->cache, self->source);
    free(self->lights);
    g_free(self);
}

/* ---- start ---- */

/* Was the picture asked for at all? @light < 0: of any light. */
static bool is_planned(const struct ls_take_facts *facts, uint32_t channel, int64_t light)
{
    for (uint32_t i = 0; i < facts->n_conditions; i++) {
        const struct ls_condition_fact *f = &facts->conditions[i];
        if (f->kind == LS_FACT_ONE && f->channel == channel && (light < 0 || f->light == light))
            return true;
    }
    return false;
}

static enum ls_err not_planned(const struct fetch_job *self, const char *what, uint32_t channel,
                               struct ls_diag *diag)
{
    const struct ls_field_source *source = self->source;
    int s = ls_field_source_spectrum(source, channel);
    bool promotable = s > 0 && !ls_field_source_promotable(source, (uint32_t)s, NULL);
    return ls_fail(diag, LS_ERR_NOT_FOUND,
                   "the plan of take %s has no picture of %s under %s%s", self->take, what,
                   source->facts->channels[channel].name,
                   promotable ? "; model sphere makes it from white and the full sphere" : "");
}

static enum ls_err choose_lights(struct fetch_job *self, struct ls_diag *diag)
{
    const struct ls_take_facts *facts = self->source->facts;
    uint32_t from = self->ratio ? self->source->channel_of[0] : self->channel;
    if (self->full_sphere) {
        free(self->lights);
        self->lights = calloc(1, sizeof *self->lights);
        self->n_lights = 1;
        return self->lights ? LS_OK : ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    }
    if (self->lights)
        return LS_OK;
    self->lights = calloc(facts->n_lights, sizeof *self->lights);
    if (!self->lights)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    for (uint32_t i = 0; i < facts->n_lights; i++)
        if (ls_field_source_picture(self->source, from, i, NULL))
            self->lights[self->n_lights++] = i;
    if (self->n_lights == 0 && !is_planned(facts, from, -1))
        return not_planned(self, "a single light", from, diag);
    if (self->n_lights == 0)
        return ls_fail(diag, LS_ERR_STATE, "take %s has no picture of a single light under %s",
                       self->take, self->channel_name);
    return LS_OK;
}

static enum ls_err choose_ratio(struct fetch_job *self, struct ls_diag *diag)
{
    int s = ls_field_source_spectrum(self->source, self->channel);
    if (!self->promoted || s == 0)
        return LS_OK;
    if (s < 0)
        return ls_fail(diag, LS_ERR_STATE,
                       "take %s has no full sphere of channel %s: it cannot be promoted",
                       self->take, self->channel_name);
    return ls_field_source_ratio(self->source, (uint32_t)s, &self->ratio, diag);
}

static enum ls_err start(struct fetch_job *self, struct ls_diag *diag)
{
    enum ls_err err =
        ls_field_cache_get(self->cache, self->take, self->camera, &self->source, diag);
    if (err)
        return err;
    int channel = ls_take_facts_channel(self->source->facts, self->channel_name);
    if (channel < 0)
        return ls_fail(diag, LS_ERR_NOT_FOUND, "take %s has no channel \"%.32s\"", self->take,
                       self->channel_name);
    self->channel = (uint32_t)channel;
    err = ls_picture_region_check(&self->region, self->source->width, self->source->height, diag);
    if (!err)
        err = choose_ratio(self, diag);
    return err ? err : choose_lights(self, diag);
}

/* ---- one band ---- */

struct picture {
    const struct ls_picture_map *map;
    double gain; /* of the values sent */
    double k;
};

static enum ls_err sphere_picture(const struct fetch_job *self, struct picture *out,
                                  struct ls_diag *diag)
{
    int s = ls_field_source_spectrum(self->source, self->channel);
    const struct ls_field *field = &self->source->field;
    out->map = ls_field_source_picture(self->source, self->channel, -1, NULL);
    if (!out->map)
        return ls_fail(diag, LS_ERR_STATE, "take %s has no full sphere of channel %s", self->take,
                       self->channel_name);
    out->k = out->gain = 1;
    if (self->estimate)
        return LS_OK;
    if (s < 0 || !self->source->has_sphere[s])
        return ls_fail(diag, LS_ERR_STATE,
                       "the full sphere of channel %s has no calibrated duty; fetch the estimate",
                       self->channel_name);
    out->gain = ls_promote_sphere_factor(field, (uint32_t)s) * field->scale;
    return LS_OK;
}

static enum ls_err light_picture(const struct fetch_job *self, struct picture *out,
                                 struct ls_diag *diag)
{
    uint32_t light = self->lights[self->light];
    uint32_t from = self->ratio ? self->source->channel_of[0] : self->channel;
    if (light >= self->source->facts->n_lights)
        return ls_fail(diag, LS_ERR_NOT_FOUND, "light %u: the take has lights 0 to %u", light,
                       self->source->facts->n_lights - 1);
    out->map = ls_field_source_picture(self->source, from, light, NULL);
    if (!out->map && !is_planned(self->source->facts, from, light)) {
        char what[32];
        snprintf(what, sizeof what, "light %u", light);
        return not_planned(self, what, from, diag);
    }
    if (!out->map)
        return ls_fail(diag, LS_ERR_STATE, "take %s has no picture of light %u under %s",
                       self->take, light, self->source->facts->channels[from].name);
    out->k = self->estimate ? 1 : ls_field_source_gain(self->source, from, light);
    out->gain = self->estimate ? 1 : out->k * self->source->field.scale;
    return LS_OK;
}

static void promote(const struct fetch_job *self, struct ls_demosaic_region band, float *rgb)
{
    uint32_t colours = self->source->field.n_channels;
    for (uint32_t y = 0; y < band.height; y++) {
        const float *ratio =
            self->ratio + ((size_t)(band.y + y) * self->source->width + band.x) * colours;
        float *row = rgb + (size_t)y * band.width * colours;
        for (size_t i = 0; i < (size_t)band.width * colours; i++)
            row[i] *= ratio[i];
    }
}

static enum ls_err make_rgb(const struct fetch_job *self, const struct picture *picture,
                            struct ls_demosaic_region band, float *out, struct ls_diag *diag)
{
    struct ls_demosaic_region w =
        ls_demosaic_needs(band, self->source->width, self->source->height);
    float *mosaic = malloc((size_t)w.width * w.height * sizeof(float));
    if (!mosaic)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    ls_picture_map_read(picture->map, w.x, w.y, w.width, w.height, (float)picture->gain, mosaic);
    enum ls_err err = ls_relight_demosaic(&self->source->field, mosaic, w, band, out);
    free(mosaic);
    if (!err && self->ratio)
        promote(self, band, out);
    return err;
}

/* Values of a band as they go over the wire. */
static enum ls_err make_payload(const struct fetch_job *self, const struct picture *picture,
                                struct ls_demosaic_region band, uint32_t components,
                                struct ls_chunk *chunk, struct ls_diag *diag)
{
    size_t n = (size_t)band.width * band.height * components;
    bool exact = self->half && !self->rgb && self->estimate;
    float *values = malloc(n * sizeof(float));
    enum ls_err err = LS_OK;
    if (!values)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    chunk->payload = (uint8_t *)values;
    chunk->payload_bytes = n * (self->half ? 2 : 4);
    if (exact)
        ls_picture_map_read_half(picture->map, band.x, band.y, band.width, band.height,
                                 (uint16_t *)values);
    else if (self->rgb)
        err = make_rgb(self, picture, band, values, diag);
    else
        ls_picture_map_read(picture->map, band.x, band.y, band.width, band.height,
                            (float)picture->gain, values);
    if (err || exact || !self->half)
        return err;
    uint16_t *halfs = malloc(n * sizeof *halfs);
    if (!halfs)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    ls_half_from_floats(values, halfs, n);
    free(values);
    chunk->payload = (uint8_t *)halfs;
    return LS_OK;
}

static void describe(const struct fetch_job *self, const struct picture *picture,
                     struct ls_demosaic_region band, uint32_t components,
                     Lightstage__FetchReply *body)
{
    lightstage__fetch_reply__init(body);
    body->light = self->full_sphere ? 0 : self->lights[self->light];
    body->width = self->region.width;
    body->height = self->region.height;
    body->first_row = band.y - self->region.y;
    body->n_rows = band.height;
    body->components = components;
    body->sample = self->half ? LIGHTSTAGE__SAMPLE__HALF : LIGHTSTAGE__SAMPLE__FLOAT;
    body->reference_exposure_s = self->source->facts->reference_exposure_s;
    body->gain_k = picture->k;
    body->calibrated = self->source->calibrated;
}

static enum ls_err make_band(struct fetch_job *self, struct ls_chunk *chunk, bool *last,
                             struct ls_diag *diag)
{
    struct picture picture = {0};
    Lightstage__FetchReply body;
    uint32_t components = self->rgb ? self->source->field.n_channels : 1;
    uint32_t left = self->region.height - self->row;
    struct ls_demosaic_region band = {self->region.x, self->region.y + self->row,
                                      self->region.width, left < BAND_ROWS ? left : BAND_ROWS};
    enum ls_err err = self->full_sphere ? sphere_picture(self, &picture, diag)
                                        : light_picture(self, &picture, diag);
    if (!err)
        err = make_payload(self, &picture, band, components, chunk, diag);
    if (err)
        return err;
    describe(self, &picture, band, components, &body);
    self->row += band.height;
    if (self->row == self->region.height) {
        self->row = 0;
        self->light++;
    }
    *last = self->light == self->n_lights;
    return ls_message_frame(LS_MESSAGE_FETCH | LS_MESSAGE_REPLY, self->job.request,
                            *last ? LS_FRAME_LAST : 0, &body.base, chunk->payload_bytes,
                            &chunk->head, &chunk->head_bytes, diag);
}

static enum ls_err fetch_step(struct ls_job *job, struct ls_chunk *chunk, bool *last,
                              struct ls_diag *diag)
{
    struct fetch_job *self = (struct fetch_job *)job;
    enum ls_err err = self->source ? make_band(self, chunk, last, diag) : start(self, diag);
    return err ? err : ls_field_source_sound(self->source, *last, diag);
}

/* ---- making ---- */

static enum ls_err check(const Lightstage__Fetch *fetch, struct ls_diag *diag)
{
    if (strlen(fetch->channel) < 1 || strlen(fetch->channel) > 31)
        return ls_fail(diag, LS_ERR_INVALID, "fetch: expected the name of a channel");
    if (fetch->n_lights > LS_MAX_LIGHTS)
        return ls_fail(diag, LS_ERR_LIMIT, "fetch: %zu lights, at most %d", fetch->n_lights,
                       LS_MAX_LIGHTS);
    if (fetch->model == LIGHTSTAGE__MODEL__SPHERE && fetch->layout == LIGHTSTAGE__LAYOUT__MOSAIC)
        return ls_fail(diag, LS_ERR_UNSUPPORTED,
                       "fetch: a promoted field has no mosaic (ratios are formed after "
                       "demosaicing); ask for rgb");
    if (fetch->model == LIGHTSTAGE__MODEL__SPHERE &&
        fetch->quantity == LIGHTSTAGE__QUANTITY__ESTIMATE)
        return ls_fail(diag, LS_ERR_UNSUPPORTED,
                       "fetch: an estimate is photographed, not promoted; ask for the reflectance");
    return LS_OK;
}

enum ls_err ls_fetch_job_create(uint32_t request, struct ls_field_cache *cache,
                                const Lightstage__Fetch *fetch, struct ls_job **out,
                                struct ls_diag *diag)
{
    static const struct ls_job_ops ops = {"fetch", fetch_step, fetch_destroy};
    enum ls_err err = check(fetch, diag);
    if (err)
        return err;
    struct fetch_job *self = g_new0(struct fetch_job, 1);
    self->job = (struct ls_job){.ops = &ops, .request = request};
    self->cache = cache;
    snprintf(self->take, sizeof self->take, "%s", fetch->take);
    snprintf(self->channel_name, sizeof self->channel_name, "%s", fetch->channel);
    self->camera = fetch->camera;
    self->full_sphere = fetch->full_sphere;
    self->rgb = fetch->layout == LIGHTSTAGE__LAYOUT__RGB;
    self->promoted = fetch->model == LIGHTSTAGE__MODEL__SPHERE && !fetch->full_sphere;
    self->estimate = fetch->quantity == LIGHTSTAGE__QUANTITY__ESTIMATE;
    self->half = fetch->sample == LIGHTSTAGE__SAMPLE__HALF;
    self->region = ls_picture_region_of(fetch->region);
    if (fetch->n_lights > 0) {
        self->lights = g_memdup2(fetch->lights, fetch->n_lights * sizeof *self->lights);
        self->n_lights = fetch->n_lights;
    }
    *out = &self->job;
    return LS_OK;
}
