#include "daemon/condition_job.h"

#include "core/half.h"
#include "daemon/picture_map.h"
#include "daemon/picture_region.h"
#include "daemon/pixel_quality.h"
#include "daemon/take_facts.h"
#include "daemon/takedir.h"
#include "proto/frame.h"
#include "proto/message.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { BAND_BYTES = 1 << 20, MAX_NAMES = 65536 };

struct condition_job {
    struct ls_job job;
    const char *storage;
    char take_id[128];
    uint32_t camera;
    bool half;
    struct ls_pixel_quality quality;
    struct ls_demosaic_region asked, region; /* region: of the picture at hand */
    char **names;
    size_t n_names, at; /* current name */
    uint32_t row;       /* next, in the region */
    struct ls_takedir *take;
    struct ls_take_facts *facts;
    const struct ls_published *published; /* the current name's */
    struct ls_picture_map *map; /* of the current name, from its first frame to its last; counted,
                                   what is lent of it holds it too */
    struct ls_tiles tiles;
};

static void finish_map(gpointer map)
{
    ls_picture_map_finish(map);
}

static void drop_map(struct ls_picture_map *map)
{
    if (map)
        g_atomic_rc_box_release_full(map, finish_map);
}

static void condition_destroy(struct ls_job *job)
{
    struct condition_job *self = (struct condition_job *)job;
    drop_map(self->map);
    ls_tiles_finish(&self->tiles);
    ls_take_facts_destroy(self->facts);
    ls_takedir_close(self->take);
    g_strfreev(self->names);
    g_free(self);
}

static enum ls_err open_take(struct condition_job *self, struct ls_diag *diag)
{
    char folder[4096];
    if (!ls_takedir_id_ok(self->take_id))
        return ls_fail(diag, LS_ERR_NOT_FOUND, "\"%.64s\" is not the name of a take",
                       self->take_id);
    if (snprintf(folder, sizeof folder, "%s/%s", self->storage, self->take_id) >=
        (int)sizeof folder)
        return ls_fail(diag, LS_ERR_INVALID, "%s: the path is too long", self->storage);
    enum ls_err err = ls_takedir_open(folder, &self->take, diag);
    return err ? err : ls_take_facts_read(self->take->take_json, self->camera, &self->facts, diag);
}

static enum ls_err check_planned(const struct condition_job *self, const char *name,
                                 struct ls_diag *diag)
{
    const struct ls_take_facts *facts = self->facts;
    for (uint32_t i = 0; i < facts->n_conditions; i++)
        if (!strcmp(facts->conditions[i].id, name))
            return facts->conditions[i].kind != LS_FACT_DARK
                       ? LS_OK
                       : ls_fail(diag, LS_ERR_NOT_FOUND, "%s is a dark, not a picture of lights",
                                 name);
    return ls_fail(diag, LS_ERR_NOT_FOUND, "the plan of take %s has no picture %.64s",
                   self->take_id, name);
}

static enum ls_err open_picture(struct condition_job *self, struct ls_diag *diag)
{
    const char *name = self->names[self->at];
    enum ls_err err = check_planned(self, name, diag);
    if (err)
        return err;
    const struct ls_published *p = ls_takedir_find(self->take, name, self->camera);
    if (!p)
        return ls_fail(diag, LS_ERR_STATE, "take %s lacks %s; resume it", self->take_id, name);
    self->region = self->asked;
    err = ls_picture_region_check(&self->region, p->width, p->height, diag);
    if (err)
        return err;
    self->published = p;
    self->map = g_atomic_rc_box_new0(struct ls_picture_map);
    return ls_picture_map_open(self->map, self->take->folder, p->file, p->width, p->height, diag);
}

static void describe(const struct condition_job *self, uint32_t n_rows,
                     Lightstage__FetchReply *body)
{
    lightstage__fetch_reply__init(body);
    body->light = (uint32_t)self->at;
    body->width = self->region.width;
    body->height = self->region.height;
    body->first_row = self->row;
    body->n_rows = n_rows;
    body->components = 1;
    body->sample = self->half ? LIGHTSTAGE__SAMPLE__HALF : LIGHTSTAGE__SAMPLE__FLOAT;
    body->reference_exposure_s = self->facts->reference_exposure_s;
    body->gain_k = 1;
    body->calibrated = self->facts->calibration != NULL;
}

static enum ls_err read_rows(struct condition_job *self, uint32_t n_rows, struct ls_chunk *chunk,
                             Lightstage__FetchReply *body, struct ls_diag *diag)
{
    const struct ls_demosaic_region *r = &self->region;
    chunk->payload_bytes = (size_t)r->width * n_rows * (self->half ? 2 : 4);
    chunk->payload = malloc(chunk->payload_bytes);
    if (!chunk->payload)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    if (self->half)
        ls_picture_map_read_half(self->map, r->x, r->y + self->row, r->width, n_rows,
                                 (uint16_t *)(void *)chunk->payload);
    else
        ls_picture_map_read(self->map, r->x, r->y + self->row, r->width, n_rows, 1,
                            (float *)(void *)chunk->payload);
    const struct ls_demosaic_region band = {r->x, r->y + self->row, r->width, n_rows};
    self->row += n_rows;
    return ls_pixel_quality_append(self->quality, self->map, self->facts, band, 1, chunk, body,
                                   diag);
}

static enum ls_err check_file(const struct condition_job *self, struct ls_diag *diag)
{
    if (!ls_picture_map_sound(self->map) || !ls_picture_map_whole(self->map))
        return ls_fail(diag, LS_ERR_INVALID, "%s: cut short, removed or unreadable",
                       self->map->path);
    return LS_OK;
}

static void next_picture(struct condition_job *self)
{
    self->row = 0;
    self->at++;
    drop_map(self->map);
    self->map = NULL;
}

static enum ls_err make_band(struct condition_job *self, struct ls_chunk *chunk,
                             Lightstage__FetchReply *body, struct ls_diag *diag)
{
    uint32_t rows = BAND_BYTES / (4 * self->region.width) + 1,
             left = self->region.height - self->row;
    rows = rows < left ? rows : left;
    describe(self, rows, body);
    return read_rows(self, rows, chunk, body, diag);
}

/* ---- in tiles ---- */

static void release_map(void *owner, void *map)
{
    drop_map(map);
}

/* Floats: a row of tiles at a time. */
static enum ls_err make_tiles(struct condition_job *self, struct ls_chunk *chunk,
                              Lightstage__FetchReply *body, bool *there, struct ls_diag *diag)
{
    enum ls_err err = ls_tiles_tell(&self->tiles, chunk, body, there, diag);
    if (err || *there)
        return err;
    struct ls_chunk values = {0};
    uint32_t left = self->region.height - self->row, y = self->region.y + self->row;
    uint32_t rows = left < LS_EXR_TILE_PX ? left : LS_EXR_TILE_PX;
    const struct ls_demosaic_region band = {self->region.x, y, self->region.width, rows};
    err = read_rows(self, rows, &values, body, diag);
    if (!err)
        err = ls_tiles_add(&self->tiles, band, values.payload, diag);
    ls_chunk_finish(&values);
    return err ? err : ls_tiles_take(&self->tiles, chunk, body, there, diag);
}

static enum ls_err next_tiles(struct condition_job *self, struct ls_chunk *chunk,
                              Lightstage__FetchReply *body, bool *there, struct ls_diag *diag)
{
    const struct ls_tiles_holder holder = {release_map, NULL, self->map};
    describe(self, 0, body);
    if (!self->half)
        return make_tiles(self, chunk, body, there, diag);
    g_atomic_rc_box_acquire(self->map);
    return ls_tiles_lend(&self->tiles, self->map, &holder, chunk, body, diag);
}

static double most_of(const void *user, uint32_t tile)
{
    const struct ls_published *p = ((const struct condition_job *)user)->published;
    return tile < p->n_tiles ? (double)ls_half_to_float((uint16_t)p->tile_max[tile]) : INFINITY;
}

/* *any: some of the picture's tiles are asked for. */
static enum ls_err begin_picture(struct condition_job *self, bool *any, struct ls_diag *diag)
{
    enum ls_err err = open_picture(self, diag);
    if (!err && self->tiles.wanted)
        err = ls_tiles_begin(&self->tiles, self->map->tiles.width, self->map->tiles.height,
                             self->half ? 2 : 4, &self->region, diag);
    self->tiles.bounds = (struct ls_tiles_bounds){.most = most_of, .user = self};
    *any = !err && self->region.height > 0;
    if (!err && !*any) {
        next_picture(self);
        if (self->at == self->n_names)
            err = ls_fail(diag, LS_ERR_LIMIT, "fetch: first_tile %u is beyond the last tile",
                          (unsigned)self->tiles.first);
    }
    return err;
}

static enum ls_err next_frame(struct condition_job *self, struct ls_chunk *chunk, bool *last,
                              struct ls_diag *diag)
{
    Lightstage__FetchReply body;
    bool any = true;
    enum ls_err err = self->map ? LS_OK : begin_picture(self, &any, diag);
    if (err || !any)
        return err;
    err = self->tiles.wanted ? next_tiles(self, chunk, &body, &any, diag)
                             : make_band(self, chunk, &body, diag);
    if (!err)
        err = check_file(self, diag);
    if (err || !any)
        return err;
    if (self->tiles.wanted ? ls_tiles_end(&self->tiles) : self->row == self->region.height)
        next_picture(self);
    *last = self->at == self->n_names;
    body.error_bound = *last ? self->tiles.error_bound : 0;
    size_t lent = chunk->lent ? chunk->lent->n_bytes : 0;
    return ls_message_frame(LS_MESSAGE_FETCH | LS_MESSAGE_REPLY, self->job.request,
                            *last ? LS_FRAME_LAST : 0, &body.base, chunk->payload_bytes + lent,
                            &chunk->head, &chunk->head_bytes, diag);
}

static enum ls_err condition_step(struct ls_job *job, struct ls_chunk *chunk, bool *last,
                                  struct ls_diag *diag)
{
    struct condition_job *self = (struct condition_job *)job;
    return self->take ? next_frame(self, chunk, last, diag) : open_take(self, diag);
}

/* ---- making ---- */

static enum ls_err check(const Lightstage__Fetch *fetch, struct ls_diag *diag)
{
    if (fetch->n_conditions > MAX_NAMES)
        return ls_fail(diag, LS_ERR_LIMIT, "fetch: %zu conditions, at most %d", fetch->n_conditions,
                       MAX_NAMES);
    if (fetch->channel[0] || fetch->n_lights || fetch->full_sphere || fetch->factored ||
        fetch->n_spectra)
        return ls_fail(diag, LS_ERR_INVALID,
                       "fetch: conditions take no channel, lights, spectra or full_sphere");
    if (fetch->promotion || fetch->model != LIGHTSTAGE__MODEL__MEASURED ||
        fetch->layout != LIGHTSTAGE__LAYOUT__MOSAIC || fetch->level ||
        fetch->quantity != LIGHTSTAGE__QUANTITY__ESTIMATE)
        return ls_fail(diag, LS_ERR_UNSUPPORTED,
                       "fetch: a condition comes as it is stored: ask for the estimate, measured, "
                       "as mosaic, full size");
    return LS_OK;
}

enum ls_err ls_condition_job_create(uint32_t request, const char *storage,
                                    const Lightstage__Fetch *fetch, struct ls_tiles *tiles,
                                    struct ls_job **out, struct ls_diag *diag)
{
    static const struct ls_job_ops ops = {"fetch conditions", condition_step, condition_destroy};
    enum ls_err err = check(fetch, diag);
    if (err)
        return err;
    struct condition_job *self = g_new0(struct condition_job, 1);
    self->job = (struct ls_job){.ops = &ops, .request = request};
    self->storage = storage;
    snprintf(self->take_id, sizeof self->take_id, "%s", fetch->take);
    self->job.take = self->take_id;
    self->camera = fetch->camera;
    self->half = fetch->sample == LIGHTSTAGE__SAMPLE__HALF;
    self->quality = ls_pixel_quality_of(fetch);
    self->tiles = *tiles;
    memset(tiles, 0, sizeof *tiles);
    self->asked = ls_picture_region_of(fetch->region);
    self->names = g_new0(char *, fetch->n_conditions + 1);
    self->n_names = fetch->n_conditions;
    for (size_t i = 0; i < fetch->n_conditions; i++)
        self->names[i] = g_strdup(fetch->conditions[i]);
    *out = &self->job;
    return LS_OK;
}
