#include "daemon/fetch_private.h"

#include "core/half.h"
#include "daemon/rgb_band.h"

#include <stdlib.h>

enum { BAND_ROWS = 64 };

/* ---- promoted ---- */

static enum ls_err open_render(struct ls_fetch_job *self, struct ls_diag *diag)
{
    uint32_t n = self->source->field.n_lights;
    LS_CLEANUP_FREE double *weights = calloc(n, sizeof *weights);
    if (!weights)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    uint32_t light = self->lights[self->light];
    double gained = ls_field_source_gain(self->source, self->now->channel, light);
    weights[light] = self->estimate ? 1 / (gained * self->source->field.scale) : 1;
    const struct ls_render_term term = {
        .channel = self->now->channel, .weights = weights, .target = -1};
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

/* The next band as it was made at full size; (transfer full). */
static enum ls_err next_promoted(struct ls_fetch_job *self, struct ls_demosaic_region *band,
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

uint32_t ls_fetch_components(const struct ls_fetch_job *self)
{
    return self->rgb && !self->reduction.luminance ? self->source->field.n_channels : 1;
}

/* Of the pixels that are read or rendered, before any reduction. */
static uint32_t components_made(const struct ls_fetch_job *self)
{
    return self->rgb ? self->source->field.n_channels : 1;
}

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

bool ls_fetch_sends_halves(const struct ls_fetch_job *self)
{
    return self->half && !ls_reduction_any(&self->reduction);
}

/* One component per pixel, gained. */
static enum ls_err read_mosaic(const struct ls_fetch_job *self,
                               const struct ls_fetch_picture *picture, struct ls_demosaic_region r,
                               struct ls_chunk *chunk, struct ls_diag *diag)
{
    if (ls_fetch_sends_halves(self) && self->estimate) {
        ls_picture_map_read_half(picture->map, r.x, r.y, r.width, r.height,
                                 (uint16_t *)(void *)chunk->payload);
        return LS_OK;
    }
    ls_picture_map_read(picture->map, r.x, r.y, r.width, r.height, (float)picture->gain,
                        (float *)(void *)chunk->payload);
    return ls_fetch_sends_halves(self) ? halve(chunk, (size_t)r.width * r.height, diag) : LS_OK;
}

/* @r is a tile, if anything is known of tiles; else NULL. */
static const uint16_t *ratio_of_tile(const struct ls_fetch_job *self,
                                     const struct ls_demosaic_region *r)
{
    const struct ls_field *field = &self->source->field;
    size_t number = (size_t)r->y / LS_TILE_SIDE * ls_field_tiles_x(field) + r->x / LS_TILE_SIDE;
    return self->now->ratio_tiles
               ? self->now->ratio_tiles + number * LS_TILE_SIDE * LS_TILE_SIDE * field->n_channels
               : NULL;
}

enum ls_err ls_fetch_make_pixels(const struct ls_fetch_job *self,
                                 const struct ls_fetch_picture *picture,
                                 struct ls_demosaic_region r, struct ls_chunk *chunk,
                                 struct ls_diag *diag)
{
    const struct ls_field_map *map = self->now->way.map;
    struct ls_rgb_band band = {
        .field = &self->source->field, .map = picture->map, .region = r, .gain = picture->gain};
    if (!chunk->payload)
        chunk->payload = malloc((size_t)r.width * r.height * components_made(self) * sizeof(float));
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
    if (ls_fetch_is_promoted_as_halves(self)) {
        band.ratio = map->values + ((size_t)r.y * self->source->width + r.x) * map->depth;
        band.ratio_stride = (size_t)self->source->width * map->depth;
        band.ratio_halves = ratio_of_tile(self, &r);
    }
    return ls_fetch_sends_halves(self)
               ? ls_rgb_band_halves(&band, (uint16_t *)(void *)chunk->payload, diag)
               : ls_rgb_band_floats(&band, (float *)(void *)chunk->payload, diag);
}

static enum ls_err picture_band(struct ls_fetch_job *self, const struct ls_fetch_picture *picture,
                                struct ls_demosaic_region *band, struct ls_chunk *chunk,
                                struct ls_diag *diag)
{
    const struct ls_demosaic_region *r = &self->read;
    uint32_t left = r->height - self->read_row, most = BAND_ROWS << self->reduction.level;
    *band = (struct ls_demosaic_region){r->x, r->y + self->read_row, r->width,
                                        left < most ? left : most};
    return ls_fetch_make_pixels(self, picture, *band, chunk, diag);
}

static enum ls_err promoted_band(struct ls_fetch_job *self, struct ls_demosaic_region *band,
                                 struct ls_chunk *chunk, struct ls_diag *diag)
{
    float *values = NULL;
    enum ls_err err = next_promoted(self, band, &values, diag);
    chunk->payload = (uint8_t *)values;
    return err || !ls_fetch_sends_halves(self)
               ? err
               : halve(chunk, (size_t)band->width * band->height * components_made(self), diag);
}

/* Values of the next rows of full-size pixels: @chunk's payload. */
static enum ls_err read_band(struct ls_fetch_job *self, const struct ls_fetch_picture *picture,
                             struct ls_demosaic_region *band, struct ls_chunk *chunk,
                             struct ls_diag *diag)
{
    enum ls_err err = ls_fetch_is_promoted(self) && !ls_fetch_is_promoted_as_halves(self)
                          ? promoted_band(self, band, chunk, diag)
                          : picture_band(self, picture, band, chunk, diag);
    self->read_row += err ? 0 : band->height;
    return err;
}

/* The same, until a row is made of them. */
static enum ls_err reduced_band(struct ls_fetch_job *self, const struct ls_fetch_picture *picture,
                                struct ls_demosaic_region *band, struct ls_chunk *chunk,
                                struct ls_diag *diag)
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
    size_t n = (size_t)band->width * made * ls_fetch_components(self);
    if (err || !self->half)
        return err;
    ls_reduction_clamp((float *)(void *)chunk->payload, n);
    return halve(chunk, n, diag);
}

static enum ls_err begin_rows(struct ls_fetch_job *self, struct ls_diag *diag)
{
    uint32_t level = self->reduction.level;
    self->read = ls_level_needs(self->region, level, self->source->width, self->source->height);
    self->read_row = 0;
    return ls_reduction_begin(&self->reduction, &self->read, components_made(self), diag);
}

enum ls_err ls_fetch_next_band(struct ls_fetch_job *self, const struct ls_fetch_picture *picture,
                               struct ls_demosaic_region *band, struct ls_chunk *chunk,
                               struct ls_diag *diag)
{
    enum ls_err err = self->row == 0 ? begin_rows(self, diag) : LS_OK;
    if (!err)
        err = ls_reduction_any(&self->reduction) ? reduced_band(self, picture, band, chunk, diag)
                                                 : read_band(self, picture, band, chunk, diag);
    if (err)
        return err;
    chunk->payload_bytes = (size_t)band->width * band->height * ls_fetch_components(self) *
                           (self->half ? 2 : sizeof(float));
    self->row += band->height;
    return LS_OK;
}

enum ls_err ls_fetch_next_rows(struct ls_fetch_job *self, const struct ls_fetch_picture *picture,
                               struct ls_chunk *chunk, bool *last, struct ls_diag *diag)
{
    struct ls_demosaic_region band = {0};
    Lightstage__FetchReply body;
    enum ls_err err = ls_fetch_next_band(self, picture, &band, chunk, diag);
    if (err)
        return err;
    ls_fetch_describe(self, picture, band, &body);
    err = ls_pixel_quality_append(self->quality, picture->map, self->source->facts, band,
                                  picture->gain, chunk, &body, diag);
    return err ? err
               : ls_fetch_send(self, &body, self->row == self->region.height, chunk, last, diag);
}
