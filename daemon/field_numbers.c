#include "daemon/field_numbers.h"

#include "core/envlights.h"

#include <math.h>
#include <stdlib.h>

static enum ls_err out_of_memory(struct ls_diag *diag)
{
    return ls_fail(diag, LS_ERR_NOMEM, "out of memory for a take's gains");
}

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

/* Of a channel: on each camera colour; a mono camera's one is part of k. */
static void fill_colours(struct ls_field_source *source, const struct ls_calibration *cal,
                         uint32_t channel, uint32_t from)
{
    size_t n = source->facts->n_lights, colours = cal->n_colours;
    const float *factors = cal->k_colour + from * n * colours;
    for (size_t i = 0; i < n && colours == 1; i++)
        source->k_all[channel * n + i] *= (double)factors[i];
    for (size_t j = 0; j < n * colours && colours == 3; j++) {
        source->colour[channel * n * 3 + j] = (double)factors[j];
        source->has_colour[channel] |= factors[j] != 1;
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
        if (cal->k_colour)
            fill_colours(source, cal, c, (uint32_t)from);
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
    source->factor[s] = source->has_sphere[s]
                            ? ls_calibration_factor(cal, (uint32_t)from, "sphere", source->duty[s])
                            : 1;
}

static void fill_polarised(struct ls_field_source *source, const struct ls_calibration *cal)
{
    const int32_t channels[2] = {source->vertical, source->horizontal};
    for (int v = 0; v < 2; v++)
        for (uint32_t c = 0; c < 3; c++)
            source->neutral_vh[v][c] = 0.5;
    for (int v = 0; v < 2 && cal && channels[0] >= 0; v++) {
        int from = ls_calibration_channel(cal, source->facts->channels[channels[v]].name);
        for (uint32_t c = 0; c < cal->n_colours; c++)
            source->neutral_vh[v][c] = (double)cal->p[from][c];
    }
}

static void fill_set(const struct ls_field_source *source, struct ls_light_set *set)
{
    for (uint32_t g = 0; g < set->n_groups; g++) {
        struct ls_light_group *group = &set->group[g];
        group->k = source->k_all + (size_t)group->channel * source->facts->n_lights;
        group->colour = ls_field_source_colour(source, group->channel);
    }
}

static void fill_sets(struct ls_field_source *source)
{
    for (uint32_t c = 0; c < source->facts->n_channels; c++)
        fill_set(source, &source->set[c]);
    fill_set(source, &source->white);
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
    if (cal->k_colour)
        source->colour =
            calloc((size_t)3 * field->n_lights * source->facts->n_channels, sizeof(double));
    if (cal->k_colour && !source->colour)
        return out_of_memory(diag);
    enum ls_err err = fill_gains(source, cal, diag);
    if (err)
        return err;
    source->calibrated = true;
    field->scale = cal->scale / source->facts->reference_exposure_s;
    for (uint32_t i = 0; i < field->n_lights; i++)
        source->omega_sr[i] = (double)cal->omega_sr[i];
    for (uint32_t s = 0; s < field->n_spectra; s++)
        fill_spectrum(source, cal, s);
    fill_polarised(source, cal);
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

enum ls_err ls_field_numbers_fill(struct ls_field_source *source, struct ls_diag *diag)
{
    enum ls_err err = allocate_numbers(source, diag);
    if (!err)
        err = fill_directions(source, diag);
    if (err)
        return err;
    fill_duties(source);
    fill_noise(source);
    fill_polarised(source, NULL);
    if (source->facts->calibration)
        err = fill_calibrated(source, diag);
    else
        fill_uncalibrated(source);
    fill_sets(source);
    return err;
}

void ls_field_numbers_free(struct ls_field_source *source)
{
    free(source->k);
    free(source->g);
    free(source->omega_sr);
    free(source->p);
    free(source->duty);
    free(source->factor);
    free(source->directions);
    free(source->k_all);
    free(source->colour);
}
