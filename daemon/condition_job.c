#include "daemon/condition_job.h"

#include "daemon/picture_map.h"
#include "daemon/picture_region.h"
#include "daemon/pixel_quality.h"
#include "daemon/take_facts.h"
#include "daemon/takedir.h"
#include "proto/frame.h"
#include "proto/message.h"

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
    struct ls_picture_map map; /* of the current name, from its first band to its last */
};

static void condition_destroy(struct ls_job *job)
{
    struct condition_job *self = (struct condition_job *)job;
    ls_picture_map_finish(&self->map);
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
    return err ? err
               : ls_picture_map_open(&self->map, self->take->folder, p->file, p->width, p->height,
                                     diag);
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

static enum ls_err read_rows(const struct condition_job *self, uint32_t n_rows,
                             struct ls_chunk *chunk, Lightstage__FetchReply *body,
                             struct ls_diag *diag)
{
    const struct ls_demosaic_region *r = &self->region;
    chunk->payload_bytes = (size_t)r->width * n_rows * (self->half ? 2 : 4);
    chunk->payload = malloc(chunk->payload_bytes);
    if (!chunk->payload)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    if (self->half)
        ls_picture_map_read_half(&self->map, r->x, r->y + self->row, r->width, n_rows,
                                 (uint16_t *)(void *)chunk->payload);
    else
        ls_picture_map_read(&self->map, r->x, r->y + self->row, r->width, n_rows, 1,
                            (float *)(void *)chunk->payload);
    const struct ls_demosaic_region band = {r->x, r->y + self->row, r->width, n_rows};
    enum ls_err err =
        ls_pixel_quality_append(self->quality, &self->map, self->facts, band, 1, chunk, body, diag);
    if (err)
        return err;
    if (!ls_picture_map_sound(&self->map) || !ls_picture_map_whole(&self->map))
        return ls_fail(diag, LS_ERR_INVALID, "%s: cut short, removed or unreadable",
                       self->map.path);
    return LS_OK;
}

static void advance(struct condition_job *self, uint32_t n_rows)
{
    self->row += n_rows;
    if (self->row < self->region.height)
        return;
    self->row = 0;
    self->at++;
    ls_picture_map_finish(&self->map);
    self->map = (struct ls_picture_map){0};
}

static enum ls_err make_band(struct condition_job *self, struct ls_chunk *chunk, bool *last,
                             struct ls_diag *diag)
{
    Lightstage__FetchReply body;
    enum ls_err err = self->map.base ? LS_OK : open_picture(self, diag);
    if (err)
        return err;
    uint32_t rows = BAND_BYTES / (4 * self->region.width) + 1,
             left = self->region.height - self->row;
    rows = rows < left ? rows : left;
    describe(self, rows, &body);
    err = read_rows(self, rows, chunk, &body, diag);
    if (err)
        return err;
    advance(self, rows);
    *last = self->at == self->n_names;
    return ls_message_frame(LS_MESSAGE_FETCH | LS_MESSAGE_REPLY, self->job.request,
                            *last ? LS_FRAME_LAST : 0, &body.base, chunk->payload_bytes,
                            &chunk->head, &chunk->head_bytes, diag);
}

static enum ls_err condition_step(struct ls_job *job, struct ls_chunk *chunk, bool *last,
                                  struct ls_diag *diag)
{
    struct condition_job *self = (struct condition_job *)job;
    return self->take ? make_band(self, chunk, last, diag) : open_take(self, diag);
}

/* ---- making ---- */

static enum ls_err check(const Lightstage__Fetch *fetch, struct ls_diag *diag)
{
    if (fetch->n_conditions > MAX_NAMES)
        return ls_fail(diag, LS_ERR_LIMIT, "fetch: %zu conditions, at most %d", fetch->n_conditions,
                       MAX_NAMES);
    if (fetch->channel[0] || fetch->n_lights || fetch->full_sphere)
        return ls_fail(diag, LS_ERR_INVALID,
                       "fetch: conditions take no channel, lights or full_sphere");
    if (fetch->promotion || fetch->model != LIGHTSTAGE__MODEL__MEASURED ||
        fetch->layout != LIGHTSTAGE__LAYOUT__MOSAIC ||
        fetch->quantity != LIGHTSTAGE__QUANTITY__ESTIMATE)
        return ls_fail(diag, LS_ERR_UNSUPPORTED,
                       "fetch: a condition comes as it is stored: ask for the estimate, measured, "
                       "as mosaic");
    return LS_OK;
}

enum ls_err ls_condition_job_create(uint32_t request, const char *storage,
                                    const Lightstage__Fetch *fetch, struct ls_job **out,
                                    struct ls_diag *diag)
{
    static const struct ls_job_ops ops = {"fetch conditions", condition_step, condition_destroy};
    enum ls_err err = check(fetch, diag);
    if (err)
        return err;
    struct condition_job *self = g_new0(struct condition_job, 1);
    self->job = (struct ls_job){.ops = &ops, .request = request};
    self->storage = storage;
    snprintf(self->take_id, sizeof self->take_id, "%s", fetch->take);
    self->camera = fetch->camera;
    self->half = fetch->sample == LIGHTSTAGE__SAMPLE__HALF;
    self->quality = ls_pixel_quality_of(fetch);
    self->asked = ls_picture_region_of(fetch->region);
    self->names = g_new0(char *, fetch->n_conditions + 1);
    self->n_names = fetch->n_conditions;
    for (size_t i = 0; i < fetch->n_conditions; i++)
        self->names[i] = g_strdup(fetch->conditions[i]);
    *out = &self->job;
    return LS_OK;
}
