#include "daemon/fetch_job.h"

#include "core/half.h"
#include "core/promote.h"
#include "daemon/factored.h"
#include "daemon/light_set.h"
#include "daemon/picture_region.h"
#include "daemon/pixel_quality.h"
#include "daemon/reduction.h"
#include "daemon/render.h"
#include "daemon/rgb_band.h"
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
    bool reported; /* what was done for the picture at hand */
    bool started, full_sphere, rgb, mono, estimate, half; /* mono: by way of rgb */
    struct ls_pixel_quality quality;
    struct ls_tiles tiles;
    const uint16_t *ratio_tiles; /* of promoted halves that are made tile by tile; or NULL */
    struct ls_reduction reduction;
    struct ls_factored factored;
    struct ls_demosaic_region asked, region, /* region: what is sent of the picture at hand, in its
                                                level's pixels */
        read;                                /* full-size pixels that it is made of */
    uint32_t read_row;                       /* next, in them */
    uint32_t *lights;                        /* NULL = all, until the first step */
    size_t n_lights, light;                  /* current index */
    uint32_t row;                            /* next, in the region */
    uint32_t channel;
    struct ls_promotion promotion;
    struct ls_way way;        /* of single lights */
    struct ls_render *render; /* of the current light, where it is promoted */
};

static void fetch_destroy(struct ls_job *job)
{
    struct fetch_job *self = (struct fetch_job *)job;
    ls_render_close(self->render);
    if (self->source)
        ls_field_cache_put(self->cache, self->source);
    ls_tiles_finish(&self->tiles);
    ls_reduction_finish(&self->reduction);
    free(self->lights);
    g_free(self);
}

/* ---- start ---- */

/* Has k a factor for each colour of the camera? */
static bool coloured(const struct fetch_job *self)
{
    return !self->estimate && self->way.set && ls_light_set_is_coloured(self->way.set);
}

/* Made of more than one picture per light? */
static bool of_several(const struct fetch_job *self)
{
    return self->way.kind != LS_WAY_PHOTOGRAPHED ||
           (self->way.set && ls_light_set_is_summed(self->way.set));
}

/* Not simply a picture times a gain? */
static bool promoted(const struct fetch_job *self)
{
    return of_several(self) || coloured(self);
}

/* Is a promoted light one picture times a ratio, for halves to hold? Floats, and all other ways,
 * are rendered. */
static bool promoted_as_halves(const struct fetch_job *self)
{
    return self->half && self->rgb && !ls_reduction_any(&self->reduction) &&
           self->way.kind == LS_WAY_RATIO && !coloured(self) &&
           !ls_light_set_is_summed(self->way.set);
}

/* A way without a set needs the pictures of all lights, and has them. */
static bool has_light(const struct fetch_job *self, uint32_t light)
{
    return !self->way.set || ls_light_set_has(self->source, self->way.set, light);
}

static enum ls_err choose_lights(struct fetch_job *self, struct ls_diag *diag)
{
    const struct ls_take_facts *facts = self->source->facts;
    if (self->lights)
        return LS_OK;
    self->lights = calloc(facts->n_lights, sizeof *self->lights);
    if (!self->lights)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    if (self->full_sphere) {
        self->n_lights = 1;
        return LS_OK;
    }
    for (uint32_t i = 0; i < facts->n_lights; i++)
        if (has_light(self, i))
            self->lights[self->n_lights++] = i;
    if (self->n_lights == 0)
        return ls_fail(diag, LS_ERR_STATE, "take %s has no picture of a single light under %s",
                       self->take, self->channel_name);
    return LS_OK;
}

/* One picture has a validity and a variance, a sum of several has none. */
static enum ls_err check_quality(const struct fetch_job *self, struct ls_diag *diag)
{
    const struct ls_pixel_quality *q = &self->quality;
    if ((q->variance || q->validity) && of_several(self))
        return ls_fail(diag, LS_ERR_UNSUPPORTED,
                       "fetch: a light of %s is a sum of several pictures of take %s: validity and "
                       "variance are those of its `conditions`",
                       self->channel_name, self->take);
    if (q->variance && coloured(self))
        return ls_fail(
            diag, LS_ERR_UNSUPPORTED,
            "fetch: the gains of %s differ by the camera's colours: ask for the variance "
            "of the estimate",
            self->channel_name);
    return LS_OK;
}

static enum ls_err check_layout(struct fetch_job *self, struct ls_diag *diag)
{
    if (self->mono)
        return ls_reduction_make_mono(&self->reduction, self->source->facts, diag);
    if (self->reduction.level > 0 && !self->rgb && self->source->field.n_channels > 1)
        return ls_fail(diag, LS_ERR_UNSUPPORTED,
                       "fetch: a mosaic of colours has no level but 0; ask for rgb or mono");
    return LS_OK;
}

/* A factored fetch is of white. */
static enum ls_err find_channel(struct fetch_job *self, struct ls_diag *diag)
{
    const struct ls_take_facts *facts = self->source->facts;
    if (self->factored.wanted)
        snprintf(self->channel_name, sizeof self->channel_name, "%s",
                 facts->channels[self->source->channel_of[0]].name);
    int channel = ls_take_facts_channel(facts, self->channel_name);
    if (channel < 0)
        return ls_fail(diag, LS_ERR_NOT_FOUND, "take %s has no channel \"%.32s\"", self->take,
                       self->channel_name);
    self->channel = (uint32_t)channel;
    return LS_OK;
}

static enum ls_err start(struct fetch_job *self, struct ls_diag *diag)
{
    enum ls_err err = self->source ? LS_OK /* it waited for maps */
                                   : ls_field_cache_get(self->cache, self->take, self->camera,
                                                        &self->source, diag);
    if (err)
        return err;
    err = find_channel(self, diag);
    if (!err)
        err =
            ls_picture_region_check(&self->asked, self->source->width, self->source->height, diag);
    if (!err)
        err = check_layout(self, diag);
    if (!err && !self->full_sphere)
        err = ls_promotion_find(self->source, &self->promotion, self->channel, &self->job,
                                &self->way, diag);
    if (!err && self->factored.wanted)
        err = ls_factored_find(&self->factored, self->source, &self->promotion, &self->way,
                               &self->job, diag);
    if (!err)
        err = check_quality(self, diag);
    if (!err)
        err = choose_lights(self, diag);
    if (!err)
        self->asked = ls_level_region(self->asked, self->reduction.level);
    self->region = self->asked;
    self->started = !err;
    return err;
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

/* The channel whose pictures a light is made of. */
static uint32_t shown_by(const struct fetch_job *self)
{
    return self->way.kind == LS_WAY_PHOTOGRAPHED && self->way.set != &self->source->white
               ? self->channel
               : self->source->channel_of[0];
}

static enum ls_err check_light(const struct fetch_job *self, uint32_t light, struct ls_diag *diag)
{
    const struct ls_take_facts *facts = self->source->facts;
    if (light >= facts->n_lights)
        return ls_fail(diag, LS_ERR_NOT_FOUND, "light %u: the take has lights 0 to %u", light,
                       facts->n_lights - 1);
    if (has_light(self, light))
        return LS_OK;
    uint32_t from = shown_by(self);
    bool planned = ls_field_source_planned(self->source, LS_FACT_ONE, from, light);
    return ls_fail(diag, planned ? LS_ERR_STATE : LS_ERR_NOT_FOUND,
                   "%s %s has no picture of light %u under %s",
                   planned ? "take" : "the plan of take", self->take, light,
                   facts->channels[from].name);
}

static enum ls_err light_picture(const struct fetch_job *self, struct picture *out,
                                 struct ls_diag *diag)
{
    uint32_t light = self->lights[self->light];
    enum ls_err err = check_light(self, light, diag);
    if (err)
        return err;
    uint32_t from = shown_by(self);
    out->map = ls_field_source_picture(self->source, from, light, NULL);
    bool sum = of_several(self) && self->source->white_is_polarised;
    out->k = self->estimate || sum ? 1 : ls_field_source_gain(self->source, from, light);
    out->gain = self->estimate ? 1 : out->k * self->source->field.scale;
    return LS_OK;
}

/* ---- promoted ---- */

static enum ls_err open_render(struct fetch_job *self, struct ls_diag *diag)
{
    uint32_t n = self->source->field.n_lights;
    LS_CLEANUP_FREE double *weights = calloc(n, sizeof *weights);
    if (!weights)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    uint32_t light = self->lights[self->light];
    double gained = ls_field_source_gain(self->source, self->channel, light);
    weights[light] = self->estimate ? 1 / (gained * self->source->field.scale) : 1;
    const struct ls_render_term term = {.channel = self->channel, .weights = weights, .target = -1};
    const struct ls_render_job job = {.promotion = self->promotion,
                                      .terms = &term,
                                      .n_terms = 1,
                                      .n_pictures = 1,
                                      .mosaic = !self->rgb,
                                      .k_alone = self->estimate,
                                      .region = self->read,
                                      .asker = &self->job};
    return ls_render_open(self->source, &job, &self->render, diag);
}

/* The next band as @components values per pixel; (transfer full). */
static enum ls_err next_promoted(struct fetch_job *self, struct ls_demosaic_region *band,
                                 float **values, struct ls_diag *diag)
{
    bool done = false;
    enum ls_err err = self->render ? LS_OK : open_render(self, diag);
    if (!err)
        err = ls_render_step(self->render, band, values, &done, diag);
    if (!err && done) {
        ls_render_close(self->render);
        self->render = NULL;
    }
    size_t n = err ? 0 : (size_t)band->width * band->height;
    bool one = self->source->field.n_channels == 1 || !self->rgb;
    for (size_t j = 0; j < n && one; j++)
        (*values)[j] = (*values)[3 * j];
    return err;
}

/* ---- over the wire ---- */

static enum ls_err halve(struct ls_chunk *chunk, size_t n, struct ls_diag *diag)
{
    uint16_t *halfs = malloc(n * sizeof *halfs);
    if (!halfs)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    ls_half_from_floats((const float *)(const void *)chunk->payload, halfs, n);
    free(chunk->payload);
    chunk->payload = (uint8_t *)halfs;
    return LS_OK;
}

/* Of full-size pixels: what is made of them is made of floats. */
static bool sends_halves(const struct fetch_job *self)
{
    return self->half && !ls_reduction_any(&self->reduction);
}

/* One component per pixel, gained. */
static enum ls_err read_mosaic(const struct fetch_job *self, const struct picture *picture,
                               struct ls_demosaic_region r, struct ls_chunk *chunk,
                               struct ls_diag *diag)
{
    if (sends_halves(self) && self->estimate) {
        ls_picture_map_read_half(picture->map, r.x, r.y, r.width, r.height,
                                 (uint16_t *)(void *)chunk->payload);
        return LS_OK;
    }
    ls_picture_map_read(picture->map, r.x, r.y, r.width, r.height, (float)picture->gain,
                        (float *)(void *)chunk->payload);
    return sends_halves(self) ? halve(chunk, (size_t)r.width * r.height, diag) : LS_OK;
}

/* @r is a tile, if anything is known of tiles; else NULL. */
static const uint16_t *ratio_of_tile(const struct fetch_job *self,
                                     const struct ls_demosaic_region *r)
{
    const struct ls_field *field = &self->source->field;
    size_t number = (size_t)r->y / LS_TILE_SIDE * ls_field_tiles_x(field) + r->x / LS_TILE_SIDE;
    return self->ratio_tiles
               ? self->ratio_tiles + number * LS_TILE_SIDE * LS_TILE_SIDE * field->n_channels
               : NULL;
}

/* Values of a band of one picture as they go over the wire; into @chunk's payload, if it has room.
 */
static enum ls_err make_payload(const struct fetch_job *self, const struct picture *picture,
                                struct ls_demosaic_region r, uint32_t components,
                                struct ls_chunk *chunk, struct ls_diag *diag)
{
    const struct ls_field_map *map = self->way.map;
    struct ls_rgb_band band = {
        .field = &self->source->field, .map = picture->map, .region = r, .gain = picture->gain};
    if (!chunk->payload)
        chunk->payload = malloc((size_t)r.width * r.height * components * sizeof(float));
    if (!chunk->payload)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    if (!self->rgb)
        return read_mosaic(self, picture, r, chunk, diag);
    if (ls_factored_is_ratio(&self->factored)) {
        ls_factored_fill(&self->factored, self->source, r, (uint16_t *)(void *)chunk->payload);
        return LS_OK;
    }
    if (self->factored.wanted)
        band.gain = 1;
    if (promoted_as_halves(self)) {
        band.ratio = map->values + ((size_t)r.y * self->source->width + r.x) * map->depth;
        band.ratio_stride = (size_t)self->source->width * map->depth;
        band.ratio_halves = ratio_of_tile(self, &r);
    }
    return sends_halves(self) ? ls_rgb_band_halves(&band, (uint16_t *)(void *)chunk->payload, diag)
                              : ls_rgb_band_floats(&band, (float *)(void *)chunk->payload, diag);
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
    body->level = self->reduction.level;
    if (!self->factored.wanted)
        return;
    bool ratio = ls_factored_is_ratio(&self->factored);
    body->factor = ratio ? LIGHTSTAGE__FACTOR__RATIO : LIGHTSTAGE__FACTOR__WHITE;
    body->light = ratio ? self->factored.at : body->light;
    body->gain = (float)picture->gain;
}

static enum ls_err picture_band(struct fetch_job *self, const struct picture *picture,
                                struct ls_demosaic_region *band, uint32_t components,
                                struct ls_chunk *chunk, struct ls_diag *diag)
{
    const struct ls_demosaic_region *r = &self->read;
    uint32_t left = r->height - self->read_row, most = BAND_ROWS << self->reduction.level;
    *band = (struct ls_demosaic_region){r->x, r->y + self->read_row, r->width,
                                        left < most ? left : most};
    return make_payload(self, picture, *band, components, chunk, diag);
}

static enum ls_err promoted_band(struct fetch_job *self, struct ls_demosaic_region *band,
                                 uint32_t components, struct ls_chunk *chunk, struct ls_diag *diag)
{
    float *values = NULL;
    enum ls_err err = next_promoted(self, band, &values, diag);
    chunk->payload = (uint8_t *)values;
    return err || !sends_halves(self)
               ? err
               : halve(chunk, (size_t)band->width * band->height * components, diag);
}

static void next_picture(struct fetch_job *self)
{
    self->row = 0;
    self->reported = false;
    if (ls_factored_is_ratio(&self->factored))
        self->factored.at++;
    else
        self->light++;
}

/* Values of the next rows of full-size pixels: @chunk's payload. */
static enum ls_err read_band(struct fetch_job *self, const struct picture *picture,
                             struct ls_demosaic_region *band, struct ls_chunk *chunk,
                             struct ls_diag *diag)
{
    uint32_t components = self->rgb ? self->source->field.n_channels : 1;
    enum ls_err err = promoted(self) && !promoted_as_halves(self)
                          ? promoted_band(self, band, components, chunk, diag)
                          : picture_band(self, picture, band, components, chunk, diag);
    self->read_row += err ? 0 : band->height;
    return err;
}

/* The same, until a row is made of them. */
static enum ls_err reduced_band(struct fetch_job *self, const struct picture *picture,
                                struct ls_demosaic_region *band, uint32_t components,
                                struct ls_chunk *chunk, struct ls_diag *diag)
{
    uint32_t made = 0;
    enum ls_err err = LS_OK;
    while (!err && made == 0) {
        struct ls_chunk full = {0};
        float *rows = NULL;
        err = read_band(self, picture, band, &full, diag);
        if (!err)
            err = ls_reduction_add(&self->reduction, (float *)(void *)full.payload, band->height,
                                   &rows, &made, diag);
        free(full.payload);
        free(chunk->payload);
        chunk->payload = (uint8_t *)rows;
    }
    *band = (struct ls_demosaic_region){self->region.x, self->region.y + self->row,
                                        self->region.width, made};
    size_t n = (size_t)band->width * made * components;
    if (err || !self->half)
        return err;
    ls_reduction_clamp((float *)(void *)chunk->payload, n);
    return halve(chunk, n, diag);
}

static enum ls_err begin_rows(struct fetch_job *self, struct ls_diag *diag)
{
    uint32_t level = self->reduction.level;
    self->read = ls_level_needs(self->region, level, self->source->width, self->source->height);
    self->read_row = 0;
    return ls_reduction_begin(&self->reduction, &self->read,
                              self->rgb ? self->source->field.n_channels : 1, diag);
}

/* Values of the next rows, as they go over the wire: @chunk's payload. */
static enum ls_err next_band(struct fetch_job *self, const struct picture *picture,
                             struct ls_demosaic_region *band, uint32_t components,
                             struct ls_chunk *chunk, struct ls_diag *diag)
{
    enum ls_err err = self->row == 0 ? begin_rows(self, diag) : LS_OK;
    if (!err)
        err = ls_reduction_any(&self->reduction)
                  ? reduced_band(self, picture, band, components, chunk, diag)
                  : read_band(self, picture, band, chunk, diag);
    if (err)
        return err;
    chunk->payload_bytes =
        (size_t)band->width * band->height * components * (self->half ? 2 : sizeof(float));
    self->row += band->height;
    return LS_OK;
}

/* A frame whose payload is there. */
static enum ls_err send(struct fetch_job *self, Lightstage__FetchReply *body, bool picture_ends,
                        struct ls_chunk *chunk, bool *last, struct ls_diag *diag)
{
    Lightstage__SpectrumReport report;
    if (!self->reported && !self->full_sphere) {
        const struct ls_factored *f = &self->factored;
        ls_promotion_report(self->source, &self->promotion,
                            ls_factored_is_ratio(f) ? &f->ways[f->at] : &self->way, &report);
        body->spectrum = &report;
    }
    self->reported = true;
    if (picture_ends)
        next_picture(self);
    *last = self->light == self->n_lights;
    size_t lent = chunk->lent ? chunk->lent->n_bytes : 0;
    return ls_message_frame(LS_MESSAGE_FETCH | LS_MESSAGE_REPLY, self->job.request,
                            *last ? LS_FRAME_LAST : 0, &body->base, chunk->payload_bytes + lent,
                            &chunk->head, &chunk->head_bytes, diag);
}

static enum ls_err make_band(struct fetch_job *self, const struct picture *picture,
                             uint32_t components, struct ls_chunk *chunk, bool *last,
                             struct ls_diag *diag)
{
    struct ls_demosaic_region band = {0};
    Lightstage__FetchReply body;
    enum ls_err err = next_band(self, picture, &band, components, chunk, diag);
    if (err)
        return err;
    describe(self, picture, band, components, &body);
    err = ls_pixel_quality_append(self->quality, picture->map, self->source->facts, band,
                                  picture->gain, chunk, &body, diag);
    return err ? err : send(self, &body, self->row == self->region.height, chunk, last, diag);
}

/* ---- in tiles ---- */

/* Each pixel is made of those around it alone. */
static bool by_pixel(const struct fetch_job *self)
{
    return !ls_reduction_any(&self->reduction) && (!promoted(self) || promoted_as_halves(self));
}

/* Nothing is done to the picture. */
static bool as_stored(const struct fetch_job *self)
{
    return self->estimate && sends_halves(self) && !self->rgb && !promoted(self);
}

static void release_source(void *owner, void *what)
{
    ls_field_cache_put(owner, what);
}

static enum ls_err lend_tiles(struct fetch_job *self, const struct picture *picture,
                              struct ls_chunk *chunk, Lightstage__FetchReply *body,
                              struct ls_diag *diag)
{
    const struct ls_tiles_holder holder = {release_source, self->cache, self->source};
    ls_field_cache_share(self->cache, self->source);
    return ls_tiles_lend(&self->tiles, picture->map, &holder, chunk, body, diag);
}

struct tile_maker {
    struct fetch_job *job;
    const struct picture *picture;
    uint32_t components;
};

/* RGB is made where it belongs. */
static enum ls_err make_tile(void *user, struct ls_demosaic_region region, uint8_t *out,
                             struct ls_diag *diag)
{
    const struct tile_maker *m = user;
    size_t n = (size_t)region.width * region.height * m->components;
    struct ls_chunk chunk = {.payload = m->job->rgb ? out : NULL};
    enum ls_err err = make_payload(m->job, m->picture, region, m->components, &chunk, diag);
    if (chunk.payload == out)
        return err;
    if (!err)
        memcpy(out, chunk.payload, n * (m->job->half ? 2 : sizeof(float)));
    free(chunk.payload);
    return err;
}

/* *there: some are complete. */
static enum ls_err make_tiles(struct fetch_job *self, const struct picture *picture,
                              uint32_t components, struct ls_chunk *chunk,
                              Lightstage__FetchReply *body, bool *there, struct ls_diag *diag)
{
    struct ls_demosaic_region band = {0};
    struct ls_chunk values = {0};
    enum ls_err err = ls_tiles_tell(&self->tiles, chunk, body, there, diag);
    if (err || *there)
        return err;
    err = next_band(self, picture, &band, components, &values, diag);
    if (!err)
        err = ls_tiles_add(&self->tiles, band, values.payload, diag);
    ls_chunk_finish(&values);
    return err ? err : ls_tiles_take(&self->tiles, chunk, body, there, diag);
}

/* False: the picture has none that are asked for. */
static enum ls_err begin_tiles(struct fetch_job *self, uint32_t components, bool *any,
                               struct ls_diag *diag)
{
    self->region = self->asked;
    enum ls_err err =
        ls_tiles_begin(&self->tiles, ls_level_size(self->source->width, self->reduction.level),
                       ls_level_size(self->source->height, self->reduction.level),
                       components * (self->half ? 2 : sizeof(float)), &self->region, diag);
    *any = !err && self->region.height > 0;
    if (*any && by_pixel(self) && promoted_as_halves(self))
        self->ratio_tiles = ls_field_maps_halves(self->source, self->way.map);
    if (!err && !*any) {
        next_picture(self);
        if (self->light == self->n_lights)
            err = ls_fail(diag, LS_ERR_LIMIT, "fetch: first_tile %u is beyond the last tile",
                          (unsigned)self->tiles.first);
    }
    return err;
}

static enum ls_err next_tiles(struct fetch_job *self, const struct picture *picture,
                              uint32_t components, struct ls_chunk *chunk, bool *last,
                              struct ls_diag *diag)
{
    Lightstage__FetchReply body;
    bool there = true;
    enum ls_err err =
        ls_tiles_end(&self->tiles) ? begin_tiles(self, components, &there, diag) : LS_OK;
    if (err || !there)
        return err;
    describe(self, picture, self->region, components, &body);
    struct tile_maker maker = {self, picture, components};
    const struct ls_crew crew = {ls_crew_threads(), &self->job};
    if (as_stored(self))
        err = lend_tiles(self, picture, chunk, &body, diag);
    else if (by_pixel(self))
        err = ls_tiles_make(&self->tiles, &crew, make_tile, &maker, chunk, &body, &there, diag);
    else
        err = make_tiles(self, picture, components, chunk, &body, &there, diag);
    return err || !there ? err : send(self, &body, ls_tiles_end(&self->tiles), chunk, last, diag);
}

static enum ls_err next_frame(struct fetch_job *self, struct ls_chunk *chunk, bool *last,
                              struct ls_diag *diag)
{
    struct picture picture = {.gain = 1, .k = 1};
    uint32_t components =
        self->rgb && !self->reduction.luminance ? self->source->field.n_channels : 1;
    enum ls_err err = LS_OK;
    if (self->full_sphere)
        err = sphere_picture(self, &picture, diag);
    else if (!ls_factored_is_ratio(&self->factored))
        err = light_picture(self, &picture, diag);
    if (err)
        return err;
    return self->tiles.wanted ? next_tiles(self, &picture, components, chunk, last, diag)
                              : make_band(self, &picture, components, chunk, last, diag);
}

static enum ls_err fetch_step(struct ls_job *job, struct ls_chunk *chunk, bool *last,
                              struct ls_diag *diag)
{
    struct fetch_job *self = (struct fetch_job *)job;
    enum ls_err err = self->started ? next_frame(self, chunk, last, diag) : start(self, diag);
    return err ? err : ls_field_source_sound(self->source, *last, diag);
}

/* ---- making ---- */

static enum ls_err check(const Lightstage__Fetch *fetch, struct ls_diag *diag)
{
    if (!fetch->factored && (strlen(fetch->channel) < 1 || strlen(fetch->channel) > 31))
        return ls_fail(diag, LS_ERR_INVALID, "fetch: expected the name of a channel");
    if (fetch->layout > LIGHTSTAGE__LAYOUT__MONO)
        return ls_fail(diag, LS_ERR_UNSUPPORTED, "fetch: layout %d is not known",
                       (int)fetch->layout);
    if (fetch->n_lights > LS_MAX_LIGHTS)
        return ls_fail(diag, LS_ERR_LIMIT, "fetch: %zu lights, at most %d", fetch->n_lights,
                       LS_MAX_LIGHTS);
    return LS_OK;
}

/* What is photographed needs no model; what is promoted is RGB and gained. */
static enum ls_err check_promotion(const Lightstage__Fetch *fetch,
                                   const struct ls_promotion *promotion, struct ls_diag *diag)
{
    if (promotion->model == LIGHTSTAGE__MODEL__MEASURED)
        return LS_OK;
    if (fetch->full_sphere)
        return ls_fail(diag, LS_ERR_UNSUPPORTED,
                       "fetch: a full sphere is photographed, not promoted; leave out the model");
    if (fetch->layout == LIGHTSTAGE__LAYOUT__MOSAIC)
        return ls_fail(diag, LS_ERR_UNSUPPORTED,
                       "fetch: a promoted field has no mosaic (ratios are formed after "
                       "demosaicing); ask for rgb");
    if (fetch->quantity == LIGHTSTAGE__QUANTITY__ESTIMATE)
        return ls_fail(diag, LS_ERR_UNSUPPORTED,
                       "fetch: an estimate is photographed, not promoted; ask for the reflectance");
    return LS_OK;
}

enum ls_err ls_fetch_job_create(uint32_t request, struct ls_field_cache *cache,
                                const Lightstage__Fetch *fetch, struct ls_tiles *tiles,
                                struct ls_job **out, struct ls_diag *diag)
{
    static const struct ls_job_ops ops = {"fetch", fetch_step, fetch_destroy};
    struct ls_promotion promotion;
    struct ls_factored factored;
    enum ls_err err = check(fetch, diag);
    if (!err)
        err = ls_promotion_read(fetch->promotion, fetch->model, &promotion, diag);
    if (!err)
        err = check_promotion(fetch, &promotion, diag);
    if (!err)
        err = ls_factored_read(fetch, &promotion, &factored, diag);
    if (!err)
        err = ls_reduction_check_level(fetch->level, diag);
    if (!err)
        err = ls_pixel_quality_check(fetch, diag);
    if (err)
        return err;
    struct fetch_job *self = g_new0(struct fetch_job, 1);
    self->job = (struct ls_job){.ops = &ops, .request = request};
    self->cache = cache;
    snprintf(self->take, sizeof self->take, "%s", fetch->take);
    self->job.take = self->take;
    snprintf(self->channel_name, sizeof self->channel_name, "%s", fetch->channel);
    self->camera = fetch->camera;
    self->full_sphere = fetch->full_sphere;
    self->mono = fetch->layout == LIGHTSTAGE__LAYOUT__MONO;
    self->rgb = fetch->layout == LIGHTSTAGE__LAYOUT__RGB || self->mono;
    self->reduction.level = fetch->level;
    self->promotion = promotion;
    self->factored = factored;
    self->estimate = fetch->quantity == LIGHTSTAGE__QUANTITY__ESTIMATE;
    self->half = fetch->sample == LIGHTSTAGE__SAMPLE__HALF;
    self->quality = ls_pixel_quality_of(fetch);
    self->tiles = *tiles;
    memset(tiles, 0, sizeof *tiles);
    self->asked = ls_picture_region_of(fetch->region);
    if (fetch->n_lights > 0) {
        self->lights = g_memdup2(fetch->lights, fetch->n_lights * sizeof *self->lights);
        self->n_lights = fetch->n_lights;
    }
    *out = &self->job;
    return LS_OK;
}
