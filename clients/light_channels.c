#include "clients/light_solver.h"

#include <stdio.h>

static void name_channel(struct ls_light_solver *solver, struct ls_light_weights *out, uint32_t c)
{
    const struct ls_take_document *d = solver->document;
    int column = d->calibration ? ls_calibration_channel(d->calibration, d->channels[c].name) : 0;
    if (column < 0)
        return;
    solver->columns[out->n_names] = (uint32_t)column;
    out->names[out->n_names++] = (char *)d->channels[c].name;
}

/* Did the plan ask for what the model makes a spectrum's single lights of? */
static bool is_served(const struct ls_take_document *d, uint32_t c, enum lightstage_model model)
{
    switch (model) {
    case LIGHTSTAGE_MEASURED:
        return d->channels[c].each;
    case LIGHTSTAGE_HEADLIGHT:
        return d->channels[c].headlight || d->channels[c].each;
    case LIGHTSTAGE_LINEAR:
        return d->channels[c].segments || d->channels[c].each;
    default:
        return d->channels[c].sphere;
    }
}

static bool is_photographed(const struct ls_take_document *d, uint32_t c)
{
    return d->channels[c].each || d->channels[c].sphere || d->channels[c].headlight ||
           d->channels[c].segments;
}

/* "R A B": photographed, but not as the model needs it. */
static void list_left_out(const struct ls_take_document *d, uint32_t white,
                          enum lightstage_model model, char *out, size_t size)
{
    size_t at = 0;
    out[0] = '\0';
    for (uint32_t c = 0; c < d->n_channels && at < size; c++)
        if (c != white && d->channels[c].spectrum && is_photographed(d, c) &&
            !is_served(d, c, model))
            at += (size_t)snprintf(out + at, size - at, "%s%s", at ? " " : "", d->channels[c].name);
}

static enum ls_err tell_left_out(const struct ls_light_solver *solver, uint32_t white,
                                 struct ls_light_weights *out, struct ls_diag *diag)
{
    const char *model = lightstage_model_name(solver->options->model);
    char names[128];
    list_left_out(solver->document, white, solver->options->model, names, sizeof names);
    if (!names[0])
        return LS_OK;
    if (out->n_names == 1)
        return ls_fail(diag, LS_ERR_UNSUPPORTED,
                       "the take has nothing for model %s but white (of %s it has other pictures): "
                       "choose another --model, or --solve tristimulus",
                       model, names);
    snprintf(out->left_out, sizeof out->left_out,
             "not used, because model %s has no pictures of them it can use: %s", model, names);
    return LS_OK;
}

/* The first spectrum of single lights; where they were photographed behind both polarisers only,
 * whose sum is white, the first spectrum. */
static uint32_t find_white(const struct ls_take_document *d)
{
    uint32_t white = d->n_channels, first = d->n_channels, polarised = 0;
    for (uint32_t c = d->n_channels; c-- > 0;) {
        polarised += d->channels[c].each && !d->channels[c].spectrum;
        if (d->channels[c].spectrum)
            first = c;
        if (d->channels[c].each && d->channels[c].spectrum)
            white = c;
    }
    return white == d->n_channels && polarised >= 2 ? first : white;
}

enum ls_err ls_light_channels(struct ls_light_solver *solver, struct ls_light_weights *out,
                              struct ls_diag *diag)
{
    const struct ls_take_document *d = solver->document;
    uint32_t white = find_white(d);
    if (white == d->n_channels)
        return ls_fail(diag, LS_ERR_UNSUPPORTED,
                       "the take was not photographed light by light: it cannot be relit");
    name_channel(solver, out, white);
    if (!d->calibration || solver->options->solve == LS_LIGHT_TRISTIMULUS)
        return LS_OK;
    for (uint32_t c = 0; c < d->n_channels; c++)
        if (c != white && d->channels[c].spectrum && is_served(d, c, solver->options->model))
            name_channel(solver, out, c);
    return tell_left_out(solver, white, out, diag);
}
