#include "daemon/field_maps.h"

#include "core/mono_blend.h"
#include "core/promote.h"
#include "daemon/field_segments.h"
#include "daemon/light_set.h"
#include "daemon/linear_maps.h"
#include "daemon/map_file.h"
#include "daemon/ratio_maps.h"
#include "daemon/separated_maps.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

struct entry {
    struct ls_field_map map; /* values NULL: not made */
    struct ls_map_file file;
};

struct ls_field_maps {
    GMutex lock;
    struct entry entry[LS_MAP_KINDS][LS_FIELD_MAX_SPECTRA];
};

enum ls_err ls_field_maps_create(struct ls_field_maps **out, struct ls_diag *diag)
{
    struct ls_field_maps *maps = calloc(1, sizeof *maps);
    if (!maps)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory opening a take's field");
    g_mutex_init(&maps->lock);
    *out = maps;
    return LS_OK;
}

static void entry_finish(struct entry *entry)
{
    ls_map_file_finish(&entry->file);
    free(entry->map.phi);
    *entry = (struct entry){0};
}

void ls_field_maps_destroy(struct ls_field_maps *maps)
{
    if (!maps)
        return;
    for (int kind = 0; kind < LS_MAP_KINDS; kind++)
        for (int s = 0; s < LS_FIELD_MAX_SPECTRA; s++)
            entry_finish(&maps->entry[kind][s]);
    g_mutex_clear(&maps->lock);
    free(maps);
}

static const char *name_of(const struct ls_field_source *source, uint32_t s)
{
    return source->facts->channels[source->channel_of[s]].name;
}

static enum ls_err entry_open(const struct ls_field_source *source, struct entry *entry,
                              uint32_t depth, struct ls_diag *diag)
{
    size_t floats = (size_t)source->width * source->height * depth;
    entry->map.depth = depth;
    return ls_map_file_create(&entry->file, source->storage, floats * sizeof(float), diag);
}

/* ---- what is there ---- */

static enum ls_err need_sphere(const struct ls_field_source *source, uint32_t s,
                               struct ls_diag *diag)
{
    if (source->has_sphere[s])
        return LS_OK;
    if (ls_field_source_picture(source, source->channel_of[s], -1, NULL))
        return ls_fail(diag, LS_ERR_STATE,
                       "take %s is uncalibrated for the full sphere of %s: its calibration has no "
                       "factor of pattern sphere at duty %.4f",
                       source->take, name_of(source, s), source->duty[s]);
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

/* ---- ratios ---- */

/* Spectra whose ratios are made together. */
struct ratios {
    struct ls_field_source *source;
    enum ls_field_map_kind kind;
    uint32_t n, spectra[LS_FIELD_MAX_SPECTRA];
    bool squares; /* v_rows has the squares of its weights behind them */
    struct ls_picture *f;
    float *v_rows, *f_rows;
    double neutral[LS_FIELD_MAX_SPECTRA][3];
    struct entry made[LS_FIELD_MAX_SPECTRA];
};

/* What makes V of white, and, where multiplexed pictures make it, the light its shot noise is of. */
static enum ls_err fill_v(struct ratios *r, uint32_t q, const double *w, uint32_t n_v,
                          struct ls_diag *diag)
{
    const struct ls_light_set *white = &r->source->white;
    float *row = r->v_rows + (size_t)q * n_v;
    enum ls_err err = ls_light_set_row(white, w, r->source->field.n_lights, row, diag);
    for (uint32_t j = 0; j < n_v && r->squares; j++)
        row[(size_t)r->n * n_v + j] = row[j] * row[j];
    return err;
}

/* Eq. 1: the sphere of s over white under the strengths of s. */
static enum ls_err fill_sphere(struct ratios *r, uint32_t q, uint32_t n_v, uint32_t n_f,
                               struct ls_diag *diag)
{
    const struct ls_field *field = &r->source->field;
    uint32_t s = r->spectra[q], at = LS_HEADLIGHT_LIGHTS * q;
    r->f[at] = field->sphere[s];
    r->f_rows[(size_t)q * n_f + at] = (float)ls_promote_sphere_factor(field, s);
    if (r->kind != LS_MAP_PAPER)
        return fill_v(r, q, field->g + (size_t)s * field->n_lights, n_v, diag);
    r->v_rows[(size_t)q * n_v] = (float)ls_promote_sphere_factor(field, 0);
    return LS_OK;
}

/* Eq. 2: the same with the lights of the head light alone. */
static enum ls_err fill_headlight(struct ratios *r, uint32_t q, uint32_t n_v, uint32_t n_f,
                                  struct ls_diag *diag)
{
    const struct ls_field *field = &r->source->field;
    uint32_t s = r->spectra[q], at = LS_HEADLIGHT_LIGHTS * q;
    struct ls_field_headlight light;
    LS_CLEANUP_FREE double *w = calloc(field->n_lights, sizeof *w);
    if (!w)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for a head light");
    enum ls_err err = ls_field_headlight_find(r->source, r->source->channel_of[s], &light, diag);
    for (uint32_t j = 0; j < light.n && !err; j++) {
        r->f[at + j] = light.pictures[j];
        r->f_rows[(size_t)q * n_f + at + j] = (float)light.factor[j];
    }
    for (uint32_t l = 0; l < light.n_lights && !err; l++)
        w[light.lights[l]] = field->g[(size_t)s * field->n_lights + light.lights[l]];
    return err ? err : fill_v(r, q, w, n_v, diag);
}

static enum ls_err fill_ratio(struct ratios *r, uint32_t q, uint32_t n_v, uint32_t n_f,
                              struct ls_diag *diag)
{
    const struct ls_field *field = &r->source->field;
    uint32_t s = r->spectra[q], colours = field->n_channels;
    for (uint32_t c = 0; c < colours; c++)
        r->neutral[q][c] = field->p[s * colours + c] / field->p[c];
    if (r->kind == LS_MAP_HEADLIGHT)
        return fill_headlight(r, q, n_v, n_f, diag);
    return fill_sphere(r, q, n_v, n_f, diag);
}

static enum ls_err run_ratios(struct ratios *r, float **maps, struct ls_diag *diag)
{
    struct ls_field_source *source = r->source;
    bool paper = r->kind == LS_MAP_PAPER;
    uint32_t n_v = paper ? 1 : source->white.n_pictures, n_f = LS_HEADLIGHT_LIGHTS * r->n;
    enum ls_err err = LS_OK;
    r->squares = !paper && ls_light_set_is_multiplexed(&source->white);
    r->f = calloc(n_f, sizeof *r->f);
    r->v_rows = calloc((size_t)r->n * n_v * (r->squares ? 2 : 1), sizeof *r->v_rows);
    r->f_rows = calloc((size_t)r->n * n_f, sizeof *r->f_rows);
    if (!r->f || !r->v_rows || !r->f_rows)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for %u ratios", r->n);
    for (uint32_t j = 0; j < n_f; j++)
        r->f[j].tiles = source->no_tiles;
    for (uint32_t q = 0; q < r->n && !err; q++)
        err = fill_ratio(r, q, n_v, n_f, diag);
    const struct ls_ratio_job job = {.n = r->n,
                                     .n_v = n_v,
                                     .n_f = n_f,
                                     .v = paper ? source->field.sphere : source->white.pictures,
                                     .f = r->f,
                                     .v_rows = r->v_rows,
                                     .squares = r->squares,
                                     .f_rows = r->f_rows,
                                     .neutral = (const double(*)[3])r->neutral,
                                     .maps = maps};
    return err ? err : ls_ratio_maps_make(&source->field, &job, diag);
}

static enum ls_err run_separated(struct ratios *r, float **maps, struct ls_diag *diag)
{
    struct ls_separation separation;
    unsigned options = (unsigned)(r->kind - LS_MAP_SEPARATED);
    enum ls_err err = ls_separation_init(&separation, r->source, options & 1, options & 2, diag);
    for (uint32_t q = 0; q < r->n; q++)
        r->made[q].map.n_inseparable = separation.inseparable;
    if (!err)
        err = ls_separated_maps_make(r->source, &separation, r->spectra, r->n, maps, diag);
    ls_separation_finish(&separation);
    return err;
}

static enum ls_err run(struct ratios *r, struct ls_diag *diag)
{
    float *maps[LS_FIELD_MAX_SPECTRA];
    enum ls_err err = LS_OK;
    for (uint32_t q = 0; q < r->n && !err; q++) {
        err = entry_open(r->source, &r->made[q], r->source->field.n_channels, diag);
        maps[q] = r->made[q].file.base;
    }
    if (err)
        return err;
    return r->kind < LS_MAP_SEPARATED ? run_ratios(r, maps, diag) : run_separated(r, maps, diag);
}

/* Of every spectrum of which it can be made and was not yet: they cost one pass together. */
static enum ls_err make_ratios(struct ls_field_source *source, enum ls_field_map_kind kind,
                               struct ls_diag *diag)
{
    struct ratios r = {.source = source, .kind = kind};
    struct entry *entry = source->promoted->entry[kind];
    for (uint32_t s = 1; s < source->field.n_spectra; s++)
        if (!entry[s].map.values && !ls_field_maps_possible(source, kind, s, NULL))
            r.spectra[r.n++] = s;
    enum ls_err err = run(&r, diag);
    for (uint32_t q = 0; q < r.n; q++) {
        if (err) {
            entry_finish(&r.made[q]);
            continue;
        }
        r.made[q].map.values = r.made[q].file.base;
        entry[r.spectra[q]] = r.made[q];
    }
    free(r.f);
    free(r.v_rows);
    free(r.f_rows);
    return err;
}

/* ---- matrices ---- */

/* White, then every other spectrum of which each light was photographed. */
static void choose_inputs(const struct ls_field_source *source, struct ls_linear_job *job,
                          struct ls_field_map *map)
{
    const struct ls_field *field = &source->field;
    uint32_t colours = field->n_channels;
    for (uint32_t s = 0; s < field->n_spectra; s++) {
        const struct ls_light_set *set = s ? &source->set[source->channel_of[s]] : &source->white;
        if (s == job->s || set->n_found == 0 || set->n_found < set->n_pictures ||
            ls_light_set_ready(source, set, NULL) ||
            (job->n_sets + 1) * colours > LS_LINEAR_MAX_INPUTS)
            continue;
        for (uint32_t c = 0; c < colours; c++)
            job->p_in[job->n_sets * colours + c] = field->p[s * colours + c];
        map->inputs[job->n_sets] = s;
        job->set[job->n_sets++] = set;
    }
    map->n_inputs = job->n_sets;
}

static enum ls_err make_phi(const struct ls_field_source *source, struct ls_linear_job *job,
                            struct ls_field_map *map, struct ls_diag *diag)
{
    const struct ls_field *field = &source->field;
    if (field->n_channels > 1 || job->n_sets > 1)
        return LS_OK;
    map->n_inputs = 0;
    map->phi = calloc((size_t)field->n_lights * job->n_segments, sizeof *map->phi);
    if (!map->phi)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for %u segments", job->n_segments);
    job->phi = map->phi;
    return ls_mono_blend_weights(field->directions, field->n_lights, job->segment, job->n_segments,
                                 map->phi, diag);
}

static void note_error(const struct ls_field_source *source, const struct ls_linear_error *error,
                       struct ls_field_map *map)
{
    if (error->pixels == 0 || !(error->total > 0))
        return;
    map->left_out_error = sqrt(fmax(error->difference, 0) / error->total);
    map->left_out_share = (double)error->pixels / ((double)source->width * source->height);
}

static enum ls_err make_linear(struct ls_field_source *source, uint32_t s, struct entry *entry,
                               struct ls_diag *diag)
{
    struct ls_field_segments *segments = malloc(sizeof *segments);
    struct ls_linear_error error = {0};
    struct ls_linear_job job = {.field = &source->field, .s = s};
    if (!segments)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for segments");
    enum ls_err err = ls_field_segments_find(source, source->channel_of[s], segments, diag);
    if (!err) {
        job.n_segments = entry->map.n_segments = segments->n;
        job.f = segments->pictures;
        job.factor = segments->factor;
        job.segment = segments->segment;
        choose_inputs(source, &job, &entry->map);
        err = make_phi(source, &job, &entry->map, diag);
    }
    uint32_t colours = source->field.n_channels;
    if (!err)
        err = entry_open(source, entry, job.phi ? job.n_segments : colours * colours * job.n_sets,
                         diag);
    job.map = entry->file.base;
    if (!err)
        err = ls_linear_maps_make(&job, &error, diag);
    free(segments);
    note_error(source, &error, &entry->map);
    entry->map.values = err ? NULL : entry->file.base;
    return err;
}

/* ---- asking ---- */

static enum ls_err make(struct ls_field_source *source, enum ls_field_map_kind kind, uint32_t s,
                        struct ls_diag *diag)
{
    struct entry made = {0};
    if (kind != LS_MAP_LINEAR)
        return make_ratios(source, kind, diag);
    enum ls_err err = make_linear(source, s, &made, diag);
    if (err)
        entry_finish(&made);
    else
        source->promoted->entry[kind][s] = made;
    return err;
}

enum ls_err ls_field_maps_get(struct ls_field_source *source, enum ls_field_map_kind kind,
                              uint32_t s, const struct ls_field_map **out, struct ls_diag *diag)
{
    struct ls_field_map *map = &source->promoted->entry[kind][s].map;
    enum ls_err err = ls_field_maps_possible(source, kind, s, diag);
    if (err)
        return err;
    g_mutex_lock(&source->promoted->lock);
    if (!map->values)
        err = make(source, kind, s, diag);
    if (!err)
        err = ls_field_source_sound(source, false, diag);
    *out = map;
    g_mutex_unlock(&source->promoted->lock);
    return err;
}
