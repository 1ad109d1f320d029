#include "daemon/field_segments.h"

#include <string.h>

static const char *name_of(const struct ls_field_source *source, uint32_t channel)
{
    return source->facts->channels[channel].name;
}

static const void *const *tiles_of(const struct ls_picture_map *map)
{
    return (const void *const *)map->tiles.tile;
}

static enum ls_err uncalibrated(const struct ls_field_source *source,
                                const struct ls_condition_fact *fact, struct ls_diag *diag)
{
    return ls_field_source_uncalibrated(source, fact->id, fact->channel, fact->pattern, fact->duty,
                                        diag);
}

static enum ls_err missing(const struct ls_field_source *source,
                           const struct ls_condition_fact *fact, struct ls_diag *diag)
{
    return ls_fail(diag, LS_ERR_STATE, "take %s lacks the picture %s; resume the take",
                   source->take, fact->id);
}

/* ---- segments ---- */

/* Divisions are told apart by their pattern; lists of lights are one, however long each is. */
static bool same_division(const struct ls_condition_fact *a, const struct ls_condition_fact *b)
{
    bool lists = strncmp(a->pattern, "lights-", 7) == 0 && strncmp(b->pattern, "lights-", 7) == 0;
    return a->kind == LS_FACT_SEGMENT && b->kind == LS_FACT_SEGMENT && a->channel == b->channel &&
           (lists || strcmp(a->pattern, b->pattern) == 0);
}

static enum ls_err add(const struct ls_field_source *source, uint32_t condition,
                       struct ls_field_segments *out, struct ls_diag *diag)
{
    const struct ls_condition_fact *fact = &source->facts->conditions[condition];
    if (!source->maps[condition].base)
        return missing(source, fact, diag);
    if (out->n == LS_FIELD_MAX_SEGMENTS)
        return ls_fail(diag, LS_ERR_LIMIT,
                       "take %s has more than %d segments of %s: too many to fit at once; take a "
                       "coarser division",
                       source->take, LS_FIELD_MAX_SEGMENTS, name_of(source, fact->channel));
    out->pictures[out->n].tiles = tiles_of(&source->maps[condition]);
    out->factor[out->n] = ls_field_source_factor(source, fact);
    if (!(out->factor[out->n] > 0))
        return uncalibrated(source, fact, diag);
    for (uint32_t j = 0; j < fact->n_lights; j++) {
        uint32_t light = fact->lights[j];
        if (out->segment[light] != UINT32_MAX)
            return ls_fail(
                diag, LS_ERR_STATE,
                "take %s: light %u is in two segments of %s: they do not divide the dome",
                source->take, light, name_of(source, fact->channel));
        out->segment[light] = out->n;
    }
    out->n++;
    return LS_OK;
}

static enum ls_err gather(const struct ls_field_source *source, uint32_t first,
                          struct ls_field_segments *out, struct ls_diag *diag)
{
    const struct ls_take_facts *facts = source->facts;
    enum ls_err err = LS_OK;
    out->n = 0;
    for (uint32_t i = 0; i < facts->n_lights; i++)
        out->segment[i] = UINT32_MAX;
    for (uint32_t i = 0; i < facts->n_conditions && !err; i++)
        if (same_division(&facts->conditions[first], &facts->conditions[i]))
            err = add(source, i, out, diag);
    for (uint32_t i = 0; i < facts->n_lights && !err; i++)
        if (out->segment[i] == UINT32_MAX)
            err = ls_fail(diag, LS_ERR_STATE,
                          "take %s: light %u is in no segment of %s: they do not divide the dome",
                          source->take, i, name_of(source, facts->conditions[first].channel));
    return err;
}

/* Is this the first condition of its division? */
static bool opens(const struct ls_take_facts *facts, uint32_t condition)
{
    for (uint32_t i = 0; i < condition; i++)
        if (same_division(&facts->conditions[condition], &facts->conditions[i]))
            return false;
    return facts->conditions[condition].kind == LS_FACT_SEGMENT;
}

enum ls_err ls_field_segments_find(const struct ls_field_source *source, uint32_t channel,
                                   struct ls_field_segments *out, struct ls_diag *diag)
{
    const struct ls_take_facts *facts = source->facts;
    uint32_t best = UINT32_MAX, most = 0, tried = 0;
    enum ls_err err = LS_OK;
    for (uint32_t i = 0; i < facts->n_conditions; i++) {
        if (facts->conditions[i].channel != channel || !opens(facts, i))
            continue;
        tried++;
        enum ls_err failed = gather(source, i, out, diag);
        if (!failed && out->n > most) {
            most = out->n;
            best = i;
        }
        err = err ? err : failed;
    }
    if (best != UINT32_MAX)
        return gather(source, best, out, diag);
    if (tried == 0)
        return ls_fail(diag, LS_ERR_NOT_FOUND,
                       "the plan of take %s has no segments of %s (conditions of kind \"segments\" "
                       "make them)",
                       source->take, name_of(source, channel));
    return err;
}

/* ---- head light ---- */

static double distance2(const float a[3], const float b[3])
{
    double sum = 0;
    for (int i = 0; i < 3; i++)
        sum += ((double)a[i] - (double)b[i]) * ((double)a[i] - (double)b[i]);
    return sum;
}

/* Ties to the lower row. */
static void find_nearest(const struct ls_take_facts *facts, struct ls_field_headlight *out)
{
    out->n_lights = 0;
    while (out->n_lights < LS_HEADLIGHT_LIGHTS && out->n_lights < facts->n_lights) {
        uint32_t best = UINT32_MAX;
        for (uint32_t i = 0; i < facts->n_lights; i++) {
            bool taken = false;
            for (uint32_t j = 0; j < out->n_lights; j++)
                taken |= out->nearest[j] == i;
            if (!taken && (best == UINT32_MAX ||
                           distance2(facts->position_m[i], facts->camera_position_m) <
                               distance2(facts->position_m[best], facts->camera_position_m)))
                best = i;
        }
        out->nearest[out->n_lights++] = best;
    }
    out->lights = out->nearest;
}

static enum ls_err from_single_lights(const struct ls_field_source *source, uint32_t channel,
                                      struct ls_field_headlight *out, struct ls_diag *diag)
{
    find_nearest(source->facts, out);
    for (out->n = 0; out->n < out->n_lights; out->n++) {
        const struct ls_picture_map *map =
            ls_field_source_picture(source, channel, out->nearest[out->n], NULL);
        if (!map)
            return ls_fail(
                diag, LS_ERR_NOT_FOUND,
                "take %s has no head light of %s (a condition of kind \"headlight\" makes "
                "one), nor %s of light %u near the camera",
                source->take, name_of(source, channel), name_of(source, channel),
                out->nearest[out->n]);
        out->pictures[out->n].tiles = tiles_of(map);
        out->factor[out->n] = 1;
    }
    return LS_OK;
}

enum ls_err ls_field_headlight_find(const struct ls_field_source *source, uint32_t channel,
                                    struct ls_field_headlight *out, struct ls_diag *diag)
{
    const struct ls_take_facts *facts = source->facts;
    enum ls_err err = LS_ERR_NOT_FOUND;
    for (uint32_t i = 0; i < facts->n_conditions; i++) {
        const struct ls_condition_fact *fact = &facts->conditions[i];
        if (fact->kind != LS_FACT_HEADLIGHT || fact->channel != channel)
            continue;
        *out = (struct ls_field_headlight){.n = 1,
                                           .lights = fact->lights,
                                           .n_lights = fact->n_lights,
                                           .factor = {ls_field_source_factor(source, fact)}};
        out->pictures[0].tiles = source->maps[i].base ? tiles_of(&source->maps[i]) : NULL;
        if (out->pictures[0].tiles && out->factor[0] > 0)
            return LS_OK;
        err =
            out->pictures[0].tiles ? uncalibrated(source, fact, diag) : missing(source, fact, diag);
    }
    return err == LS_ERR_NOT_FOUND ? from_single_lights(source, channel, out, diag) : err;
}
