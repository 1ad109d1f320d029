#include "daemon/separation.h"

#include "daemon/light_set.h"

#include <stdlib.h>

static const struct ls_light_set *set_of(const struct ls_field_source *source, int32_t channel)
{
    return &source->set[channel];
}

enum ls_err ls_separation_possible(const struct ls_field_source *source, struct ls_diag *diag)
{
    const int32_t channels[2] = {source->vertical, source->horizontal};
    if (source->vertical < 0)
        return ls_fail(diag, LS_ERR_NOT_FOUND,
                       "the rig of take %s has no pair of channels of kind polariser",
                       source->take);
    for (int v = 0; v < 2; v++) {
        const char *name = source->facts->channels[channels[v]].name;
        uint32_t found = set_of(source, channels[v])->n_found;
        if (ls_light_set_is_multiplexed(set_of(source, channels[v])))
            return ls_fail(
                diag, LS_ERR_STATE,
                "the lights under %s of take %s were multiplexed, and a separation looks "
                "at each light of each pixel: it needs them one by one (a condition of "
                "kind \"each\")",
                name, source->take);
        if (!ls_field_source_planned(source, LS_FACT_ONE, (uint32_t)channels[v], -1))
            return ls_fail(diag, LS_ERR_NOT_FOUND,
                           "the plan of take %s has no pictures of single lights under %s (a "
                           "condition of kind \"each\" for both polarisers makes them)",
                           source->take, name);
        if (found < source->field.n_lights)
            return ls_fail(diag, LS_ERR_STATE,
                           "take %s has %u of %u pictures of single lights under %s: a separation "
                           "needs all; resume the take",
                           source->take, found, source->field.n_lights, name);
    }
    return LS_OK;
}

static enum ls_err factors_of(const struct ls_field_source *source, uint32_t light, bool ideal,
                              struct ls_polarisation *out, struct ls_diag *diag)
{
    struct ls_polarisation_path path = {.camera_up = {0, 1, 0}};
    const struct ls_take_facts *facts = source->facts;
    const struct ls_calibration *cal = facts->calibration;
    size_t at = (size_t)source->camera * facts->n_lights + light;
    *out = ls_polarisation_ideal();
    if (ideal)
        return LS_OK;
    if (cal && cal->n_polarised > source->camera) {
        *out = (struct ls_polarisation){(double)cal->a_v[at], (double)cal->a_h[at]};
        return LS_OK;
    }
    for (int a = 0; a < 3; a++) {
        path.light[a] = (double)facts->position_m[light][a];
        path.camera[a] = (double)facts->camera_position_m[a];
    }
    return ls_polarisation_assume(&path, out, diag);
}

static enum ls_err make_splits(struct ls_separation *separation,
                               const struct ls_field_source *source, bool ideal,
                               struct ls_diag *diag)
{
    enum ls_err err = LS_OK;
    separation->split = calloc(source->field.n_lights, sizeof *separation->split);
    if (!separation->split)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for a separation");
    for (uint32_t i = 0; i < source->field.n_lights && !err; i++) {
        struct ls_polarisation a;
        err = factors_of(source, i, ideal, &a, diag);
        if (!err)
            err = ls_split_make(a, set_of(source, source->vertical)->group[0].k[i],
                                set_of(source, source->horizontal)->group[0].k[i],
                                &separation->split[i], diag);
        separation->inseparable += !err && ls_split_inseparable(&separation->split[i]);
    }
    return err;
}

enum ls_err ls_separation_init(struct ls_separation *separation,
                               const struct ls_field_source *source, bool ideal, bool plain,
                               struct ls_diag *diag)
{
    const struct ls_field *field = &source->field;
    *separation = (struct ls_separation){0};
    enum ls_err err = ls_separation_possible(source, diag);
    if (!err)
        err = make_splits(separation, source, ideal, diag);
    if (err)
        return err;
    for (int c = 0; c < 3; c++)
        separation->white[c] = source->neutral_vh[0][c] + source->neutral_vh[1][c];
    separation->field =
        (struct ls_separated_field){.n_lights = field->n_lights,
                                    .n_channels = field->n_channels,
                                    .width = field->width,
                                    .height = field->height,
                                    .cfa = field->cfa,
                                    .v = set_of(source, source->vertical)->pictures,
                                    .h = set_of(source, source->horizontal)->pictures,
                                    .split = separation->split,
                                    .noise = field->noise,
                                    .v_max = set_of(source, source->vertical)->tile_max,
                                    .h_max = set_of(source, source->horizontal)->tile_max};
    return field->n_channels == 3 ? ls_conductor_make(separation->white, LS_CONDUCTOR_THRESHOLD,
                                                      plain, &separation->field.conductor, diag)
                                  : LS_OK;
}

void ls_separation_tint(const struct ls_separation *separation,
                        const struct ls_field_source *source, uint32_t s, double tint[3])
{
    const struct ls_field *field = &source->field;
    for (uint32_t c = 0; c < field->n_channels; c++)
        tint[c] = field->p[s * field->n_channels + c] / separation->white[c];
}

void ls_separation_finish(struct ls_separation *separation)
{
    free(separation->split);
    separation->split = NULL;
}
