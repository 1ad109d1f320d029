#include "daemon/field_multiplex.h"

#include "core/bases.h"
#include "core/half.h"
#include "daemon/light_set.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { MAX_TILES = 4, MAX_SAMPLES = 1 << 22, TILE_PIXELS = LS_TILE_SIDE * LS_TILE_SIDE };
static const double sag_doubt = 0.1;

/* ---- rows ---- */

/* Was every light of a channel planned alone? @seen: [n_lights]. */
static bool is_each_planned(const struct ls_field_source *source, uint32_t channel, uint8_t *seen)
{
    uint32_t n = 0;
    for (uint32_t i = 0; i < source->facts->n_conditions; i++) {
        const struct ls_condition_fact *fact = &source->facts->conditions[i];
        if (fact->kind != LS_FACT_ONE || fact->channel != channel || seen[fact->light])
            continue;
        seen[fact->light] = 1;
        n++;
    }
    return n == source->facts->n_lights;
}

static const struct ls_condition_fact *first_row(const struct ls_field_source *source,
                                                 uint32_t channel)
{
    for (uint32_t i = 0; i < source->facts->n_conditions; i++) {
        const struct ls_condition_fact *fact = &source->facts->conditions[i];
        if (fact->kind == LS_FACT_MULTIPLEX && fact->channel == channel)
            return fact;
    }
    return NULL;
}

bool ls_field_multiplex_belongs(const struct ls_light_group *group,
                                const struct ls_condition_fact *fact)
{
    return fact->kind == LS_FACT_MULTIPLEX && fact->channel == group->channel &&
           fact->parts == group->order && fact->part < group->order && fact->duty == group->duty;
}

/* Does @fact light the columns of its row and no others? Its lights ascend. */
static bool is_row(const struct ls_condition_fact *fact, uint32_t n_lights, uint8_t *on)
{
    uint32_t n = 0;
    ls_multiplex_row(fact->parts, fact->part, on);
    for (uint32_t i = 0; i < n_lights; i++)
        if (on[i] && (n == fact->n_lights || fact->lights[n++] != i))
            return false;
    return n == fact->n_lights;
}

static double quantised(double duty, uint32_t levels)
{
    double q = levels ? round(duty * levels) / levels : duty;
    return q > 0 ? q : duty;
}

static double row_factor(const struct ls_field_source *source, const struct ls_light_group *group,
                         const struct ls_condition_fact *fact)
{
    double f = ls_field_source_factor(source, fact) * fact->duty;
    double step = fact->duty / quantised(fact->duty, source->facts->pwm_levels);
    double mean = source->facts->n_lights * (group->order + 1.0) / (2.0 * group->order);
    if (!(f > 0) || !source->facts->calibration || !(mean > 1))
        return f;
    return step * (1 + (f / step - 1) * (fact->n_lights - 1.0) / (mean - 1));
}

static enum ls_err fill_scales(const struct ls_field_source *source, struct ls_light_group *group,
                               uint8_t *on, struct ls_diag *diag)
{
    for (uint32_t i = 0; i < source->facts->n_conditions; i++) {
        const struct ls_condition_fact *fact = &source->facts->conditions[i];
        if (!ls_field_multiplex_belongs(group, fact))
            continue;
        if (!is_row(fact, source->facts->n_lights, on))
            return ls_fail(diag, LS_ERR_INVALID,
                           "take.json: %s: its lights are not those of row %u of a multiplexing "
                           "matrix of order %u",
                           fact->id, fact->part, fact->parts);
        group->scale[fact->part] = fmax(row_factor(source, group, fact), 0) / fact->duty;
    }
    return LS_OK;
}

enum ls_err ls_field_multiplex_find(const struct ls_field_source *source, uint32_t channel,
                                    struct ls_light_group *out, struct ls_diag *diag)
{
    const struct ls_condition_fact *first = first_row(source, channel);
    *out = (struct ls_light_group){.channel = channel};
    if (!first)
        return LS_OK;
    LS_CLEANUP_FREE uint8_t *seen = calloc(source->facts->n_lights, 1);
    if (!seen)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for multiplexed pictures");
    if (is_each_planned(source, channel, seen))
        return LS_OK;
    if (first->parts <= source->facts->n_lights ||
        first->parts > ls_multiplex_order(LS_MAX_LIGHTS) ||
        ls_multiplex_order(first->parts - 1) != first->parts)
        return ls_fail(diag, LS_ERR_INVALID,
                       "take.json: %s: no multiplexing matrix of %u lights has order %u", first->id,
                       source->facts->n_lights, first->parts);
    LS_CLEANUP_FREE uint8_t *on = calloc(first->parts, 1);
    out->scale = calloc(first->parts, sizeof *out->scale);
    if (!on || !out->scale)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for %u multiplexed pictures",
                       first->parts);
    out->order = first->parts;
    out->duty = first->duty;
    return fill_scales(source, out, on, diag);
}

/* ---- the spare column ---- */

/* A third of the way in from each corner. */
static uint32_t choose_tiles(const struct ls_field *field, uint32_t tiles[MAX_TILES])
{
    uint32_t across = ls_field_tiles_x(field), down = ls_field_tiles_y(field), n = 0;
    for (uint32_t k = 0; k < MAX_TILES; k++) {
        uint32_t x = across * (1 + k % 2) / 3, y = down * (1 + k / 2) / 3, tile = y * across + x;
        bool known = false;
        for (uint32_t j = 0; j < n; j++)
            known |= tiles[j] == tile;
        if (!known)
            tiles[n++] = tile;
    }
    return n;
}

static uint32_t tile_pixels(const struct ls_field *field, uint32_t tile)
{
    uint32_t x = tile % ls_field_tiles_x(field), y = tile / ls_field_tiles_x(field);
    const struct ls_tile_region region = {x, y, x + 1, y + 1};
    return ls_region_width_px(field, &region) * ls_region_height_px(field, &region);
}

struct samples {
    uint32_t n, order;
    float *values; /* [order][n] */
    const float **rows;
};

static void read_tile(const struct ls_picture *picture, uint32_t tile, uint32_t n, float *out)
{
    const char *halfs = picture->tiles[tile];
    uint16_t bits = 0;
    for (uint32_t j = 0; j < n; j++) {
        if (halfs)
            memcpy(&bits, halfs + 2 * (size_t)j, sizeof bits);
        float value = ls_half_to_float(bits);
        out[j] = isfinite(value) ? value : 0; /* as sums do */
    }
}

static enum ls_err read_samples(const struct ls_field *field, const struct ls_light_set *set,
                                struct samples *out, struct ls_diag *diag)
{
    uint32_t tiles[MAX_TILES], n_tiles = choose_tiles(field, tiles), order = set->group[0].order;
    uint32_t most = MAX_SAMPLES / order / n_tiles, part[MAX_TILES];
    *out = (struct samples){.order = order};
    for (uint32_t k = 0; k < n_tiles; k++) {
        part[k] = tile_pixels(field, tiles[k]);
        part[k] = part[k] < most ? part[k] : most;
        out->n += part[k];
    }
    out->values = malloc((size_t)order * out->n * sizeof *out->values);
    out->rows = calloc(order, sizeof *out->rows);
    if (!out->values || !out->rows)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for %u multiplexed pictures", order);
    for (uint32_t j = 0; j < order; j++) {
        float *to = out->values + (size_t)j * out->n;
        out->rows[j] = to;
        for (uint32_t k = 0; k < n_tiles; to += part[k++])
            read_tile(&set->pictures[j], tiles[k], part[k], to);
    }
    return LS_OK;
}

static enum ls_err look(const struct ls_field *field, const struct samples *samples, double scale,
                        struct ls_multiplex_spare *out, struct ls_diag *diag)
{
    return ls_multiplex_spare(samples->order, field->n_lights, scale, samples->rows, samples->n,
                              field->noise.read_variance, field->noise.dark_variance,
                              field->noise.shot, out, diag);
}

/* Rows as if all had the factor of the mean. */
static double level_rows(const struct ls_light_group *group, struct samples *samples)
{
    double mean = 0;
    for (uint32_t j = 0; j < group->order; j++)
        mean += group->scale[j] / group->order;
    for (uint32_t j = 0; j < group->order; j++)
        for (uint32_t k = 0; k < samples->n; k++)
            samples->values[(size_t)j * samples->n + k] *= (float)(group->scale[j] / mean);
    return mean;
}

static enum ls_err check_samples(const struct ls_field *field, const struct ls_light_group *group,
                                 struct samples *samples, struct ls_multiplex_spare *out,
                                 struct ls_diag *diag)
{
    struct ls_multiplex_spare plain;
    enum ls_err err = look(field, samples, group->scale[0], &plain, diag);
    double mean = level_rows(group, samples);
    if (!err)
        err = look(field, samples, mean, out, diag);
    if (err)
        return err;
    out->sigma = hypot(out->sigma, sag_doubt * (out->mean - plain.mean));
    out->alarm = fabs(out->mean) > 5 * out->sigma;
    return LS_OK;
}

enum ls_err ls_field_multiplex_check(struct ls_field_source *source, struct ls_diag *diag)
{
    enum ls_err err = LS_OK;
    for (uint32_t c = 0; c < source->facts->n_channels && !err; c++) {
        struct ls_light_set *set = &source->set[c];
        struct samples samples = {0};
        if (!ls_light_set_is_multiplexed(set) || ls_light_set_ready(source, set, NULL))
            continue;
        err = read_samples(&source->field, set, &samples, diag);
        if (!err)
            err = check_samples(&source->field, &set->group[0], &samples, &source->spare[c], diag);
        free(samples.values);
        free(samples.rows);
        set->group[0].spare = err ? NULL : &source->spare[c];
    }
    for (uint32_t g = 0; g < source->white.n_groups; g++)
        source->white.group[g].spare = source->set[source->white.group[g].channel].group[0].spare;
    return err;
}
