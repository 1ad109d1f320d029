#include "daemon/field_maps.h"

#include "core/half.h"
#include "core/mono_blend.h"
#include "core/promote.h"
#include "daemon/field_segments.h"
#include "daemon/light_set.h"
#include "daemon/linear_maps.h"
#include "daemon/map_file.h"
#include "daemon/ratio_maps.h"
#include "daemon/separated_maps.h"

#include <stdlib.h>
#include <string.h>

struct entry {
    struct ls_field_map map; /* values NULL: not made */
    struct ls_map_file file, halves;
};

struct ls_field_maps {
    GMutex lock; /* of all below, but an entry's map once it is there */
    GCond made;
    bool making;
    struct entry entry[LS_MAP_KINDS][LS_FIELD_MAX_SPECTRA];
};

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

static void entry_finish(struct entry *entry)
{
    ls_map_file_finish(&entry->file);
    ls_map_file_finish(&entry->halves);
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
    g_cond_clear(&maps->made);
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
    return ls_map_file_create(&entry->file, source->storage, floats * sizeof(float),
                              source->spare_bytes, diag);
}

/* What was made goes to its place, for all to see, or nowhere. */
static void settle(struct ls_field_source *source, enum ls_err err, struct entry *made,
                   struct entry *place)
{
    if (err) {
        entry_finish(made);
        return;
    }
    made->map.values = made->file.base;
    g_mutex_lock(&source->promoted->lock);
    *place = *made;
    g_mutex_unlock(&source->promoted->lock);
}

/* ---- what is there ---- */

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

/* ---- ratios ---- */

/* Spectra whose ratios are made together. */
struct ratios {
    struct ls_field_source *source;
    const struct ls_job *asker;
    enum ls_field_map_kind kind;
    uint32_t n, spectra[LS_FIELD_MAX_SPECTRA];
    bool squares;  /* v_rows has the squares of its weights behind them */
    bool coloured; /* v_rows has three for each, one for a colour of the camera */
    struct ls_picture *f;
    float *v_rows, *f_rows;
    double neutral[LS_FIELD_MAX_SPECTRA][3];
    struct entry made[LS_FIELD_MAX_SPECTRA];
};

static uint32_t rows_of_one(const struct ratios *r)
{
    return r->coloured ? 3 : 1;
}

/* What makes V of white, and, where multiplexed pictures make it, the light its shot noise is of.
 */
static enum ls_err fill_v_row(struct ratios *r, uint32_t at, const double *w, int32_t colour,
                              uint32_t n_v, struct ls_diag *diag)
{
    float *row = r->v_rows + (size_t)at * n_v;
    enum ls_err err =
        ls_light_set_row(&r->source->white, w, r->source->field.n_lights, colour, row, diag);
    for (uint32_t j = 0; j < n_v && r->squares; j++)
        row[(size_t)r->n * rows_of_one(r) * n_v + j] = row[j] * row[j];
    return err;
}

/* Under strengths w of the lights of ratio @q's spectrum: with factors on their k, w / factor. */
static enum ls_err fill_v(struct ratios *r, uint32_t q, const double *w, uint32_t n_v,
                          struct ls_diag *diag)
{
    const double *factor = ls_field_source_colour(r->source, r->source->channel_of[r->spectra[q]]);
    uint32_t n = r->source->field.n_lights;
    if (!r->coloured)
        return fill_v_row(r, q, w, -1, n_v, diag);
    LS_CLEANUP_FREE double *room = malloc(n * sizeof *room);
    enum ls_err err = room ? LS_OK : ls_fail(diag, LS_ERR_NOMEM, "out of memory for %u lights", n);
    for (uint32_t c = 0; c < 3 && !err; c++) {
        for (uint32_t i = 0; i < n; i++)
            room[i] = factor ? w[i] / factor[3 * i + c] : w[i];
        err = fill_v_row(r, 3 * q + c, room, (int32_t)c, n_v, diag);
    }
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

/* Are there lights of white, or of a spectrum, that differ in colour? */
static bool has_colours(const struct ratios *r)
{
    bool any = ls_light_set_is_coloured(&r->source->white);
    for (uint32_t q = 0; q < r->n; q++)
        any |= r->source->has_colour[r->source->channel_of[r->spectra[q]]];
    return any;
}

static enum ls_err run_ratios(struct ratios *r, float **maps, struct ls_diag *diag)
{
    struct ls_field_source *source = r->source;
    bool paper = r->kind == LS_MAP_PAPER;
    uint32_t n_v = paper ? 1 : source->white.n_pictures, n_f = LS_HEADLIGHT_LIGHTS * r->n;
    enum ls_err err = LS_OK;
    r->squares = !paper && ls_light_set_is_multiplexed(&source->white);
    r->coloured = !paper && has_colours(r);
    r->f = calloc(n_f, sizeof *r->f);
    r->v_rows =
        calloc((size_t)r->n * rows_of_one(r) * n_v * (r->squares ? 2 : 1), sizeof *r->v_rows);
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
                                     .coloured = r->coloured,
                                     .squares = r->squares,
                                     .f_rows = r->f_rows,
                                     .neutral = (const double(*)[3])r->neutral,
                                     .maps = maps,
                                     .asker = r->asker};
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
        err =
            ls_separated_maps_make(r->source, &separation, r->spectra, r->n, r->asker, maps, diag);
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
                               const struct ls_job *asker, struct ls_diag *diag)
{
    struct ratios r = {.source = source, .asker = asker, .kind = kind};
    struct entry *entry = source->promoted->entry[kind];
    for (uint32_t s = 1; s < source->field.n_spectra; s++)
        if (!entry[s].map.values && !ls_field_maps_possible(source, kind, s, NULL))
            r.spectra[r.n++] = s;
    enum ls_err err = run(&r, diag);
    for (uint32_t q = 0; q < r.n; q++)
        settle(source, err, &r.made[q], &entry[r.spectra[q]]);
    free(r.f);
    free(r.v_rows);
    free(r.f_rows);
    return err;
}

/* ---- matrices ---- */

/* Spectra whose matrices are made together: all of one division of the dome. */
struct fits {
    struct ls_field_source *source;
    struct ls_linear_job job;
    struct ls_linear_target targets[LS_FIELD_MAX_SPECTRA];
    struct ls_field_segments *segments[LS_FIELD_MAX_SPECTRA];
    struct entry made[LS_FIELD_MAX_SPECTRA];
    uint32_t inputs[LS_LINEAR_MAX_INPUTS];
    double *phi, *others;
};

static const struct ls_light_set *set_of(const struct ls_field_source *source, uint32_t s)
{
    return s ? &source->set[source->channel_of[s]] : &source->white;
}

/* Was each light photographed in it? Then it is an input, and is served as it is. */
static bool is_whole(const struct ls_field_source *source, uint32_t s)
{
    const struct ls_light_set *set = set_of(source, s);
    return set->n_found > 0 && set->n_found == set->n_pictures &&
           !ls_light_set_ready(source, set, NULL);
}

/* White, then every other spectrum of which each light was photographed. */
static void choose_inputs(struct fits *fits, uint32_t s)
{
    const struct ls_field_source *source = fits->source;
    const struct ls_field *field = &source->field;
    struct ls_linear_job *job = &fits->job;
    uint32_t colours = field->n_channels;
    for (uint32_t k = 0; k < field->n_spectra; k++) {
        if (k == s || !is_whole(source, k) || (job->n_sets + 1) * colours > LS_LINEAR_MAX_INPUTS)
            continue;
        for (uint32_t c = 0; c < colours; c++)
            job->p_in[job->n_sets * colours + c] = field->p[k * colours + c];
        fits->inputs[job->n_sets] = k;
        job->set[job->n_sets++] = set_of(source, k);
    }
}

/* Lights of s that were photographed alone; of many, some evenly spread over the rig's rows. */
static void choose_checks(const struct ls_field_source *source, struct ls_linear_target *target)
{
    const struct ls_light_set *set = set_of(source, target->s);
    uint32_t n = set->n_found < LS_LINEAR_MAX_CHECKS ? set->n_found : LS_LINEAR_MAX_CHECKS;
    target->photographed = set;
    if (is_whole(source, target->s))
        return;
    for (uint32_t i = 0, found = 0; i < source->field.n_lights && target->n_checks < n; i++) {
        if (!ls_light_set_has(source, set, i))
            continue;
        if (found++ >= (uint64_t)target->n_checks * set->n_found / n)
            target->checks[target->n_checks++] = i;
    }
}

static enum ls_err add_target(struct fits *fits, uint32_t s, struct ls_diag *diag)
{
    struct ls_field_segments *segments = malloc(sizeof *segments);
    struct ls_linear_job *job = &fits->job;
    if (!segments)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for segments");
    enum ls_err err =
        ls_field_segments_find(fits->source, fits->source->channel_of[s], segments, diag);
    const struct ls_field_segments *first = job->n_targets > 0 ? fits->segments[0] : segments;
    if (err || segments->n != first->n ||
        memcmp(segments->segment, first->segment,
               fits->source->field.n_lights * sizeof *segments->segment) != 0) {
        free(segments);
        return err;
    }
    fits->segments[job->n_targets] = segments;
    fits->targets[job->n_targets] = (struct ls_linear_target){
        .s = s,
        .colour = ls_field_source_colour(fits->source, fits->source->channel_of[s]),
        .f = segments->pictures,
        .factor = segments->factor};
    choose_checks(fits->source, &fits->targets[job->n_targets++]);
    return LS_OK;
}

/* @s, and all that cost little more in the same pass over the field. */
static enum ls_err choose_targets(struct fits *fits, uint32_t s, struct ls_diag *diag)
{
    const struct ls_field_source *source = fits->source;
    const struct entry *entry = source->promoted->entry[LS_MAP_LINEAR];
    enum ls_err err = add_target(fits, s, diag);
    bool alone = is_whole(source, s);
    for (uint32_t k = 1; k < source->field.n_spectra && !err && !alone; k++)
        if (k != s && !entry[k].map.values && !is_whole(source, k) &&
            !ls_field_maps_possible(source, LS_MAP_LINEAR, k, NULL))
            err = add_target(fits, k, diag);
    return err;
}

static enum ls_err make_phi(struct fits *fits, struct ls_diag *diag)
{
    const struct ls_field *field = &fits->source->field;
    struct ls_linear_job *job = &fits->job;
    if (field->n_channels > 1 || job->n_sets > 1)
        return LS_OK;
    job->phi = fits->phi = calloc((size_t)field->n_lights * job->n_segments, sizeof *fits->phi);
    job->others = fits->others =
        calloc((size_t)job->n_segments * job->n_segments, sizeof *fits->others);
    if (!fits->phi || !fits->others)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for %u segments", job->n_segments);
    enum ls_err err = ls_mono_blend_weights(field->directions, field->n_lights, job->segment,
                                            job->n_segments, fits->phi, diag);
    if (!err && job->n_segments > 1)
        ls_mono_blend_others(fits->phi, field->n_lights, job->segment, job->n_segments,
                             fits->others);
    return err;
}

static enum ls_err open_entry(struct fits *fits, uint32_t t, struct ls_diag *diag)
{
    const struct ls_linear_job *job = &fits->job;
    const struct ls_field *field = &fits->source->field;
    struct ls_field_map *map = &fits->made[t].map;
    map->n_segments = job->n_segments;
    map->n_inputs = job->phi ? 0 : job->n_sets;
    memcpy(map->inputs, fits->inputs, sizeof map->inputs);
    size_t n = (size_t)field->n_lights * job->n_segments;
    if (job->phi && !(map->phi = malloc(n * sizeof *map->phi)))
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for %u segments", job->n_segments);
    if (job->phi)
        memcpy(map->phi, fits->phi, n * sizeof *map->phi);
    uint32_t matrix = field->n_channels * field->n_channels * job->n_sets;
    enum ls_err err =
        entry_open(fits->source, &fits->made[t], job->phi ? job->n_segments : matrix, diag);
    fits->targets[t].map = fits->made[t].file.base;
    return err;
}

static void note_errors(const struct ls_field_source *source, const struct ls_linear_target *target,
                        struct ls_field_map *map)
{
    double pixels = (double)source->width * source->height;
    if (target->left_out.total > 0) {
        map->left_out_error = ls_linear_estimate(&target->left_out);
        map->left_out_share = (double)target->left_out.pixels / pixels;
    }
    map->n_checked = target->n_checks;
    map->checked_error = ls_linear_estimate(&target->checked);
    map->highlight_error = ls_linear_estimate(&target->highlights);
    if (target->n_checks > 0)
        map->highlight_share = (double)target->highlights.pixels / (pixels * target->n_checks);
}

static enum ls_err fit(struct fits *fits, struct ls_diag *diag)
{
    struct ls_linear_job *job = &fits->job;
    enum ls_err err = make_phi(fits, diag);
    for (uint32_t t = 0; t < job->n_targets && !err; t++)
        err = open_entry(fits, t, diag);
    return err ? err : ls_linear_maps_make(job, diag);
}

static void settle_fits(struct fits *fits, enum ls_err err)
{
    struct entry *entry = fits->source->promoted->entry[LS_MAP_LINEAR];
    for (uint32_t t = 0; t < fits->job.n_targets; t++) {
        if (!err)
            note_errors(fits->source, &fits->targets[t], &fits->made[t].map);
        settle(fits->source, err, &fits->made[t], &entry[fits->targets[t].s]);
    }
    free(fits->phi);
    free(fits->others);
}

/* Two spectra of a mono camera may tell less of a third than segments do: of each target the
 * better is kept, by what is estimated of both; the matrix where there is no room for both. */
static enum ls_err fit_or_blend(struct fits *fits, struct ls_diag *diag)
{
    struct ls_linear_job *job = &fits->job;
    if (job->field->n_channels > 1 || job->n_sets == 1 || job->n_segments < 3)
        return LS_OK;
    struct fits *blend = malloc(sizeof *blend);
    if (!blend)
        return LS_OK;
    *blend = *fits;
    memset(blend->made, 0, sizeof blend->made);
    blend->job.targets = blend->targets;
    blend->job.n_sets = 1;
    struct ls_diag own = {{0}};
    enum ls_err err = fit(blend, &own);
    for (uint32_t t = 0; t < job->n_targets; t++) {
        bool better = !err && ls_linear_estimate(&blend->targets[t].left_out) <
                                  ls_linear_estimate(&fits->targets[t].left_out);
        entry_finish(better ? &fits->made[t] : &blend->made[t]);
        if (!better)
            continue;
        fits->made[t] = blend->made[t];
        fits->targets[t] = blend->targets[t];
    }
    free(blend->phi);
    free(blend->others);
    free(blend);
    if (err == LS_ERR_FULL || err == LS_ERR_NOMEM)
        return LS_OK;
    if (err && diag)
        *diag = own;
    return err;
}

/* Are there lights of an input, or of a target, that differ in colour? */
static uint32_t n_rows_of(const struct ls_linear_job *job)
{
    bool any = false;
    for (uint32_t k = 0; k < job->n_sets; k++)
        any |= ls_light_set_is_coloured(job->set[k]);
    for (uint32_t t = 0; t < job->n_targets; t++)
        any |= job->targets[t].colour != NULL;
    return any ? 3 : 1;
}

static enum ls_err make_linear(struct ls_field_source *source, uint32_t s,
                               const struct ls_job *asker, struct ls_diag *diag)
{
    struct fits *fits = calloc(1, sizeof *fits);
    if (!fits)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for segments");
    fits->source = source;
    fits->job = (struct ls_linear_job){
        .field = &source->field, .targets = fits->targets, .crew = {ls_crew_threads(), asker}};
    enum ls_err err = choose_targets(fits, s, diag);
    if (!err) {
        fits->job.n_segments = fits->segments[0]->n;
        fits->job.segment = fits->segments[0]->segment;
        choose_inputs(fits, s);
        fits->job.n_rows = n_rows_of(&fits->job);
        err = fit(fits, diag);
    }
    if (!err)
        err = fit_or_blend(fits, diag);
    settle_fits(fits, err);
    for (uint32_t t = 0; t < fits->job.n_targets; t++)
        free(fits->segments[t]);
    free(fits);
    return err;
}

/* ---- asking ---- */

static enum ls_err make(struct ls_field_source *source, enum ls_field_map_kind kind, uint32_t s,
                        const struct ls_job *asker, struct ls_diag *diag)
{
    return kind == LS_MAP_LINEAR ? make_linear(source, s, asker, diag)
                                 : make_ratios(source, kind, asker, diag);
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
    struct entry *entry = (struct entry *)map; /* its first member */
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
