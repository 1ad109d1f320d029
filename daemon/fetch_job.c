#include "daemon/fetch_job.h"

#include "daemon/fetch_private.h"
#include "daemon/picture_region.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static void fetch_destroy(struct ls_job *job)
{
    struct ls_fetch_job *self = (struct ls_fetch_job *)job;
    ls_render_close(self->render);
    if (self->source)
        ls_field_cache_put(self->cache, self->source);
    ls_tiles_finish(&self->tiles);
    ls_reduction_finish(&self->reduction);
    free(self->lights);
    for (uint32_t s = 0; s < self->n_spectra; s++)
        free(self->spectra[s].ratio_most);
    g_free(self);
}

static enum ls_err next_frame(struct ls_fetch_job *self, struct ls_chunk *chunk, bool *last,
                              struct ls_diag *diag)
{
    struct ls_fetch_picture picture;
    enum ls_err err = ls_fetch_find_picture(self, &picture, diag);
    if (err)
        return err;
    return self->tiles.wanted ? ls_fetch_next_tiles(self, &picture, chunk, last, diag)
                              : ls_fetch_next_rows(self, &picture, chunk, last, diag);
}

static enum ls_err fetch_step(struct ls_job *job, struct ls_chunk *chunk, bool *last,
                              struct ls_diag *diag)
{
    struct ls_fetch_job *self = (struct ls_fetch_job *)job;
    enum ls_err err =
        self->started ? next_frame(self, chunk, last, diag) : ls_fetch_start(self, diag);
    return err ? err : ls_field_source_sound(self->source, *last, diag);
}

/* ---- making ---- */

/* A channel, or spectra; what is factored has its own rule. */
static enum ls_err check_names(const Lightstage__Fetch *fetch, struct ls_diag *diag)
{
    bool named = fetch->channel[0] ? fetch->n_spectra == 0 && strlen(fetch->channel) < 32
                                   : fetch->n_spectra > 0;
    for (size_t s = 0; s < fetch->n_spectra; s++)
        named &= strlen(fetch->spectra[s]) >= 1 && strlen(fetch->spectra[s]) < 32;
    if (!fetch->factored && !named)
        return ls_fail(diag, LS_ERR_INVALID, "fetch: expected the name of a channel, or spectra");
    if (fetch->n_spectra > LS_FIELD_MAX_SPECTRA)
        return ls_fail(diag, LS_ERR_INVALID, "fetch: %zu spectra, at most %d", fetch->n_spectra,
                       LS_FIELD_MAX_SPECTRA);
    return LS_OK;
}

static enum ls_err check(const Lightstage__Fetch *fetch, struct ls_diag *diag)
{
    enum ls_err err = check_names(fetch, diag);
    if (err)
        return err;
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

static void name_spectra(struct ls_fetch_job *self, const Lightstage__Fetch *fetch)
{
    bool several = fetch->n_spectra > 0 && !fetch->factored;
    self->now = self->spectra;
    self->n_spectra = several ? (uint32_t)fetch->n_spectra : 1;
    for (uint32_t s = 0; s < self->n_spectra; s++)
        snprintf(self->spectra[s].name, sizeof self->spectra[s].name, "%s",
                 several ? fetch->spectra[s] : fetch->channel);
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
    struct ls_fetch_job *self = g_new0(struct ls_fetch_job, 1);
    self->job = (struct ls_job){.ops = &ops, .request = request};
    self->cache = cache;
    snprintf(self->take, sizeof self->take, "%s", fetch->take);
    self->job.take = self->take;
    name_spectra(self, fetch);
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
