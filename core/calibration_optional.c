#include "core/calibration.h"
#include "core/calibration_json.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const struct {
    const char *name;
    uint8_t bit;
} flag_names[] = {
    {"one-sided", LS_LIGHT_ONE_SIDED}, {"dead", LS_LIGHT_DEAD}, {"uncertain", LS_LIGHT_UNCERTAIN}};
enum { N_FLAGS = sizeof flag_names / sizeof *flag_names };

static enum ls_err no_memory(struct ls_diag *diag)
{
    return ls_fail(diag, LS_ERR_NOMEM, "out of memory for a calibration");
}

/* ---- reading ---- */

static enum ls_err flag_list(const json_t *list, int which, struct ls_calibration *c,
                             struct ls_diag *diag)
{
    char path[160], at[160];
    ls_json_child(path, "lights.flags", flag_names[which].name);
    enum ls_err err = list ? ls_json_bounded(list, path, c->n_lights, diag) : LS_OK;
    for (size_t i = 0; i < json_array_size(list) && !err; i++) {
        double light = 0;
        ls_json_element(at, path, i);
        err = ls_json_number(json_array_get(list, i), at, 0, c->n_lights - 1.0, &light, diag);
        if (!err && light != floor(light))
            err = ls_fail(diag, LS_ERR_INVALID, "calibration: %s: expected a whole number", at);
        if (!err)
            c->flags[(uint32_t)light] |= flag_names[which].bit;
    }
    return err;
}

static enum ls_err flags(const json_t *value, struct ls_calibration *c, struct ls_diag *diag)
{
    if (!json_is_object(value))
        return ls_json_wrong(diag, "lights.flags", "an object", value);
    c->flags = calloc(c->n_lights, sizeof *c->flags);
    enum ls_err err = c->flags ? LS_OK : no_memory(diag);
    for (int k = 0; k < N_FLAGS && !err; k++)
        err = flag_list(json_object_get(value, flag_names[k].name), k, c, diag);
    return err;
}

static enum ls_err measured(const json_t *value, struct ls_calibration *c, struct ls_diag *diag)
{
    c->measured_direction = calloc(c->n_lights, sizeof *c->measured_direction);
    return c->measured_direction ? ls_json_directions(value, "lights.measured_direction",
                                                      c->n_lights, c->measured_direction, diag)
                                 : no_memory(diag);
}

static enum ls_err direction_sigma(const json_t *value, struct ls_calibration *c,
                                   struct ls_diag *diag)
{
    c->sigma_direction_deg = calloc(c->n_lights, sizeof *c->sigma_direction_deg);
    return c->sigma_direction_deg ? ls_json_floats(value, "lights.sigma_direction_deg", c->n_lights,
                                                   0, 180, c->sigma_direction_deg, diag)
                                  : no_memory(diag);
}

static enum ls_err lights(const json_t *root, struct ls_calibration *c, struct ls_diag *diag)
{
    const json_t *value = json_object_get(root, "lights"), *found;
    enum ls_err err = LS_OK;
    if ((found = json_object_get(value, "flags")))
        err = flags(found, c, diag);
    if (!err && (found = json_object_get(value, "measured_direction")))
        err = measured(found, c, diag);
    if (!err && (found = json_object_get(value, "sigma_direction_deg")))
        err = direction_sigma(found, c, diag);
    return err;
}

static enum ls_err colour_rows(const json_t *list, const char *path, uint32_t channel,
                               struct ls_calibration *c, struct ls_diag *diag)
{
    char at[160];
    enum ls_err err = ls_json_array(list, path, c->n_lights, diag);
    for (uint32_t i = 0; i < c->n_lights && !err; i++)
        err = ls_json_floats(
            json_array_get(list, i), ls_json_element(at, path, i), c->n_colours, 1e-3, 1e3,
            c->k_colour + ((size_t)channel * c->n_lights + i) * c->n_colours, diag);
    return err;
}

static enum ls_err colours(const json_t *root, struct ls_calibration *c, struct ls_diag *diag)
{
    char path[160];
    const json_t *value = json_object_get(root, "k_colour");
    if (!value)
        return LS_OK;
    if (!json_is_object(value))
        return ls_json_wrong(diag, "k_colour", "an object", value);
    size_t n = (size_t)c->n_channels * c->n_lights * c->n_colours;
    c->k_colour = calloc(n, sizeof *c->k_colour);
    enum ls_err err = c->k_colour ? LS_OK : no_memory(diag);
    for (size_t i = 0; i < n && !err; i++)
        c->k_colour[i] = 1;
    for (uint32_t s = 0; s < c->n_channels && !err; s++) {
        const json_t *list = json_object_get(value, c->channels[s].name);
        if (list)
            err =
                colour_rows(list, ls_json_child(path, "k_colour", c->channels[s].name), s, c, diag);
    }
    return err;
}

static enum ls_err by_camera(const json_t *list, const char *path, const struct ls_calibration *c,
                             float *out, struct ls_diag *diag)
{
    char at[160];
    enum ls_err err = ls_json_array(list, path, c->n_polarised, diag);
    for (uint32_t k = 0; k < c->n_polarised && !err; k++)
        err = ls_json_floats(json_array_get(list, k), ls_json_element(at, path, k), c->n_lights,
                             -100, 100, out + (size_t)k * c->n_lights, diag);
    return err;
}

static enum ls_err polarisation(const json_t *root, struct ls_calibration *c, struct ls_diag *diag)
{
    const json_t *value = json_object_get(root, "polarisation");
    if (!value)
        return LS_OK;
    if (!json_is_object(value))
        return ls_json_wrong(diag, "polarisation", "an object", value);
    const json_t *a_v = json_object_get(value, "a_v");
    enum ls_err err = ls_json_bounded(a_v, "polarisation.a_v", LS_CALIBRATION_MAX_CAMERAS, diag);
    if (err)
        return err;
    if (!json_array_size(a_v))
        return ls_fail(diag, LS_ERR_INVALID, "calibration: polarisation.a_v: expected a camera");
    err = ls_calibration_add_polarisation(c, (uint32_t)json_array_size(a_v), diag);
    if (!err)
        err = by_camera(a_v, "polarisation.a_v", c, c->a_v, diag);
    if (!err)
        err = by_camera(json_object_get(value, "a_h"), "polarisation.a_h", c, c->a_h, diag);
    return err;
}

static enum ls_err mirror(const json_t *root, struct ls_calibration *c, struct ls_diag *diag)
{
    float r[3] = {0};
    const json_t *value = json_object_get(root, "mirror_reflectivity");
    if (!value)
        return LS_OK;
    enum ls_err err = ls_json_floats(value, "mirror_reflectivity", c->n_colours, 1e-3, 2, r, diag);
    for (int k = 0; k < 3; k++)
        c->mirror_reflectivity[k] = r[k];
    c->has_mirror = !err;
    return err;
}

static enum ls_err residual(const json_t *value, size_t i, struct ls_calibration *c,
                            struct ls_diag *diag)
{
    char path[160], at[160], name[64], unit[16] = "";
    double x = 0;
    ls_json_element(path, "residuals", i);
    enum ls_err err = ls_json_string(json_object_get(value, "name"),
                                     ls_json_child(at, path, "name"), sizeof name, name, diag);
    if (!err)
        err = ls_json_member(value, path, "value", -1e30, 1e30, &x, diag);
    const json_t *of = json_object_get(value, "unit");
    if (!err && !json_is_string(of))
        err = ls_json_wrong(diag, ls_json_child(at, path, "unit"), "a string", of);
    if (!err && json_string_length(of))
        err = ls_json_string(of, ls_json_child(at, path, "unit"), sizeof unit, unit, diag);
    return err ? err : ls_calibration_put_residual(c, name, x, unit, diag);
}

static enum ls_err residuals(const json_t *root, struct ls_calibration *c, struct ls_diag *diag)
{
    const json_t *list = json_object_get(root, "residuals");
    if (!list)
        return LS_OK;
    enum ls_err err = ls_json_bounded(list, "residuals", LS_CALIBRATION_MAX_RESIDUALS, diag);
    for (size_t i = 0; i < json_array_size(list) && !err; i++)
        err = residual(json_array_get(list, i), i, c, diag);
    return err;
}

static enum ls_err take(const json_t *value, size_t i, struct ls_calibration_take *out,
                        struct ls_diag *diag)
{
    char path[160], at[160];
    ls_json_element(path, "provenance.takes", i);
    enum ls_err err =
        ls_json_string(json_object_get(value, "subject"), ls_json_child(at, path, "subject"),
                       sizeof out->subject, out->subject, diag);
    return err ? err
               : ls_json_string(json_object_get(value, "take"), ls_json_child(at, path, "take"),
                                sizeof out->take, out->take, diag);
}

static enum ls_err provenance(const json_t *root, struct ls_calibration_provenance *out,
                              struct ls_diag *diag)
{
    const json_t *value = json_object_get(root, "provenance");
    if (!value)
        return LS_OK;
    const json_t *takes = json_object_get(value, "takes");
    enum ls_err err = ls_json_string(json_object_get(value, "date"), "provenance.date",
                                     sizeof out->date, out->date, diag);
    if (!err)
        err = ls_json_string(json_object_get(value, "software"), "provenance.software",
                             sizeof out->software, out->software, diag);
    if (!err)
        err = ls_json_bounded(takes, "provenance.takes", LS_CALIBRATION_MAX_TAKES, diag);
    for (size_t i = 0; i < json_array_size(takes) && !err; i++) {
        err = take(json_array_get(takes, i), i, &out->takes[i], diag);
        out->n_takes = (uint32_t)i + 1;
    }
    return err;
}

enum ls_err ls_calibration_parse_optional(const json_t *root, struct ls_calibration *c,
                                          struct ls_diag *diag)
{
    enum ls_err err = lights(root, c, diag);
    if (!err)
        err = colours(root, c, diag);
    if (!err)
        err = polarisation(root, c, diag);
    if (!err)
        err = mirror(root, c, diag);
    if (!err)
        err = residuals(root, c, diag);
    return err ? err : provenance(root, &c->provenance, diag);
}

/* ---- writing ---- */

static json_t *write_flags(const struct ls_calibration *c)
{
    json_t *object = json_object();
    for (int k = 0; k < N_FLAGS; k++) {
        json_t *list = json_array();
        for (uint32_t i = 0; i < c->n_lights; i++)
            if (c->flags[i] & flag_names[k].bit)
                ls_json_append(&list, json_integer(i));
        ls_json_set(&object, flag_names[k].name, list);
    }
    return object;
}

static void write_lights(const struct ls_calibration *c, json_t **root)
{
    json_t *lights = json_incref(json_object_get(*root, "lights"));
    if (c->flags)
        ls_json_set(&lights, "flags", write_flags(c));
    if (c->measured_direction)
        ls_json_set(&lights, "measured_direction",
                    ls_json_of_rows(c->measured_direction[0], c->n_lights, 3));
    if (c->sigma_direction_deg)
        ls_json_set(&lights, "sigma_direction_deg",
                    ls_json_of_floats(c->sigma_direction_deg, c->n_lights));
    ls_json_set(root, "lights", lights);
}

static json_t *write_colours(const struct ls_calibration *c)
{
    json_t *object = json_object();
    size_t n = (size_t)c->n_lights * c->n_colours;
    for (uint32_t s = 0; s < c->n_channels; s++)
        ls_json_set(&object, c->channels[s].name,
                    ls_json_of_rows(c->k_colour + s * n, c->n_lights, c->n_colours));
    return object;
}

static json_t *write_residuals(const struct ls_calibration *c)
{
    json_t *list = json_array();
    for (uint32_t i = 0; i < c->n_residuals; i++) {
        const struct ls_calibration_residual *r = &c->residuals[i];
        ls_json_append(&list, json_pack("{s:s, s:f, s:s}", "name", r->name, "value", r->value,
                                        "unit", r->unit));
    }
    return list;
}

static json_t *write_provenance(const struct ls_calibration_provenance *p)
{
    json_t *takes = json_array();
    for (uint32_t i = 0; i < p->n_takes; i++)
        ls_json_append(&takes, json_pack("{s:s, s:s}", "subject", p->takes[i].subject, "take",
                                         p->takes[i].take));
    return json_pack("{s:s, s:s, s:o}", "date", p->date, "software", p->software, "takes", takes);
}

void ls_calibration_write_optional(const struct ls_calibration *c, json_t **root)
{
    write_lights(c, root);
    if (c->k_colour)
        ls_json_set(root, "k_colour", write_colours(c));
    if (c->n_polarised)
        ls_json_set(root, "polarisation",
                    json_pack("{s:o, s:o}", "a_v",
                              ls_json_of_rows(c->a_v, c->n_polarised, c->n_lights), "a_h",
                              ls_json_of_rows(c->a_h, c->n_polarised, c->n_lights)));
    if (c->has_mirror) {
        float r[3];
        for (int k = 0; k < 3; k++)
            r[k] = (float)c->mirror_reflectivity[k];
        ls_json_set(root, "mirror_reflectivity", ls_json_of_floats(r, c->n_colours));
    }
    if (c->n_residuals)
        ls_json_set(root, "residuals", write_residuals(c));
    if (c->provenance.date[0])
        ls_json_set(root, "provenance", write_provenance(&c->provenance));
}
