#include "daemon/field_maps_private.h"

#include "core/half.h"
#include "daemon/field_segments.h"
#include "daemon/light_set.h"
#include "daemon/separated_maps.h"

#include <stdlib.h>

enum ls_err ls_field_maps_create(struct ls_field_maps **out, struct ls_diag *diag)
{
    struct ls_field_maps *maps = calloc(1, sizeof *maps);
    if (!maps)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory opening a take's field");
    g_mutex_init(&maps->lock);
    g_cond_init(&maps->made);
    *out = maps;
    return LS_OK;
}

void ls_map_entry_finish(struct ls_map_entry *entry)
{
    ls_map_file_finish(&entry->file);
    ls_map_file_finish(&entry->halves);
    free(entry->map.phi);
    *entry = (struct ls_map_entry){0};
}

void ls_field_maps_destroy(struct ls_field_maps *maps)
{
    if (!maps)
        return;
    for (int kind = 0; kind < LS_MAP_KINDS; kind++)
        for (int s = 0; s < LS_FIELD_MAX_SPECTRA; s++)
            ls_map_entry_finish(&maps->entry[kind][s]);
    g_cond_clear(&maps->made);
    g_mutex_clear(&maps->lock);
    free(maps);
}

enum ls_err ls_map_entry_open(const struct ls_field_source *source, struct ls_map_entry *entry,
                              uint32_t depth, struct ls_diag *diag)
{
    size_t floats = (size_t)source->width * source->height * depth;
    entry->map.depth = depth;
    return ls_map_file_create(&entry->file, source->storage, floats * sizeof(float),
                              source->spare_bytes, diag);
}

void ls_map_entry_settle(struct ls_field_source *source, enum ls_err err, struct ls_map_entry *made,
                         struct ls_map_entry *place)
{
    if (err) {
        ls_map_entry_finish(made);
        return;
    }
    made->map.values = made->file.base;
    g_mutex_lock(&source->promoted->lock);
    *place = *made;
    g_mutex_unlock(&source->promoted->lock);
}

/* ---- what is there ---- */

static const char *name_of(const struct ls_field_source *source, uint32_t s)
{
    return source->facts->channels[source->channel_of[s]].name;
}

static enum ls_err need_sphere(const struct ls_field_source *source, uint32_t s,
                               struct ls_diag *diag)
{
    if (source->has_sphere[s])
        return LS_OK;
    if (ls_field_source_picture(source, source->channel_of[s], -1, NULL))
        return ls_field_source_uncalibrated(source, "the full sphere", source->channel_of[s],
                                            "sphere", source->duty[s], diag);
    if (ls_field_source_planned(source, LS_FACT_SPHERE, source->channel_of[s], -1))
        return ls_fail(diag, LS_ERR_STATE,
                       "take %s lacks the picture of the full sphere of %s; resume the take",
                       source->take, name_of(source, s));
    return ls_fail(diag, LS_ERR_NOT_FOUND,
                   "the plan of take %s has no full sphere of %s (a condition of kind \"sphere\" "
                   "makes one)",
                   source->take, name_of(source, s));
}

static enum ls_err need_white(const struct ls_field_source *source, uint32_t s,
                              struct ls_diag *diag)
{
    enum ls_err err = ls_light_set_ready(source, &source->white, diag);
    if (err)
        return err;
    if (source->white.n_found == source->white.n_pictures)
        return LS_OK;
    return ls_fail(diag, LS_ERR_STATE,
                   "take %s has %u of %u pictures of single lights: promotion to %s needs all; "
                   "resume the take",
                   source->take, source->white.n_found, source->white.n_pictures,
                   name_of(source, s));
}

enum ls_err ls_field_maps_possible(const struct ls_field_source *source,
                                   enum ls_field_map_kind kind, uint32_t s, struct ls_diag *diag)
{
    struct ls_field_segments segments;
    struct ls_field_headlight headlight;
    enum ls_err err = LS_OK;
    switch (kind) {
    case LS_MAP_PAPER:
        err = need_sphere(source, 0, diag);
        return err ? err : need_sphere(source, s, diag);
    case LS_MAP_HEADLIGHT:
        err = ls_field_headlight_find(source, source->channel_of[s], &headlight, diag);
        break;
    case LS_MAP_LINEAR:
        err = ls_field_segments_find(source, source->channel_of[s], &segments, diag);
        break;
    case LS_MAP_SPHERE:
        err = need_sphere(source, s, diag);
        break;
    default:
        err = ls_separation_possible(source, diag);
        return err ? err : need_sphere(source, s, diag);
    }
    return err ? err : need_white(source, s, diag);
}

/* ---- asking ---- */

static enum ls_err make(struct ls_field_source *source, enum ls_field_map_kind kind, uint32_t s,
                        const struct ls_job *asker, struct ls_diag *diag)
{
    return kind == LS_MAP_LINEAR ? ls_field_maps_make_matrices(source, s, asker, diag)
                                 : ls_field_maps_make_ratios(source, kind, asker, diag);
}

/* With the lock held: the map, or the turn to make it. A job of a pool does not wait here. */
static enum ls_err take_turn(struct ls_field_maps *maps, const struct ls_field_map *map,
                             const struct ls_job *asker, struct ls_diag *diag)
{
    while (!map->values && maps->making) {
        if (asker && asker->pool)
            return ls_fail(diag, LS_ERR_BUSY, "another request makes maps of this take");
        g_cond_wait(&maps->made, &maps->lock);
    }
    maps->making |= !map->values;
    return LS_OK;
}

static enum ls_err make_in_turn(struct ls_field_source *source, enum ls_field_map_kind kind,
                                uint32_t s, const struct ls_job *asker, struct ls_diag *diag)
{
    struct ls_field_maps *maps = source->promoted;
    enum ls_err err = make(source, kind, s, asker, diag);
    g_mutex_lock(&maps->lock);
    maps->making = false;
    g_cond_broadcast(&maps->made);
    g_mutex_unlock(&maps->lock);
    ls_job_wake_others(asker);
    return err;
}

enum ls_err ls_field_maps_get(struct ls_field_source *source, enum ls_field_map_kind kind,
                              uint32_t s, const struct ls_job *asker,
                              const struct ls_field_map **out, struct ls_diag *diag)
{
    struct ls_field_maps *maps = source->promoted;
    struct ls_field_map *map = &maps->entry[kind][s].map;
    enum ls_err err = ls_field_maps_possible(source, kind, s, diag);
    if (err)
        return err;
    g_mutex_lock(&maps->lock);
    err = take_turn(maps, map, asker, diag);
    bool ours = !err && !map->values;
    g_mutex_unlock(&maps->lock);
    if (ours)
        err = make_in_turn(source, kind, s, asker, diag);
    if (!err)
        err = ls_field_source_sound(source, false, diag);
    *out = map;
    return err;
}

/* ---- in halves ---- */

enum { SIDE = LS_TILE_SIDE };

static void halve_tile(const struct ls_field *field, const float *values, uint32_t x, uint32_t y,
                       uint16_t *out)
{
    uint32_t w = field->width - x < SIDE ? field->width - x : SIDE;
    uint32_t h = field->height - y < SIDE ? field->height - y : SIDE;
    size_t row = (size_t)w * field->n_channels, stride = (size_t)field->width * field->n_channels;
    for (uint32_t r = 0; r < h; r++)
        ls_half_from_floats(values + (y + r) * stride + (size_t)x * field->n_channels,
                            out + r * row, row);
}

static void halve(const struct ls_field *field, const float *values, uint16_t *out)
{
    for (uint32_t y = 0; y < field->height; y += SIDE)
        for (uint32_t x = 0; x < field->width; x += SIDE, out += SIDE * SIDE * field->n_channels)
            halve_tile(field, values, x, y, out);
}

const uint16_t *ls_field_maps_halves(struct ls_field_source *source, const struct ls_field_map *map)
{
    const struct ls_field *field = &source->field;
    struct ls_map_entry *entry = (struct ls_map_entry *)map; /* its first member */
    size_t n =
        (size_t)ls_field_tiles_x(field) * ls_field_tiles_y(field) * SIDE * SIDE * field->n_channels;
    g_mutex_lock(&source->promoted->lock);
    if (!entry->halves.base && !ls_map_file_create(&entry->halves, source->storage,
                                                   n * sizeof(uint16_t), source->spare_bytes, NULL))
        halve(field, map->values, entry->halves.base);
    const uint16_t *halves = entry->halves.base;
    g_mutex_unlock(&source->promoted->lock);
    return halves;
}
