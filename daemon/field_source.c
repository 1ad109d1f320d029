#include "daemon/field_source.h"

#include "daemon/field_maps.h"
#include "daemon/field_multiplex.h"
#include "daemon/field_numbers.h"
#include "daemon/field_pictures.h"
#include "daemon/takedir.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

const struct ls_picture_map *ls_field_source_picture(const struct ls_field_source *source,
                                                     uint32_t channel, int64_t light,
                                                     const struct ls_condition_fact **fact)
{
    for (uint32_t i = 0; i < source->facts->n_conditions; i++) {
        const struct ls_condition_fact *f = &source->facts->conditions[i];
        bool one = light >= 0 && f->kind == LS_FACT_ONE && f->light == light;
        bool sphere = light < 0 && f->kind == LS_FACT_SPHERE;
        if ((!one && !sphere) || f->channel != channel || !source->maps[i].base)
            continue;
        if (fact)
            *fact = f;
        return &source->maps[i];
    }
    return NULL;
}

bool ls_field_source_planned(const struct ls_field_source *source, enum ls_fact_kind kind,
                             uint32_t channel, int64_t light)
{
    for (uint32_t i = 0; i < source->facts->n_conditions; i++) {
        const struct ls_condition_fact *f = &source->facts->conditions[i];
        if (f->kind == kind && f->channel == channel && (light < 0 || f->light == light))
            return true;
    }
    return false;
}

int ls_field_source_spectrum(const struct ls_field_source *source, uint32_t channel)
{
    for (uint32_t s = 0; s < source->field.n_spectra; s++)
        if (source->channel_of[s] == channel)
            return (int)s;
    return -1;
}

double ls_field_source_gain(const struct ls_field_source *source, uint32_t channel, uint32_t light)
{
    return source->k_all[(size_t)channel * source->facts->n_lights + light];
}

const double *ls_field_source_colour(const struct ls_field_source *source, uint32_t channel)
{
    return source->has_colour[channel]
               ? source->colour + (size_t)3 * channel * source->facts->n_lights
               : NULL;
}

double ls_field_source_factor(const struct ls_field_source *source,
                              const struct ls_condition_fact *fact)
{
    const struct ls_calibration *cal = source->facts->calibration;
    if (!cal)
        return 1 / fact->duty;
    int channel = ls_calibration_channel(cal, source->facts->channels[fact->channel].name);
    return ls_calibration_factor(cal, (uint32_t)channel, fact->pattern, fact->duty) / fact->duty;
}

enum ls_err ls_field_source_uncalibrated(const struct ls_field_source *source, const char *what,
                                         uint32_t channel, const char *pattern, double duty,
                                         struct ls_diag *diag)
{
    const struct ls_calibration *cal = source->facts->calibration;
    const char *name = source->facts->channels[channel].name;
    struct ls_diag lacks;
    ls_calibration_lacks_factor(cal, (uint32_t)ls_calibration_channel(cal, name), pattern, duty,
                                &lacks);
    return ls_fail(diag, LS_ERR_STATE, "take %s is uncalibrated for %s of %s: %s", source->take,
                   what, name, lacks.text);
}

/* ---- life ---- */

static enum ls_err fill_field(struct ls_field_source *source, const struct ls_takedir *take,
                              struct ls_diag *diag)
{
    struct ls_field *field = &source->field;
    field->n_lights = source->facts->n_lights;
    field->cfa = source->facts->cfa;
    field->n_channels = field->cfa == LS_CFA_NONE ? 1 : 3;
    field->width = source->width;
    field->height = source->height;
    enum ls_err err = ls_field_pictures_choose(source, diag);
    if (!err)
        err = ls_field_pictures_gather(source, take, diag);
    if (!err)
        err = ls_field_numbers_fill(source, diag);
    if (!err)
        err = ls_field_multiplex_check(source, diag);
    return err ? err : ls_field_check(field, diag);
}

static enum ls_err open_take(struct ls_field_source *source, const struct ls_takedir *take,
                             struct ls_diag *diag)
{
    enum ls_err err = ls_field_maps_create(&source->promoted, diag);
    if (!err)
        err = ls_take_facts_read(take->take_json, source->camera, &source->facts, diag);
    if (!err)
        err = ls_field_pictures_map(source, take, diag);
    return err ? err : fill_field(source, take, diag);
}

enum ls_err ls_field_source_open(const char *storage, const char *id, uint32_t camera,
                                 struct ls_field_source **out, struct ls_diag *diag)
{
    char folder[4096];
    struct ls_takedir *take = NULL;
    if (!ls_takedir_id_ok(id))
        return ls_fail(diag, LS_ERR_NOT_FOUND, "\"%.64s\" is not the name of a take", id);
    if (snprintf(folder, sizeof folder, "%s/%s", storage, id) >= (int)sizeof folder)
        return ls_fail(diag, LS_ERR_INVALID, "%s: the path is too long", storage);
    enum ls_err err = ls_takedir_open(folder, &take, diag);
    if (err)
        return err;
    struct ls_field_source *source = calloc(1, sizeof *source);
    if (!source) {
        ls_takedir_close(take);
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory opening a take's field");
    }
    source->camera = camera;
    snprintf(source->take, sizeof source->take, "%s", id);
    snprintf(source->storage, sizeof source->storage, "%s", storage);
    err = open_take(source, take, diag);
    ls_takedir_close(take);
    if (err)
        ls_field_source_close(source);
    else
        *out = source;
    return err;
}

enum ls_err ls_field_source_sound(const struct ls_field_source *source, bool sizes,
                                  struct ls_diag *diag)
{
    for (uint32_t i = 0; i < source->facts->n_conditions; i++) {
        const struct ls_picture_map *map = &source->maps[i];
        if (map->base && (!ls_picture_map_sound(map) || (sizes && !ls_picture_map_whole(map))))
            return ls_fail(
                diag, LS_ERR_INVALID,
                "%s: cut short, removed or unreadable; \"take verify\" says what is left",
                map->path);
    }
    return LS_OK;
}

void ls_field_source_close(struct ls_field_source *source)
{
    if (!source)
        return;
    ls_field_maps_destroy(source->promoted);
    ls_field_pictures_free(source);
    ls_field_numbers_free(source);
    ls_take_facts_destroy(source->facts);
    free(source);
}
