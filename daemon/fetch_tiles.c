#include "daemon/fetch_private.h"

#include <stdlib.h>
#include <string.h>

/* Each pixel is made of those around it alone. */
static bool by_pixel(const struct ls_fetch_job *self)
{
    return !ls_reduction_any(&self->reduction) &&
           (!ls_fetch_is_promoted(self) || ls_fetch_is_promoted_as_halves(self));
}

/* Nothing is done to the picture. */
static bool as_stored(const struct ls_fetch_job *self)
{
    return self->estimate && ls_fetch_sends_halves(self) && !self->rgb &&
           !ls_fetch_is_promoted(self);
}

static void release_source(void *owner, void *what)
{
    ls_field_cache_put(owner, what);
}

static enum ls_err lend_tiles(struct ls_fetch_job *self, const struct ls_fetch_picture *picture,
                              struct ls_chunk *chunk, Lightstage__FetchReply *body,
                              struct ls_diag *diag)
{
    const struct ls_tiles_holder holder = {release_source, self->cache, self->source};
    ls_field_cache_share(self->cache, self->source);
    return ls_tiles_lend(&self->tiles, picture->map, &holder, chunk, body, diag);
}

struct tile_maker {
    struct ls_fetch_job *job;
    const struct ls_fetch_picture *picture;
};

/* RGB is made where it belongs. */
static enum ls_err make_tile(void *user, struct ls_demosaic_region region, uint8_t *out,
                             struct ls_diag *diag)
{
    const struct tile_maker *m = user;
    size_t n = (size_t)region.width * region.height * ls_fetch_components(m->job);
    struct ls_chunk chunk = {.payload = m->job->rgb ? out : NULL};
    enum ls_err err = ls_fetch_make_pixels(m->job, m->picture, region, &chunk, diag);
    if (chunk.payload == out)
        return err;
    if (!err)
        memcpy(out, chunk.payload, n * (m->job->half ? 2 : sizeof(float)));
    free(chunk.payload);
    return err;
}

/* *there: some are complete. */
static enum ls_err make_tiles(struct ls_fetch_job *self, const struct ls_fetch_picture *picture,
                              struct ls_chunk *chunk, Lightstage__FetchReply *body, bool *there,
                              struct ls_diag *diag)
{
    struct ls_demosaic_region band = {0};
    struct ls_chunk values = {0};
    enum ls_err err = ls_tiles_tell(&self->tiles, chunk, body, there, diag);
    if (err || *there)
        return err;
    err = ls_fetch_next_band(self, picture, &band, &values, diag);
    if (!err)
        err = ls_tiles_add(&self->tiles, band, values.payload, diag);
    ls_chunk_finish(&values);
    return err ? err : ls_tiles_take(&self->tiles, chunk, body, there, diag);
}

/* False: the picture has none that are asked for. */
static enum ls_err begin_tiles(struct ls_fetch_job *self, const struct ls_fetch_picture *picture,
                               bool *any, struct ls_diag *diag)
{
    self->region = self->asked;
    enum ls_err err = ls_tiles_begin(
        &self->tiles, ls_level_size(self->source->width, self->reduction.level),
        ls_level_size(self->source->height, self->reduction.level),
        ls_fetch_components(self) * (self->half ? 2 : sizeof(float)), &self->region, diag);
    if (!err)
        err = ls_fetch_bound_tiles(self, picture, by_pixel(self), diag);
    *any = !err && self->region.height > 0;
    if (*any && by_pixel(self) && ls_fetch_is_promoted_as_halves(self))
        self->now->ratio_tiles = ls_field_maps_halves(self->source, self->now->way.map);
    if (!err && !*any && ls_fetch_next_picture(self))
        return ls_fail(diag, LS_ERR_LIMIT, "fetch: first_tile %u is beyond the last tile",
                       (unsigned)self->tiles.first);
    return err;
}

enum ls_err ls_fetch_next_tiles(struct ls_fetch_job *self, const struct ls_fetch_picture *picture,
                                struct ls_chunk *chunk, bool *last, struct ls_diag *diag)
{
    Lightstage__FetchReply body;
    bool there = true;
    enum ls_err err = ls_tiles_end(&self->tiles) ? begin_tiles(self, picture, &there, diag) : LS_OK;
    if (err || !there)
        return err;
    ls_fetch_describe(self, picture, self->region, &body);
    struct tile_maker maker = {self, picture};
    const struct ls_crew crew = {ls_crew_threads(), &self->job};
    if (as_stored(self))
        err = lend_tiles(self, picture, chunk, &body, diag);
    else if (by_pixel(self))
        err = ls_tiles_make(&self->tiles, &crew, make_tile, &maker, chunk, &body, &there, diag);
    else
        err = make_tiles(self, picture, chunk, &body, &there, diag);
    return err || !there
               ? err
               : ls_fetch_send(self, &body, ls_tiles_end(&self->tiles), chunk, last, diag);
}
