#include "daemon/fetch_private.h"

#include "core/promote.h"
#include "daemon/light_set.h"

bool ls_fetch_is_coloured(const struct ls_fetch_job *self)
{
    return !self->estimate && self->now->way.set && ls_light_set_is_coloured(self->now->way.set);
}

bool ls_fetch_is_of_several(const struct ls_fetch_job *self)
{
    return self->now->way.kind != LS_WAY_PHOTOGRAPHED ||
           (self->now->way.set && ls_light_set_is_summed(self->now->way.set));
}

bool ls_fetch_is_promoted(const struct ls_fetch_job *self)
{
    return ls_fetch_is_of_several(self) || ls_fetch_is_coloured(self);
}

bool ls_fetch_is_promoted_as_halves(const struct ls_fetch_job *self)
{
    return self->half && self->rgb && !ls_reduction_any(&self->reduction) &&
           self->now->way.kind == LS_WAY_RATIO && !ls_fetch_is_coloured(self) &&
           !ls_light_set_is_summed(self->now->way.set);
}

bool ls_fetch_has_light(const struct ls_fetch_job *self, const struct ls_fetch_spectrum *spectrum,
                        uint32_t light)
{
    return !spectrum->way.set || ls_light_set_has(self->source, spectrum->way.set, light);
}

static enum ls_err sphere_picture(const struct ls_fetch_job *self, struct ls_fetch_picture *out,
                                  struct ls_diag *diag)
{
    int s = ls_field_source_spectrum(self->source, self->now->channel);
    const struct ls_field *field = &self->source->field;
    out->map = ls_field_source_picture(self->source, self->now->channel, -1, NULL);
    if (!out->map)
        return ls_fail(diag, LS_ERR_STATE, "take %s has no full sphere of channel %s", self->take,
                       self->now->name);
    if (self->estimate)
        return LS_OK;
    if (s < 0 || !self->source->has_sphere[s])
        return ls_fail(diag, LS_ERR_STATE,
                       "the full sphere of channel %s has no calibrated duty; fetch the estimate",
                       self->now->name);
    out->gain = ls_promote_sphere_factor(field, (uint32_t)s) * field->scale;
    return LS_OK;
}

/* The channel whose pictures a light is made of. */
static uint32_t shown_by(const struct ls_fetch_job *self)
{
    return self->now->way.kind == LS_WAY_PHOTOGRAPHED && self->now->way.set != &self->source->white
               ? self->now->channel
               : self->source->channel_of[0];
}

static enum ls_err check_light(const struct ls_fetch_job *self, uint32_t light,
                               struct ls_diag *diag)
{
    const struct ls_take_facts *facts = self->source->facts;
    if (light >= facts->n_lights)
        return ls_fail(diag, LS_ERR_NOT_FOUND, "light %u: the take has lights 0 to %u", light,
                       facts->n_lights - 1);
    if (ls_fetch_has_light(self, self->now, light))
        return LS_OK;
    uint32_t from = shown_by(self);
    bool planned = ls_field_source_planned(self->source, LS_FACT_ONE, from, light);
    return ls_fail(diag, planned ? LS_ERR_STATE : LS_ERR_NOT_FOUND,
                   "%s %s has no picture of light %u under %s",
                   planned ? "take" : "the plan of take", self->take, light,
                   facts->channels[from].name);
}

static enum ls_err light_picture(const struct ls_fetch_job *self, struct ls_fetch_picture *out,
                                 struct ls_diag *diag)
{
    uint32_t light = self->lights[self->light];
    enum ls_err err = check_light(self, light, diag);
    if (err)
        return err;
    uint32_t from = shown_by(self);
    out->map = ls_field_source_picture(self->source, from, light, NULL);
    bool sum = ls_fetch_is_of_several(self) && self->source->white_is_polarised;
    out->k = self->estimate || sum ? 1 : ls_field_source_gain(self->source, from, light);
    out->gain = self->estimate ? 1 : out->k * self->source->field.scale;
    return LS_OK;
}

enum ls_err ls_fetch_find_picture(const struct ls_fetch_job *self, struct ls_fetch_picture *out,
                                  struct ls_diag *diag)
{
    *out = (struct ls_fetch_picture){.gain = 1, .k = 1};
    if (self->full_sphere)
        return sphere_picture(self, out, diag);
    return ls_factored_is_ratio(&self->factored) ? LS_OK : light_picture(self, out, diag);
}
