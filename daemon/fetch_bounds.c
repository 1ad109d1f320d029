/* What no sample of a tile exceeds, told from the maxima that are stored with each picture. */
#include "daemon/fetch_private.h"

#include "core/factored.h"
#include "core/half.h"

#include <math.h>
#include <stdlib.h>

/* Of the filters of core/demosaic: their coefficients' magnitudes add to 20/8 at most, and to 1. */
static const double gradient_gain = 2.5, bilinear_gain = 1;
static const double float_rounding = 1e-5; /* relative; demosaicing 2e-6, gains 2^-23 each */

/* No nearest half of what is at most @v is larger. */
static double rounded(double v)
{
    return v == 0 ? 0 : v * (1 + 0x1p-11) + 0x1p-25;
}

/* ---- ratios ---- */

static uint32_t n_tiles(const struct ls_field *field)
{
    return ls_field_tiles_x(field) * ls_field_tiles_y(field);
}

static float most_of_tile(const struct ls_field_source *source, const struct ls_field_map *map,
                          uint32_t x0, uint32_t y0)
{
    uint32_t x1 = x0 + LS_TILE_SIDE < source->width ? x0 + LS_TILE_SIDE : source->width;
    uint32_t y1 = y0 + LS_TILE_SIDE < source->height ? y0 + LS_TILE_SIDE : source->height;
    float most = 0;
    for (uint32_t y = y0; y < y1; y++) {
        const float *row = map->values + ((size_t)y * source->width + x0) * map->depth;
        for (size_t k = 0; k < (size_t)(x1 - x0) * map->depth; k++)
            most = fabsf(row[k]) > most ? fabsf(row[k]) : most;
    }
    return most;
}

static void measure_ratio(const struct ls_field_source *source, const struct ls_field_map *map,
                          uint16_t *most)
{
    for (uint32_t y = 0; y < source->height; y += LS_TILE_SIDE)
        for (uint32_t x = 0; x < source->width; x += LS_TILE_SIDE)
            *most++ = ls_half_from_float(most_of_tile(source, map, x, y));
}

static enum ls_err measure_ratios(struct ls_fetch_job *self, struct ls_diag *diag)
{
    const struct ls_factored *f = &self->factored;
    uint32_t n = n_tiles(&self->source->field);
    bool one = !f->wanted && self->now->way.kind == LS_WAY_RATIO;
    if (self->now->ratio_most || !(f->wanted || one))
        return LS_OK;
    self->now->ratio_most = calloc((size_t)n * (one ? 1 : f->n), sizeof *self->now->ratio_most);
    if (!self->now->ratio_most)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    if (one)
        measure_ratio(self->source, self->now->way.map, self->now->ratio_most);
    for (uint32_t s = 0; s < f->n; s++)
        measure_ratio(self->source, f->ways[s].map, self->now->ratio_most + (size_t)s * n);
    return LS_OK;
}

/* ---- pictures ---- */

static double stored_most(const struct ls_fetch_job *self, uint32_t tile)
{
    const struct ls_light_set *set = self->now->way.set; /* light by light */
    return (double)set->tile_max[(size_t)tile * set->n_pictures + self->lights[self->light]];
}

/* Of it and those around it: demosaicing looks over the edge. */
static double most_around(const struct ls_fetch_job *self, uint32_t tile)
{
    const struct ls_field *field = &self->source->field;
    uint32_t across = ls_field_tiles_x(field), down = ls_field_tiles_y(field);
    uint32_t x = tile % across, y = tile / across;
    double most = 0;
    for (uint32_t v = y ? y - 1 : 0; v <= y + 1 && v < down; v++)
        for (uint32_t u = x ? x - 1 : 0; u <= x + 1 && u < across; u++)
            most = fmax(most, stored_most(self, v * across + u));
    return most;
}

static double demosaiced_most(const struct ls_fetch_job *self, uint32_t tile)
{
    const struct ls_field *field = &self->source->field;
    if (!self->rgb || field->n_channels == 1)
        return stored_most(self, tile);
    double gain = field->demosaic == LS_DEMOSAIC_BILINEAR ? bilinear_gain : gradient_gain;
    return gain * (1 + float_rounding) * most_around(self, tile);
}

static double most_of(const void *user, uint32_t tile)
{
    const struct ls_fetch_job *self = user;
    double most = demosaiced_most(self, tile), gain = self->bounded_gain * (1 + float_rounding);
    if (self->estimate && !self->rgb)
        return most;
    if (self->factored.wanted)
        return rounded(most);
    if (self->now->ratio_most)
        return rounded(rounded(most) * gain *
                       (double)ls_half_to_float(self->now->ratio_most[tile]));
    return self->half ? rounded(most * gain) : most * gain;
}

/* What white comes to under the client's ratios, and alone: of magnitudes, all steps of that are
 * monotonous. */
static double expanded_most(const void *user, uint32_t tile, double most)
{
    const struct ls_fetch_job *self = user;
    uint16_t white = ls_half_from_float((float)most), made[1 + LS_FIELD_MAX_SPECTRA];
    double off = 0;
    if (!(most <= (double)LS_HALF_MAX))
        return INFINITY;
    ls_factored_expand(&white, (float)self->bounded_gain, NULL, 1, &made[0]);
    for (uint32_t s = 0; s < self->factored.n; s++) {
        const uint16_t *ratio =
            self->now->ratio_most + (size_t)s * n_tiles(&self->source->field) + tile;
        if (!isfinite(ls_half_to_float(*ratio)))
            return INFINITY;
        ls_factored_expand(&white, (float)self->bounded_gain, ratio, 1, &made[1 + s]);
    }
    for (uint32_t s = 0; s <= self->factored.n; s++)
        off = fmax(off, (double)ls_half_to_float(made[s]));
    return off;
}

/* A ratio belongs to lights that are not known here. */
static double never(const void *user, uint32_t tile, double most)
{
    return INFINITY;
}

enum ls_err ls_fetch_bound_tiles(struct ls_fetch_job *self, const struct ls_fetch_picture *picture,
                                 bool by_pixel, struct ls_diag *diag)
{
    bool ratio = ls_factored_is_ratio(&self->factored);
    struct ls_tiles_bounds *bounds = &self->tiles.bounds;
    if (self->tiles.max_error == 0)
        return LS_OK;
    self->bounded_gain = fabs(picture->gain);
    bounds->user = self;
    bounds->most = by_pixel && !ratio && !self->full_sphere ? most_of : NULL;
    if (self->factored.wanted)
        bounds->off = ratio ? never : expanded_most;
    return by_pixel ? measure_ratios(self, diag) : LS_OK;
}
