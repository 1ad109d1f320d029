#include "daemon/fetch_private.h"

#include "daemon/picture_region.h"

#include <stdio.h>
#include <stdlib.h>

/* Under every spectrum? */
static bool has_light(const struct ls_fetch_job *self, uint32_t light)
{
    bool all = true;
    for (uint32_t s = 0; s < self->n_spectra; s++)
        all &= ls_fetch_has_light(self, &self->spectra[s], light);
    return all;
}

static enum ls_err choose_lights(struct ls_fetch_job *self, struct ls_diag *diag)
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
        return ls_fail(diag, LS_ERR_STATE, "take %s has no picture of a single light under %s%s",
                       self->take, self->spectra[0].name,
                       self->n_spectra > 1 ? " and the other spectra" : "");
    return LS_OK;
}

/* One picture has a validity and a variance, a sum of several has none. */
static enum ls_err check_quality(const struct ls_fetch_job *self, struct ls_diag *diag)
{
    const struct ls_pixel_quality *q = &self->quality;
    if ((q->variance || q->validity) && ls_fetch_is_of_several(self))
        return ls_fail(diag, LS_ERR_UNSUPPORTED,
                       "fetch: a light of %s is a sum of several pictures of take %s: validity and "
                       "variance are those of its `conditions`",
                       self->now->name, self->take);
    if (q->variance && ls_fetch_is_coloured(self))
        return ls_fail(
            diag, LS_ERR_UNSUPPORTED,
            "fetch: the gains of %s differ by the camera's colours: ask for the variance "
            "of the estimate",
            self->now->name);
    return LS_OK;
}

static enum ls_err check_layout(struct ls_fetch_job *self, struct ls_diag *diag)
{
    if (self->mono)
        return ls_reduction_make_mono(&self->reduction, self->source->facts, diag);
    if (self->reduction.level > 0 && !self->rgb && self->source->field.n_channels > 1)
        return ls_fail(diag, LS_ERR_UNSUPPORTED,
                       "fetch: a mosaic of colours has no level but 0; ask for rgb or mono");
    return LS_OK;
}

/* A factored fetch is of white. */
static enum ls_err find_channel(struct ls_fetch_job *self, struct ls_diag *diag)
{
    const struct ls_take_facts *facts = self->source->facts;
    if (self->factored.wanted)
        snprintf(self->now->name, sizeof self->now->name, "%s",
                 facts->channels[self->source->channel_of[0]].name);
    int channel = ls_take_facts_channel(facts, self->now->name);
    if (channel < 0)
        return ls_fail(diag, LS_ERR_NOT_FOUND, "take %s has no channel \"%.32s\"", self->take,
                       self->now->name);
    self->now->channel = (uint32_t)channel;
    return LS_OK;
}

static enum ls_err find_channels(struct ls_fetch_job *self, struct ls_diag *diag)
{
    enum ls_err err = LS_OK;
    for (uint32_t s = 0; s < self->n_spectra && !err; s++) {
        self->now = &self->spectra[s];
        err = find_channel(self, diag);
    }
    self->now = self->spectra;
    return err;
}

/* Maps are there when this is called again. */
static enum ls_err find_ways(struct ls_fetch_job *self, struct ls_diag *diag)
{
    enum ls_err err = LS_OK;
    for (uint32_t s = 0; s < self->n_spectra && !err; s++) {
        self->now = &self->spectra[s];
        if (!self->full_sphere)
            err = ls_promotion_find(self->source, &self->promotion, self->now->channel, &self->job,
                                    &self->now->way, diag);
        if (!err)
            err = check_quality(self, diag);
    }
    self->now = self->spectra;
    return err;
}

enum ls_err ls_fetch_start(struct ls_fetch_job *self, struct ls_diag *diag)
{
    enum ls_err err = self->source ? LS_OK /* it waited for maps */
                                   : ls_field_cache_get(self->cache, self->take, self->camera,
                                                        &self->source, diag);
    if (err)
        return err;
    err = find_channels(self, diag);
    if (!err)
        err =
            ls_picture_region_check(&self->asked, self->source->width, self->source->height, diag);
    if (!err)
        err = check_layout(self, diag);
    if (!err)
        err = find_ways(self, diag);
    if (!err && self->factored.wanted)
        err = ls_factored_find(&self->factored, self->source, &self->promotion, &self->now->way,
                               &self->job, diag);
    if (!err)
        err = choose_lights(self, diag);
    if (!err)
        self->asked = ls_level_region(self->asked, self->reduction.level);
    self->region = self->asked;
    self->started = !err;
    return err;
}
