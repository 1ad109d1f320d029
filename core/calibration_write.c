#include "core/calibration.h"
#include "core/calibration_json.h"

#include <jansson.h>

static json_t *table(const struct ls_spectral_table *t, int nested)
{
    return json_pack("{s:f, s:f, s:o}", "start_nm", t->start_nm, "step_nm", t->step_nm, "values",
                     nested ? ls_json_of_rows(t->v, t->rows, t->n) : ls_json_of_floats(t->v, t->n));
}

static json_t *lights(const struct ls_calibration *c)
{
    return json_pack("{s:o, s:o, s:o}", "position_m",
                     ls_json_of_rows(c->position_m[0], c->n_lights, 3), "direction",
                     ls_json_of_rows(c->direction[0], c->n_lights, 3), "omega_sr",
                     ls_json_of_floats(c->omega_sr, c->n_lights));
}

static json_t *channels(const struct ls_calibration *c)
{
    json_t *list = json_array();
    for (uint32_t s = 0; s < c->n_channels; s++) {
        const struct ls_calibration_channel *channel = &c->channels[s];
        json_t *item = json_pack("{s:s, s:s}", "name", channel->name, "kind",
                                 channel->polariser ? "polariser" : "spectrum");
        if (channel->spectrum.n)
            ls_json_set(&item, "spectrum", table(&channel->spectrum, 0));
        ls_json_append(&list, item);
    }
    return list;
}

static json_t *by_channel(const struct ls_calibration *c, const float *v, size_t n, size_t stride)
{
    json_t *object = json_object();
    for (uint32_t s = 0; s < c->n_channels; s++)
        ls_json_set(&object, c->channels[s].name, ls_json_of_floats(v + s * stride, n));
    return object;
}

static json_t *patterns(const struct ls_calibration *c)
{
    json_t *list = json_array();
    for (uint32_t i = 0; i < c->n_patterns; i++) {
        const struct ls_calibration_pattern *p = &c->patterns[i];
        json_t *item = json_pack("{s:s, s:s, s:f, s:f}", "channel", c->channels[p->channel].name,
                                 "pattern", p->pattern, "duty", p->duty, "factor", p->factor);
        if (!(p->sigma <= 0))
            ls_json_set(&item, "sigma", json_real(p->sigma));
        ls_json_append(&list, item);
    }
    return list;
}

static json_t *chart(const struct ls_calibration *c)
{
    json_t *names = json_array();
    for (uint32_t i = 0; i < c->n_patches; i++)
        ls_json_append(&names, json_string(c->patch_names[i]));
    return json_pack("{s:o, s:o}", "names", names, "reflectance", table(&c->reflectance, 1));
}

static json_t *chart_light(const struct ls_calibration *c)
{
    json_t *list = json_array();
    for (uint32_t p = 0; p < c->n_patches; p++)
        ls_json_append(&list, ls_json_of_rows(c->L + p * c->n_colours * c->n_channels, c->n_colours,
                                              c->n_channels));
    return list;
}

static json_t *camera(const struct ls_calibration_camera *camera)
{
    json_t *hot = json_array();
    for (uint32_t i = 0; i < camera->n_hot; i++)
        ls_json_append(&hot, json_pack("[i, i]", (int)camera->hot[i][0], (int)camera->hot[i][1]));
    json_t *out = json_pack("{s:f, s:f, s:f, s:f, s:s, s:s, s:f, s:[f, f], s:o}", "black_dn",
                            camera->black_dn, "full_scale_dn", camera->full_scale_dn,
                            "electrons_per_dn", camera->electrons_per_dn, "read_noise_dn",
                            camera->read_noise_dn, "cfa", camera->cfa, "pixel_format",
                            camera->pixel_format, "exposure_offset_us", camera->exposure_offset_us,
                            "range", camera->range_low, camera->range_high, "hot_pixels", hot);
    if (camera->sensitivity.n)
        ls_json_set(&out, "sensitivities", table(&camera->sensitivity, 1));
    return out;
}

static json_t *matrix(const struct ls_calibration *c)
{
    json_t *list = json_array();
    for (int r = 0; r < 3; r++)
        ls_json_append(&list, json_pack("[f, f, f]", c->m[r][0], c->m[r][1], c->m[r][2]));
    return list;
}

enum ls_err ls_calibration_write(const struct ls_calibration *c, char **text, struct ls_diag *diag)
{
    json_t *root =
        json_pack("{s:i, s:o, s:o, s:o, s:o, s:o, s:f, s:o, s:o}", "format", 1, "lights", lights(c),
                  "channels", channels(c), "k", by_channel(c, c->k, c->n_lights, c->n_lights),
                  "sigma_k", by_channel(c, c->sigma_k, c->n_lights, c->n_lights), "pattern_factors",
                  patterns(c), "scale", c->scale, "p", by_channel(c, c->p[0], c->n_colours, 3),
                  "camera", camera(&c->camera));
    if (root && c->n_patches)
        ls_json_set(&root, "chart", chart(c));
    if (root && c->L)
        ls_json_set(&root, "L", chart_light(c));
    if (root && c->has_m)
        ls_json_set(&root, "M", matrix(c));
    if (root)
        ls_calibration_write_optional(c, &root);
    *text = root ? json_dumps(root, JSON_COMPACT | JSON_REAL_PRECISION(9)) : NULL;
    json_decref(root);
    if (!*text)
        return ls_fail(
            diag, LS_ERR_INVALID,
            "calibration: cannot be written: out of memory, a number that is not finite, or a name "
            "that is not UTF-8");
    return LS_OK;
}
