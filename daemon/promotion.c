#include "daemon/promotion.h"

#include "daemon/light_set.h"
#include "daemon/separation.h"
#include "proto/models.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

enum ls_err ls_promotion_read(const Lightstage__Promotion *message, Lightstage__Model model,
                              struct ls_promotion *out, struct ls_diag *diag)
{
    *out = (struct ls_promotion){.model = model};
    if (message)
        *out = (struct ls_promotion){message->model, message->reference,
                                     message->ideal_polarisation, message->plain_conductors};
    if (!ls_model_name(out->model) || !ls_reference_name(out->reference))
        return ls_fail(diag, LS_ERR_UNSUPPORTED, "promotion: model %d, reference %d: not known",
                       (int)out->model, (int)out->reference);
    if (out->reference == LIGHTSTAGE__REFERENCE__PAPER && out->model != LIGHTSTAGE__MODEL__SPHERE)
        return ls_fail(diag, LS_ERR_UNSUPPORTED,
                       "promotion: reference paper divides by the photographed white sphere: it "
                       "belongs to model sphere, not %s",
                       ls_model_name(out->model));
    if ((out->ideal_polarisation || out->plain_conductors) &&
        out->model != LIGHTSTAGE__MODEL__SEPARATED)
        return ls_fail(diag, LS_ERR_UNSUPPORTED,
                       "promotion: options of polarised light belong to model separated, not %s",
                       ls_model_name(out->model));
    return LS_OK;
}

/* ---- ways ---- */

static enum ls_field_map_kind map_kind(const struct ls_promotion *promotion)
{
    switch (promotion->model) {
    case LIGHTSTAGE__MODEL__HEADLIGHT:
        return LS_MAP_HEADLIGHT;
    case LIGHTSTAGE__MODEL__LINEAR:
        return LS_MAP_LINEAR;
    case LIGHTSTAGE__MODEL__SEPARATED:
        return (enum ls_field_map_kind)(LS_MAP_SEPARATED + promotion->ideal_polarisation +
                                        2 * promotion->plain_conductors);
    default:
        return promotion->reference == LIGHTSTAGE__REFERENCE__PAPER ? LS_MAP_PAPER : LS_MAP_SPHERE;
    }
}

/* White is as it was photographed whatever the model; so is a spectrum of which each light was,
 * under MEASURED and LINEAR; of some lights only, LINEAR goes by the segments where there are any.
 */
static const struct ls_light_set *photographed(const struct ls_field_source *source,
                                               const struct ls_promotion *promotion,
                                               uint32_t channel)
{
    bool white = channel == source->channel_of[0];
    bool measured = promotion->model == LIGHTSTAGE__MODEL__MEASURED;
    if (white && !(measured && source->white_is_polarised))
        return &source->white;
    const struct ls_light_set *set = &source->set[channel];
    bool whole = set->n_found == set->n_pictures ||
                 !ls_field_source_planned(source, LS_FACT_SEGMENT, channel, -1);
    if (set->n_found > 0 && (measured || (promotion->model == LIGHTSTAGE__MODEL__LINEAR && whole)))
        return set;
    return NULL;
}

static enum ls_err not_measured(const struct ls_field_source *source, uint32_t channel,
                                struct ls_diag *diag)
{
    const char *name = source->facts->channels[channel].name;
    if (ls_field_source_planned(source, LS_FACT_ONE, channel, -1) ||
        ls_field_source_planned(source, LS_FACT_MULTIPLEX, channel, -1))
        return ls_fail(diag, LS_ERR_STATE, "take %s has no picture of a single light under %s yet",
                       source->take, name);
    return ls_fail(diag, LS_ERR_NOT_FOUND,
                   "the plan of take %s has no picture of a single light under %s (a condition of "
                   "kind \"each\" makes them)",
                   source->take, name);
}

static const char *needed_kind(Lightstage__Model model)
{
    return model == LIGHTSTAGE__MODEL__HEADLIGHT ? "headlight"
           : model == LIGHTSTAGE__MODEL__LINEAR  ? "segments"
                                                 : "sphere";
}

/* Everything about the way but its map. */
static enum ls_err choose(const struct ls_field_source *source,
                          const struct ls_promotion *promotion, uint32_t channel,
                          struct ls_way *out, struct ls_diag *diag)
{
    int s = ls_field_source_spectrum(source, channel);
    *out = (struct ls_way){.channel = channel, .spectrum = s < 0 ? 0 : (uint32_t)s};
    if (source->facts->channels[channel].polariser &&
        promotion->model != LIGHTSTAGE__MODEL__MEASURED)
        return ls_fail(diag, LS_ERR_UNSUPPORTED,
                       "channel %s is a polariser: it is photographed, never promoted",
                       source->facts->channels[channel].name);
    out->set = photographed(source, promotion, channel);
    if (out->set)
        return ls_light_set_ready(source, out->set, diag);
    if (promotion->model == LIGHTSTAGE__MODEL__MEASURED)
        return not_measured(source, channel, diag);
    if (s < 0)
        return ls_fail(diag, LS_ERR_NOT_FOUND,
                       "the plan of take %s has no picture of %s at all (conditions of kind \"%s\" "
                       "make what model %s needs)",
                       source->take, source->facts->channels[channel].name,
                       needed_kind(promotion->model), ls_model_name(promotion->model));
    out->kind = promotion->model == LIGHTSTAGE__MODEL__LINEAR      ? LS_WAY_MATRIX
                : promotion->model == LIGHTSTAGE__MODEL__SEPARATED ? LS_WAY_SEPARATED
                                                                   : LS_WAY_RATIO;
    if (out->kind == LS_WAY_RATIO)
        out->set = &source->white;
    return ls_field_maps_possible(source, map_kind(promotion), (uint32_t)s, diag);
}

/* "; for R it offers model sphere, model linear", or nothing. */
static void add_offers(const struct ls_field_source *source, uint32_t channel, struct ls_diag *diag)
{
    const char *name = source->facts->channels[channel].name;
    bool first = true;
    for (int m = 0; diag && ls_model_name((Lightstage__Model)m); m++) {
        const struct ls_promotion promotion = {.model = (Lightstage__Model)m};
        struct ls_way way;
        size_t used = strlen(diag->text), room = sizeof diag->text - used;
        if (choose(source, &promotion, channel, &way, NULL))
            continue;
        if (first)
            snprintf(diag->text + used, room, "; for %s it offers model %s", name,
                     ls_model_name((Lightstage__Model)m));
        else
            snprintf(diag->text + used, room, ", model %s", ls_model_name((Lightstage__Model)m));
        first = false;
    }
}

enum ls_err ls_promotion_find(struct ls_field_source *source, const struct ls_promotion *promotion,
                              uint32_t channel, const struct ls_job *asker, struct ls_way *out,
                              struct ls_diag *diag)
{
    enum ls_err err = choose(source, promotion, channel, out, diag);
    if (err == LS_ERR_STATE || err == LS_ERR_NOT_FOUND || err == LS_ERR_UNSUPPORTED)
        add_offers(source, channel, diag);
    if (err || out->kind == LS_WAY_PHOTOGRAPHED)
        return err;
    err = ls_field_maps_get(source, map_kind(promotion), out->spectrum, asker, &out->map, diag);
    if (!err && out->kind == LS_WAY_MATRIX && out->map->n_inputs == 0) {
        out->kind = LS_WAY_BLEND;
        out->set = &source->white;
    }
    return err;
}

/* The worse of two groups. */
static void report_multiplexed(const struct ls_field_source *source, const struct ls_way *way,
                               Lightstage__SpectrumReport *out)
{
    const struct ls_light_set *set = way->set ? way->set : &source->white;
    for (uint32_t g = 0; g < set->n_groups; g++) {
        const struct ls_multiplex_spare *spare = set->group[g].spare;
        if (set->group[g].order > 0)
            out->multiplexed = set->group[g].order;
        if (spare && fabs(spare->mean) >= out->spare_deviation * spare->sigma) {
            out->spare_deviation = spare->sigma > 0 ? fabs(spare->mean) / spare->sigma : 0;
            out->spare_alarm |= spare->alarm;
        }
    }
}

void ls_promotion_report(const struct ls_field_source *source, const struct ls_promotion *promotion,
                         const struct ls_way *way, Lightstage__SpectrumReport *out)
{
    lightstage__spectrum_report__init(out);
    out->channel = (char *)source->facts->channels[way->channel].name;
    report_multiplexed(source, way, out);
    if (way->kind == LS_WAY_PHOTOGRAPHED)
        return;
    out->model = promotion->model;
    out->reference = promotion->reference;
    out->blended = way->kind == LS_WAY_BLEND;
    out->segments = way->map->n_segments;
    out->left_out_error = way->map->left_out_error;
    out->left_out_share = way->map->left_out_share;
    out->checked_lights = way->map->n_checked;
    out->checked_error = way->map->checked_error;
    out->highlight_error = way->map->highlight_error;
    out->highlight_share = way->map->highlight_share;
    out->inseparable_lights = way->map->n_inseparable;
}
