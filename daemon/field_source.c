#include "daemon/field_source.h"

#include "core/envlights.h"
#include "core/half.h"
#include "daemon/ratio_maps.h"
#include "daemon/takedir.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static enum ls_err out_of_memory(struct ls_diag *diag)
{
    return ls_fail(diag, LS_ERR_NOMEM, "out of memory opening a take's field");
}

/* ---- pictures ---- */

static enum ls_err map_pictures(struct ls_field_source *source, const struct ls_takedir *take,
                                struct ls_diag *diag)
{
    const struct ls_take_facts *facts = source->facts;
    enum ls_err err = LS_OK;
    source->maps = calloc(facts->n_conditions, sizeof *source->maps);
    if (!source->maps)
        return out_of_memory(diag);
    for (uint32_t i = 0; i < facts->n_conditions && !err; i++) {
        const struct ls_condition_fact *fact = &facts->conditions[i];
        if (fact->kind != LS_FACT_ONE && fact->kind != LS_FACT_SPHERE)
            continue;
        const struct ls_published *p = ls_takedir_find(take, fact->id, source->camera);
        if (!p)
            continue;
        if (source->width == 0) {
            source->width = p->width;
            source->height = p->height;
        }
        err = ls_picture_map_open(&source->maps[i], take->folder, p->file, source->width,
                                  source->height, diag);
    }
    if (!err && source->width == 0)
        return ls_fail(diag, LS_ERR_STATE, "take %s has no picture of any light yet", source->take);
    return err;
}

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

/* ---- spectra ---- */

/* White is the first channel of kind spectrum photographed light by light. */
static enum ls_err choose_spectra(struct ls_field_source *source, struct ls_diag *diag)
{
    const struct ls_take_facts *facts = source->facts;
    bool one[LS_MAX_CHANNELS] = {false}, sphere[LS_MAX_CHANNELS] = {false};
    uint32_t white = facts->n_channels, n = 0;
    for (uint32_t i = 0; i < facts->n_conditions; i++) {
        one[facts->conditions[i].channel] |= facts->conditions[i].kind == LS_FACT_ONE;
        sphere[facts->conditions[i].channel] |=
            facts->conditions[i].kind == LS_FACT_SPHERE && source->maps[i].base;
    }
    for (uint32_t c = facts->n_channels; c-- > 0;)
        if (one[c] && !facts->channels[c].polariser)
            white = c;
    if (white == facts->n_channels)
        return ls_fail(diag, LS_ERR_STATE, "take %s was not photographed light by light",
                       source->take);
    source->channel_of[n] = white;
    source->has_sphere[n++] = sphere[white];
    for (uint32_t c = 0; c < facts->n_channels; c++) {
        if (c == white || !sphere[c] || facts->channels[c].polariser)
            continue;
        source->channel_of[n] = c;
        source->has_sphere[n++] = true;
    }
    source->field.n_spectra = n;
    return LS_OK;
}

static const void *const *tiles_of(const struct ls_picture_map *map)
{
    return (const void *const *)map->tiles.tile;
}

static enum ls_err gather_pictures(struct ls_field_source *source, struct ls_diag *diag)
{
    struct ls_field *field = &source->field;
    size_t n_tiles = (size_t)ls_field_tiles_x(field) * ls_field_tiles_y(field);
    source->white = calloc(field->n_lights, sizeof *source->white);
    source->sphere = calloc(field->n_spectra, sizeof *source->sphere);
    source->no_tiles = calloc(n_tiles, sizeof *source->no_tiles);
    if (!source->white || !source->sphere || !source->no_tiles)
        return out_of_memory(diag);
    for (uint32_t i = 0; i < field->n_lights; i++)
        source->white[i].tiles = source->no_tiles;
    for (uint32_t i = 0; i < source->facts->n_conditions; i++) {
        const struct ls_condition_fact *f = &source->facts->conditions[i];
        if (f->kind != LS_FACT_ONE || f->channel != source->channel_of[0] || !source->maps[i].base)
            continue;
        source->n_white += source->white[f->light].tiles == source->no_tiles;
        source->white[f->light].tiles = tiles_of(&source->maps[i]);
    }
    for (uint32_t s = 0; s < field->n_spectra; s++) {
        const struct ls_picture_map *map =
            ls_field_source_picture(source, source->channel_of[s], -1, NULL);
        source->sphere[s].tiles = map ? tiles_of(map) : source->no_tiles;
    }
    field->white = source->white;
    field->sphere = source->sphere;
    return LS_OK;
}

static enum ls_err gather_maxima(struct ls_field_source *source, const struct ls_takedir *take,
                                 struct ls_diag *diag)
{
    const struct ls_field *field = &source->field;
    uint32_t n_tiles = ls_field_tiles_x(field) * ls_field_tiles_y(field);
    source->tile_max = calloc((size_t)n_tiles * field->n_lights, sizeof(float));
    if (!source->tile_max)
        return out_of_memory(diag);
    for (uint32_t i = 0; i < source->facts->n_conditions; i++) {
        const struct ls_condition_fact *f = &source->facts->conditions[i];
        const struct ls_published *p = ls_takedir_find(take, f->id, source->camera);
        if (f->kind != LS_FACT_ONE || f->channel != source->channel_of[0] || !p)
            continue;
        if (p->n_tiles != n_tiles)
            return ls_fail(diag, LS_ERR_INVALID, "%s: the journal has %u tiles, expected %u",
                           p->file, p->n_tiles, n_tiles);
        for (uint32_t t = 0; t < n_tiles; t++)
            source->tile_max[(size_t)t * field->n_lights + f->light] =
                ls_half_to_float((uint16_t)p->tile_max[t]);
    }
    return LS_OK;
}

/* ---- numbers ---- */

static enum ls_err allocate_numbers(struct ls_field_source *source, struct ls_diag *diag)
{
    struct ls_field *field = &source->field;
    size_t n = field->n_lights, s = field->n_spectra;
    source->k = calloc(s * n, sizeof(double));
    source->g = calloc(s * n, sizeof(double));
    source->omega_sr = calloc(n, sizeof(double));
    source->p = calloc(s * field->n_channels, sizeof(double));
    source->duty = calloc(s, sizeof(double));
    source->factor = calloc(s, sizeof(double));
    source->directions = calloc(n, sizeof *source->directions);
    source->k_all = calloc(n * source->facts->n_channels, sizeof(double));
    if (!source->k || !source->g || !source->omega_sr || !source->p || !source->duty ||
        !source->factor || !source->directions || !source->k_all)
        return out_of_memory(diag);
    field->k = source->k;
    field->g = source->g;
    field->omega_sr = source->omega_sr;
    field->p = source->p;
    field->duty = source->duty;
    field->factor = source->factor;
    field->directions = (const float(*)[3])source->directions;
    return LS_OK;
}

static enum ls_err fill_directions(struct ls_field_source *source, struct ls_diag *diag)
{
    const struct ls_take_facts *facts = source->facts;
    for (uint32_t i = 0; i < facts->n_lights; i++) {
        const float *x = facts->position_m[i];
        double length = sqrt((double)x[0] * x[0] + (double)x[1] * x[1] + (double)x[2] * x[2]);
        if (!(length > 0))
            return ls_fail(diag, LS_ERR_INVALID, "take.json: light %u stands at the origin", i);
        for (int a = 0; a < 3; a++)
            source->directions[i][a] = (float)(x[a] / length);
    }
    return ls_envlights_omega((const float(*)[3])source->directions, facts->n_lights,
                              source->omega_sr, diag);
}

static void fill_uncalibrated(struct ls_field_source *source)
{
    struct ls_field *field = &source->field;
    source->calibrated = false;
    field->scale = 1;
    for (size_t i = 0; i < (size_t)field->n_lights * source->facts->n_channels; i++)
        source->k_all[i] = 1;
    for (uint32_t s = 0; s < field->n_spectra; s++) {
        for (uint32_t i = 0; i < field->n_lights; i++)
            source->k[(size_t)s * field->n_lights + i] =
                source->g[(size_t)s * field->n_lights + i] = 1;
        for (uint32_t c = 0; c < field->n_channels; c++)
            source->p[s * field->n_channels + c] = 1;
        source->factor[s] = 1;
    }
}

static enum ls_err fill_gains(struct ls_field_source *source, const struct ls_calibration *cal,
                              struct ls_diag *diag)
{
    const struct ls_take_facts *facts = source->facts;
    for (uint32_t c = 0; c < facts->n_channels; c++) {
        int from = ls_calibration_channel(cal, facts->channels[c].name);
        if (from < 0)
            return ls_fail(diag, LS_ERR_INVALID, "the take's calibration lacks channel %s",
                           facts->channels[c].name);
        for (uint32_t i = 0; i < facts->n_lights; i++) {
            double k = (double)cal->k[(size_t)from * facts->n_lights + i];
            if (!(k > 0))
                return ls_fail(diag, LS_ERR_INVALID,
                               "the take's calibration: k of channel %s, light %u is not positive",
                               facts->channels[c].name, i);
            source->k_all[(size_t)c * facts->n_lights + i] = k;
        }
    }
    return LS_OK;
}

static void fill_spectrum(struct ls_field_source *source, const struct ls_calibration *cal,
                          uint32_t s)
{
    struct ls_field *field = &source->field;
    uint32_t channel = source->channel_of[s];
    int from = ls_calibration_channel(cal, source->facts->channels[channel].name);
    for (uint32_t i = 0; i < field->n_lights; i++) {
        double k = ls_field_source_gain(source, channel, i);
        source->k[(size_t)s * field->n_lights + i] = k;
        source->g[(size_t)s * field->n_lights + i] = 1 / k;
    }
    for (uint32_t c = 0; c < field->n_channels; c++)
        source->p[s * field->n_channels + c] = (double)cal->p[from][c];
    source->factor[s] = ls_calibration_factor(cal, (uint32_t)from, "sphere", source->duty[s]);
}

/* A sphere at a duty nobody calibrated would be silently scaled: it is not there at all. */
static void drop_uncalibrated_spheres(struct ls_field_source *source)
{
    for (uint32_t s = 0; s < source->field.n_spectra; s++)
        if (!(source->factor[s] > 0)) {
            source->factor[s] = 1;
            source->has_sphere[s] = false;
        }
}

static void fill_duties(struct ls_field_source *source)
{
    for (uint32_t s = 0; s < source->field.n_spectra; s++) {
        const struct ls_condition_fact *fact = NULL;
        ls_field_source_picture(source, source->channel_of[s], -1, &fact);
        source->duty[s] = fact ? fact->duty : 1;
    }
}

static enum ls_err fill_calibrated(struct ls_field_source *source, struct ls_diag *diag)
{
    const struct ls_calibration *cal = source->facts->calibration;
    struct ls_field *field = &source->field;
    if (cal->n_colours != field->n_channels)
        return ls_fail(diag, LS_ERR_INVALID,
                       "the take's calibration is for %u camera channels, the camera has %u",
                       cal->n_colours, field->n_channels);
    enum ls_err err = fill_gains(source, cal, diag);
    if (err)
        return err;
    source->calibrated = true;
    field->scale = cal->scale / source->facts->reference_exposure_s;
    for (uint32_t i = 0; i < field->n_lights; i++)
        source->omega_sr[i] = (double)cal->omega_sr[i];
    for (uint32_t s = 0; s < field->n_spectra; s++)
        fill_spectrum(source, cal, s);
    drop_uncalibrated_spheres(source);
    return LS_OK;
}

/* Of a dim pixel, where the whole bracket counts with weights w' = t / sigma^2: var(E) =
 * sigma^2 / sum t^2, and shot noise of E adds E sum t^3 / (sum t^2)^2. */
static void fill_noise(struct ls_field_source *source)
{
    const struct ls_take_facts *facts = source->facts;
    double t2 = 0, t3 = 0, repeats = 1, full = facts->full_scale_dn;
    double reference = facts->reference_exposure_s;
    double sigma2 = facts->read_noise_dn * facts->read_noise_dn + 1.0 / 12;
    for (uint32_t i = 0; i < facts->n_exposures; i++) {
        double t = facts->exposure_s[i];
        t2 += t * t;
        t3 += t * t * t;
    }
    for (uint32_t i = 0; i < facts->n_conditions; i++)
        if (facts->conditions[i].kind == LS_FACT_DARK && !facts->conditions[i].watch &&
            facts->conditions[i].repeats > 1)
            repeats = facts->conditions[i].repeats;
    source->field.noise = (struct ls_field_noise){
        .read_variance = sigma2 * reference * reference / (full * full * t2),
        .dark_variance = sigma2 * reference * reference / (full * full * t2) / repeats,
        .shot = reference * t3 / (full * facts->electrons_per_dn * t2 * t2),
    };
}

static enum ls_err fill_field(struct ls_field_source *source, struct ls_diag *diag)
{
    struct ls_field *field = &source->field;
    field->n_lights = source->facts->n_lights;
    field->cfa = source->facts->cfa;
    field->n_channels = field->cfa == LS_CFA_NONE ? 1 : 3;
    field->width = source->width;
    field->height = source->height;
    enum ls_err err = choose_spectra(source, diag);
    if (!err)
        err = gather_pictures(source, diag);
    if (!err)
        err = allocate_numbers(source, diag);
    if (!err)
        err = fill_directions(source, diag);
    if (err)
        return err;
    fill_duties(source);
    fill_noise(source);
    if (source->facts->calibration)
        return fill_calibrated(source, diag);
    fill_uncalibrated(source);
    return LS_OK;
}

/* ---- promotion ---- */

enum ls_err ls_field_source_promotable(const struct ls_field_source *source, uint32_t s,
                                       struct ls_diag *diag)
{
    const char *name = source->facts->channels[source->channel_of[s]].name;
    if (!source->has_sphere[s])
        return ls_fail(diag, LS_ERR_STATE,
                       "take %s has no full sphere of channel %s whose duty is calibrated: it "
                       "cannot be promoted",
                       source->take, name);
    if (source->n_white < source->field.n_lights)
        return ls_fail(diag, LS_ERR_STATE,
                       "take %s has %u of %u lights: promotion to %s needs all; resume the take",
                       source->take, source->n_white, source->field.n_lights, name);
    return LS_OK;
}

static enum ls_err make_ratios(struct ls_field_source *source, struct ls_diag *diag)
{
    uint32_t spectra[LS_FIELD_MAX_SPECTRA], n = 0;
    for (uint32_t s = 1; s < source->field.n_spectra; s++)
        if (source->has_sphere[s])
            spectra[n++] = s;
    return ls_ratio_maps_make(&source->field, spectra, n, source->ratio, diag);
}

enum ls_err ls_field_source_ratio(struct ls_field_source *source, uint32_t s, const float **ratio,
                                  struct ls_diag *diag)
{
    enum ls_err err = ls_field_source_promotable(source, s, diag);
    if (err)
        return err;
    g_mutex_lock(&source->ratio_lock);
    if (!source->ratio[s])
        err = make_ratios(source, diag);
    if (!err)
        err = ls_field_source_sound(source, false, diag);
    *ratio = source->ratio[s];
    g_mutex_unlock(&source->ratio_lock);
    return err;
}

/* ---- life ---- */

static enum ls_err open_take(struct ls_field_source *source, const struct ls_takedir *take,
                             struct ls_diag *diag)
{
    enum ls_err err = ls_take_facts_read(take->take_json, source->camera, &source->facts, diag);
    if (!err)
        err = map_pictures(source, take, diag);
    if (!err)
        err = fill_field(source, diag);
    if (!err)
        err = gather_maxima(source, take, diag);
    return err ? err : ls_field_check(&source->field, diag);
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
        return out_of_memory(diag);
    }
    g_mutex_init(&source->ratio_lock);
    source->camera = camera;
    snprintf(source->take, sizeof source->take, "%s", id);
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
        if (map->base &&
            (!ls_picture_map_sound(map) || (sizes && !ls_picture_map_whole(map))))
            return ls_fail(diag, LS_ERR_INVALID,
                           "%s: cut short, removed or unreadable; \"take verify\" says what is left",
                           map->path);
    }
    return LS_OK;
}

void ls_field_source_close(struct ls_field_source *source)
{
    if (!source)
        return;
    for (uint32_t i = 0; source->maps && i < source->facts->n_conditions; i++)
        ls_picture_map_finish(&source->maps[i]);
    for (uint32_t s = 0; s < LS_FIELD_MAX_SPECTRA; s++)
        free(source->ratio[s]);
    free(source->maps);
    free(source->white);
    free(source->sphere);
    free(source->no_tiles);
    free(source->k);
    free(source->g);
    free(source->omega_sr);
    free(source->p);
    free(source->duty);
    free(source->factor);
    free(source->directions);
    free(source->k_all);
    free(source->tile_max);
    ls_take_facts_destroy(source->facts);
    g_mutex_clear(&source->ratio_lock);
    free(source);
}
