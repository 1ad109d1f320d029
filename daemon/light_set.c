#include "daemon/light_set.h"

#include "core/relight.h"

#include <math.h>
#include <stdlib.h>

static enum ls_err fill_multiplexed(const struct ls_light_group *group, const double *k,
                                    const double *w, uint32_t n_lights, float *row,
                                    struct ls_diag *diag)
{
    LS_CLEANUP_FREE double *gained = calloc(n_lights, sizeof *gained);
    LS_CLEANUP_FREE double *rows = calloc(group->order, sizeof *rows);
    if (!gained || !rows)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for the weights of %u lights", n_lights);
    for (uint32_t i = 0; i < n_lights; i++)
        gained[i] = (w ? w[i] : 1) * k[i];
    enum ls_err err = ls_multiplex_weights(group->order, n_lights, 1, gained, rows, diag);
    for (uint32_t j = 0; j < group->order && !err; j++)
        row[j] = (float)(group->scale[j] * rows[j]);
    return err;
}

/* The group's own where it has no factors; else made in @room. */
static const double *gains_of(const struct ls_light_group *group, uint32_t n_lights, int32_t colour,
                              double *room)
{
    if (!group->colour || colour < 0)
        return group->k;
    for (uint32_t i = 0; i < n_lights; i++)
        room[i] = group->k[i] * group->colour[3 * i + (uint32_t)colour];
    return room;
}

enum ls_err ls_light_set_row(const struct ls_light_set *set, const double *w, uint32_t n_lights,
                             int32_t colour, float *row, struct ls_diag *diag)
{
    LS_CLEANUP_FREE double *room = calloc(n_lights, sizeof *room);
    enum ls_err err =
        room ? LS_OK : ls_fail(diag, LS_ERR_NOMEM, "out of memory for %u lights", n_lights);
    for (uint32_t g = 0; g < set->n_groups && !err; g++) {
        const struct ls_light_group *group = &set->group[g];
        const double *k = gains_of(group, n_lights, colour, room);
        if (group->order > 0)
            err = fill_multiplexed(group, k, w, n_lights, row + group->first, diag);
        else
            ls_relight_row(k, w, group->n, row + group->first);
    }
    return err;
}

bool ls_light_set_is_coloured(const struct ls_light_set *set)
{
    for (uint32_t g = 0; g < set->n_groups; g++)
        if (set->group[g].colour)
            return true;
    return false;
}

bool ls_light_set_is_multiplexed(const struct ls_light_set *set)
{
    for (uint32_t g = 0; g < set->n_groups; g++)
        if (set->group[g].order > 0)
            return true;
    return false;
}

bool ls_light_set_is_summed(const struct ls_light_set *set)
{
    return set->n_groups > 1 || ls_light_set_is_multiplexed(set);
}

static uint32_t count_found(const struct ls_field_source *source, const struct ls_light_set *set,
                            const struct ls_light_group *group)
{
    uint32_t n = 0;
    for (uint32_t j = group->first; j < group->first + group->n; j++)
        n += set->pictures[j].tiles != source->no_tiles;
    return n;
}

bool ls_light_set_has(const struct ls_field_source *source, const struct ls_light_set *set,
                      uint32_t light)
{
    for (uint32_t g = 0; g < set->n_groups; g++) {
        const struct ls_light_group *group = &set->group[g];
        bool all = group->order == 0 || count_found(source, set, group) == group->n;
        if (!all ||
            (group->order == 0 && set->pictures[group->first + light].tiles == source->no_tiles))
            return false;
    }
    return true;
}

enum ls_err ls_light_set_ready(const struct ls_field_source *source, const struct ls_light_set *set,
                               struct ls_diag *diag)
{
    for (uint32_t g = 0; g < set->n_groups; g++) {
        const struct ls_light_group *group = &set->group[g];
        const char *name = source->facts->channels[group->channel].name;
        uint32_t found = group->order ? count_found(source, set, group) : group->n;
        if (found < group->n)
            return ls_fail(diag, LS_ERR_STATE,
                           "take %s has %u of %u multiplexed pictures of %s: every light needs "
                           "all of them; resume the take",
                           source->take, found, group->n, name);
        for (uint32_t j = 0; j < group->order; j++)
            if (!(group->scale[j] > 0))
                return ls_field_source_uncalibrated(source, "the multiplexed pictures",
                                                    group->channel, "multiplex", group->duty, diag);
    }
    return LS_OK;
}

static double mean(const double *v, uint32_t n)
{
    double sum = 0;
    for (uint32_t i = 0; i < n; i++)
        sum += v[i];
    return sum / n;
}

double ls_light_set_shot(const struct ls_light_set *set, const double *w, uint32_t n_lights,
                         const float *row)
{
    double light = 0, total = 0;
    for (uint32_t g = 0; g < set->n_groups; g++) {
        const struct ls_light_group *group = &set->group[g];
        double squares = 0, shown = 1; /* by a picture, in lights */
        for (uint32_t j = group->first; j < group->first + group->n; j++)
            squares += (double)row[j] * (double)row[j];
        if (group->order > 0)
            shown = n_lights * (group->order + 1.0) /
                    (2 * group->order * mean(group->scale, group->order));
        light += squares * shown;
        for (uint32_t i = 0; i < n_lights; i++)
            total += (w ? w[i] : 1) * group->k[i];
    }
    return total > 0 ? light / total : 0;
}
