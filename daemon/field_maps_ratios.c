#include "daemon/field_maps_private.h"

#include "core/promote.h"
#include "daemon/field_segments.h"
#include "daemon/light_set.h"
#include "daemon/ratio_maps.h"
#include "daemon/separated_maps.h"

#include <stdlib.h>

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
    struct ls_map_entry made[LS_FIELD_MAX_SPECTRA];
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
        err = ls_map_entry_open(r->source, &r->made[q], r->source->field.n_channels, diag);
        maps[q] = r->made[q].file.base;
    }
    if (err)
        return err;
    return r->kind < LS_MAP_SEPARATED ? run_ratios(r, maps, diag) : run_separated(r, maps, diag);
}

enum ls_err ls_field_maps_make_ratios(struct ls_field_source *source, enum ls_field_map_kind kind,
                                      const struct ls_job *asker, struct ls_diag *diag)
{
    struct ratios r = {.source = source, .asker = asker, .kind = kind};
    struct ls_map_entry *entry = source->promoted->entry[kind];
    for (uint32_t s = 1; s < source->field.n_spectra; s++)
        if (!entry[s].map.values && !ls_field_maps_possible(source, kind, s, NULL))
            r.spectra[r.n++] = s;
    enum ls_err err = run(&r, diag);
    for (uint32_t q = 0; q < r.n; q++)
        ls_map_entry_settle(source, err, &r.made[q], &entry[r.spectra[q]]);
    free(r.f);
    free(r.v_rows);
    free(r.f_rows);
    return err;
}
