#include "daemon/field_maps_private.h"

#include "core/mono_blend.h"
#include "daemon/field_segments.h"
#include "daemon/light_set.h"
#include "daemon/linear_maps.h"

#include <stdlib.h>
#include <string.h>

/* Spectra whose matrices are made together: all of one division of the dome. */
struct fits {
    struct ls_field_source *source;
    struct ls_linear_job job;
    struct ls_linear_target targets[LS_FIELD_MAX_SPECTRA];
    struct ls_field_segments *segments[LS_FIELD_MAX_SPECTRA];
    struct ls_map_entry made[LS_FIELD_MAX_SPECTRA];
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
    const struct ls_map_entry *entry = source->promoted->entry[LS_MAP_LINEAR];
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
        ls_map_entry_open(fits->source, &fits->made[t], job->phi ? job->n_segments : matrix, diag);
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
    struct ls_map_entry *entry = fits->source->promoted->entry[LS_MAP_LINEAR];
    for (uint32_t t = 0; t < fits->job.n_targets; t++) {
        if (!err)
            note_errors(fits->source, &fits->targets[t], &fits->made[t].map);
        ls_map_entry_settle(fits->source, err, &fits->made[t], &entry[fits->targets[t].s]);
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
        ls_map_entry_finish(better ? &fits->made[t] : &blend->made[t]);
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

enum ls_err ls_field_maps_make_matrices(struct ls_field_source *source, uint32_t s,
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
