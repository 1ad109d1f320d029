#include "daemon/field_pictures.h"

#include "core/half.h"
#include "daemon/field_multiplex.h"

#include <stdlib.h>
#include <string.h>

static enum ls_err out_of_memory(struct ls_diag *diag)
{
    return ls_fail(diag, LS_ERR_NOMEM, "out of memory opening a take's pictures");
}

static bool shows_lights(const struct ls_condition_fact *fact)
{
    return fact->kind != LS_FACT_OTHER && fact->kind != LS_FACT_DARK;
}

enum ls_err ls_field_pictures_map(struct ls_field_source *source, const struct ls_takedir *take,
                                  struct ls_diag *diag)
{
    const struct ls_take_facts *facts = source->facts;
    enum ls_err err = LS_OK;
    source->maps = calloc(facts->n_conditions, sizeof *source->maps);
    if (!source->maps)
        return out_of_memory(diag);
    for (uint32_t i = 0; i < facts->n_conditions && !err; i++) {
        const struct ls_condition_fact *fact = &facts->conditions[i];
        const struct ls_published *p =
            shows_lights(fact) ? ls_takedir_find(take, fact->id, source->camera) : NULL;
        if (!p)
            continue;
        if (source->width == 0) {
            source->width = p->width;
            source->height = p->height;
        }
        err = ls_picture_map_open(&source->maps[i], take->folder, p->file, source->width,
                                  source->height, diag);
    }
    if (!err && source->width == 0)
        return ls_fail(diag, LS_ERR_STATE, "take %s has no picture of any light yet", source->take);
    return err;
}

/* ---- spectra ---- */

/* What the plan asks for of each channel, and what is there. */
struct found {
    bool planned_one, any;
};

static void find(const struct ls_field_source *source, struct found found[LS_MAX_CHANNELS])
{
    for (uint32_t i = 0; i < source->facts->n_conditions; i++) {
        const struct ls_condition_fact *fact = &source->facts->conditions[i];
        if (!shows_lights(fact))
            continue;
        found[fact->channel].planned_one |=
            fact->kind == LS_FACT_ONE || fact->kind == LS_FACT_MULTIPLEX;
        found[fact->channel].any |= source->maps[i].base != NULL;
    }
}

static void find_polarisers(struct ls_field_source *source)
{
    const struct ls_take_facts *facts = source->facts;
    source->vertical = source->horizontal = -1;
    for (uint32_t c = facts->n_channels; c-- > 0;)
        if (facts->channels[c].polariser) {
            source->horizontal = source->vertical;
            source->vertical = (int32_t)c;
        }
    if (source->horizontal < 0)
        source->vertical = -1;
    int v = ls_take_facts_channel(facts, "V"), h = ls_take_facts_channel(facts, "H");
    if (v >= 0 && h >= 0 && facts->channels[v].polariser && facts->channels[h].polariser) {
        source->vertical = v;
        source->horizontal = h;
    }
}

enum ls_err ls_field_pictures_choose(struct ls_field_source *source, struct ls_diag *diag)
{
    const struct ls_take_facts *facts = source->facts;
    struct found found[LS_MAX_CHANNELS] = {0};
    uint32_t white = facts->n_channels, first = facts->n_channels, n = 0;
    find(source, found);
    find_polarisers(source);
    for (uint32_t c = facts->n_channels; c-- > 0;) {
        if (facts->channels[c].polariser)
            continue;
        first = c;
        if (found[c].planned_one)
            white = c;
    }
    source->white_is_polarised = white == facts->n_channels && source->vertical >= 0 &&
                                 found[source->vertical].planned_one &&
                                 found[source->horizontal].planned_one;
    if (source->white_is_polarised)
        white = first;
    if (white == facts->n_channels)
        return ls_fail(diag, LS_ERR_STATE, "take %s was not photographed light by light",
                       source->take);
    source->channel_of[n++] = white;
    for (uint32_t c = 0; c < facts->n_channels; c++)
        if (c != white && found[c].any && !facts->channels[c].polariser)
            source->channel_of[n++] = c;
    source->field.n_spectra = n;
    return LS_OK;
}

/* ---- in core's order ---- */

static uint32_t n_tiles(const struct ls_field_source *source)
{
    return ls_field_tiles_x(&source->field) * ls_field_tiles_y(&source->field);
}

static enum ls_err set_init(struct ls_field_source *source, struct ls_light_set *set, uint32_t n,
                            struct ls_diag *diag)
{
    set->n_pictures = n;
    set->pictures = calloc(n, sizeof *set->pictures);
    set->tile_max = calloc((size_t)n_tiles(source) * n, sizeof *set->tile_max);
    if (!set->pictures || !set->tile_max)
        return out_of_memory(diag);
    for (uint32_t j = 0; j < n; j++)
        set->pictures[j].tiles = source->no_tiles;
    return LS_OK;
}

static const void *const *tiles_of(const struct ls_picture_map *map)
{
    return (const void *const *)map->tiles.tile;
}

static enum ls_err set_add(struct ls_field_source *source, struct ls_light_set *set,
                           const struct ls_picture_map *map, const struct ls_published *p,
                           uint32_t at, struct ls_diag *diag)
{
    uint32_t n = n_tiles(source);
    if (p->n_tiles != n)
        return ls_fail(diag, LS_ERR_INVALID, "%s: the journal has %u tiles, expected %u", p->file,
                       p->n_tiles, n);
    set->n_found += set->pictures[at].tiles == source->no_tiles;
    set->pictures[at].tiles = tiles_of(map);
    for (uint32_t t = 0; t < n; t++)
        set->tile_max[(size_t)t * set->n_pictures + at] =
            ls_half_to_float((uint16_t)p->tile_max[t]);
    return LS_OK;
}

/* Light by light where every light was planned so or nothing else was, else multiplexed. */
static enum ls_err open_set(struct ls_field_source *source, uint32_t channel, struct ls_diag *diag)
{
    struct ls_light_set *set = &source->set[channel];
    struct ls_light_group *group = &set->group[0];
    enum ls_err err = ls_field_multiplex_find(source, channel, group, diag);
    if (err)
        return err;
    bool one = ls_field_source_planned(source, LS_FACT_ONE, channel, -1);
    if (!group->order && !one)
        return LS_OK;
    *group = (struct ls_light_group){
        .channel = channel,
        .order = group->order,
        .duty = group->duty,
        .scale = group->scale,
        .n = group->order ? group->order : source->field.n_lights,
    };
    set->n_groups = 1;
    return set_init(source, set, group->n, diag);
}

static enum ls_err gather_set(struct ls_field_source *source, const struct ls_takedir *take,
                              uint32_t channel, struct ls_diag *diag)
{
    struct ls_light_set *set = &source->set[channel];
    enum ls_err err = open_set(source, channel, diag);
    for (uint32_t i = 0; i < source->facts->n_conditions && !err && set->pictures; i++) {
        const struct ls_condition_fact *fact = &source->facts->conditions[i];
        bool row = set->group[0].order > 0;
        if (fact->channel != channel || !source->maps[i].base ||
            fact->kind != (row ? LS_FACT_MULTIPLEX : LS_FACT_ONE) ||
            (row && !ls_field_multiplex_belongs(set->group, fact)))
            continue;
        err =
            set_add(source, set, &source->maps[i], ls_takedir_find(take, fact->id, source->camera),
                    row ? fact->part : fact->light, diag);
    }
    return err;
}

/* Pictures of @from behind those already in white. */
static void append(struct ls_field_source *source, const struct ls_light_set *from)
{
    struct ls_light_set *white = &source->white;
    struct ls_light_group *group = &white->group[white->n_groups];
    *group = from->group[0];
    if (white->n_groups > 0)
        group->first = group[-1].first + group[-1].n;
    white->n_groups++;
    memcpy(white->pictures + group->first, from->pictures, group->n * sizeof *white->pictures);
    white->n_found += from->n_found;
    for (uint32_t t = 0; t < n_tiles(source); t++)
        memcpy(white->tile_max + (size_t)t * white->n_pictures + group->first,
               from->tile_max + (size_t)t * group->n, group->n * sizeof *white->tile_max);
}

static enum ls_err gather_white(struct ls_field_source *source, struct ls_diag *diag)
{
    const struct ls_light_set *first = &source->set[source->channel_of[0]], *second = NULL;
    if (source->white_is_polarised) {
        first = &source->set[source->vertical];
        second = &source->set[source->horizontal];
    }
    enum ls_err err = set_init(source, &source->white,
                               first->n_pictures + (second ? second->n_pictures : 0), diag);
    if (err)
        return err;
    append(source, first);
    if (second)
        append(source, second);
    source->field.white = source->white.pictures;
    return LS_OK;
}

enum ls_err ls_field_pictures_gather(struct ls_field_source *source, const struct ls_takedir *take,
                                     struct ls_diag *diag)
{
    struct ls_field *field = &source->field;
    source->sphere = calloc(field->n_spectra, sizeof *source->sphere);
    source->no_tiles = calloc(n_tiles(source), sizeof *source->no_tiles);
    if (!source->sphere || !source->no_tiles)
        return out_of_memory(diag);
    for (uint32_t s = 0; s < field->n_spectra; s++) {
        const struct ls_picture_map *map =
            ls_field_source_picture(source, source->channel_of[s], -1, NULL);
        source->has_sphere[s] = map != NULL;
        source->sphere[s].tiles = map ? tiles_of(map) : source->no_tiles;
    }
    field->sphere = source->sphere;
    enum ls_err err = LS_OK;
    for (uint32_t c = 0; c < source->facts->n_channels && !err; c++)
        err = gather_set(source, take, c, diag);
    return err ? err : gather_white(source, diag);
}

static void set_free(struct ls_light_set *set)
{
    free(set->pictures);
    free(set->tile_max);
}

void ls_field_pictures_free(struct ls_field_source *source)
{
    for (uint32_t i = 0; source->maps && i < source->facts->n_conditions; i++)
        ls_picture_map_finish(&source->maps[i]);
    for (uint32_t c = 0; c < LS_MAX_CHANNELS; c++) {
        set_free(&source->set[c]);
        free(source->set[c].group[0].scale); /* white's are the same */
    }
    set_free(&source->white);
    free(source->maps);
    free(source->sphere);
    free(source->no_tiles);
}
