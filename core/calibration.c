#include "core/calibration.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum ls_err ls_calibration_create(uint32_t n_lights, uint32_t n_channels, uint32_t n_colours,
                                  struct ls_calibration **out, struct ls_diag *diag)
{
    if (n_lights < 1 || n_lights > LS_CALIBRATION_MAX_LIGHTS || n_channels < 1 ||
        n_channels > LS_CALIBRATION_MAX_CHANNELS || (n_colours != 1 && n_colours != 3))
        return ls_fail(diag, LS_ERR_LIMIT,
                       "calibration: expected 1 to %d lights, 1 to %d channels, 1 or 3 colours; "
                       "found %u, %u, %u",
                       LS_CALIBRATION_MAX_LIGHTS, LS_CALIBRATION_MAX_CHANNELS, n_lights, n_channels,
                       n_colours);
    struct ls_calibration *c = calloc(1, sizeof *c);
    if (!c)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for a calibration");
    c->n_lights = n_lights;
    c->n_channels = n_channels;
    c->n_colours = n_colours;
    c->position_m = calloc(n_lights, sizeof *c->position_m);
    c->direction = calloc(n_lights, sizeof *c->direction);
    c->omega_sr = calloc(n_lights, sizeof *c->omega_sr);
    c->k = calloc((size_t)n_lights * n_channels, sizeof *c->k);
    c->sigma_k = calloc((size_t)n_lights * n_channels, sizeof *c->sigma_k);
    if (!c->position_m || !c->direction || !c->omega_sr || !c->k || !c->sigma_k) {
        ls_calibration_destroy(c);
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for a calibration");
    }
    *out = c;
    return LS_OK;
}

void ls_calibration_destroy(struct ls_calibration *c)
{
    if (!c)
        return;
    for (uint32_t s = 0; s < LS_CALIBRATION_MAX_CHANNELS; s++)
        free(c->channels[s].spectrum.v);
    free(c->position_m);
    free(c->direction);
    free(c->omega_sr);
    free(c->k);
    free(c->sigma_k);
    free(c->patterns);
    free(c->patch_names);
    free(c->reflectance.v);
    free(c->L);
    free(c->camera.sensitivity.v);
    free(c->camera.hot);
    free(c->flags);
    free(c->measured_direction);
    free(c->sigma_direction_deg);
    free(c->k_colour);
    free(c->a_v);
    free(c->a_h);
    free(c->residuals);
    free(c);
}

int ls_calibration_channel(const struct ls_calibration *c, const char *name)
{
    for (uint32_t s = 0; s < c->n_channels; s++)
        if (!strcmp(c->channels[s].name, name))
            return (int)s;
    return -1;
}

bool ls_calibration_same_duty(double a, double b)
{
    return fabs(a - b) <= 1e-3 * fmax(a, b);
}

double ls_calibration_factor(const struct ls_calibration *c, uint32_t channel, const char *pattern,
                             double duty)
{
    for (uint32_t i = 0; i < c->n_patterns; i++) {
        const struct ls_calibration_pattern *p = &c->patterns[i];
        if (p->channel == channel && ls_calibration_same_duty(p->duty, duty) &&
            !strcmp(p->pattern, pattern))
            return p->factor;
    }
    return 0;
}
