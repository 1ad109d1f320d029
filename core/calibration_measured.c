#include "core/calibration.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static void list_duties(const struct ls_calibration *c, uint32_t channel, const char *pattern,
                        char *text, size_t size)
{
    size_t used = 0;
    text[0] = 0;
    for (uint32_t i = 0; i < c->n_patterns && used + 16 < size; i++) {
        const struct ls_calibration_pattern *p = &c->patterns[i];
        if (p->channel == channel && !strcmp(p->pattern, pattern))
            used += (size_t)snprintf(text + used, size - used, "%s%.5g", used ? ", " : "", p->duty);
    }
}

enum ls_err ls_calibration_lacks_factor(const struct ls_calibration *c, uint32_t channel,
                                        const char *pattern, double duty, struct ls_diag *diag)
{
    char duties[160];
    list_duties(c, channel, pattern, duties, sizeof duties);
    return ls_fail(diag, LS_ERR_NOT_FOUND,
                   "the calibration holds no factor of channel %s, pattern %.15s at duty %.5g "
                   "(calibrated duties: %s); measure it (lightstagectl calibrate --plan) and take "
                   "again",
                   c->channels[channel].name, pattern, duty, *duties ? duties : "none");
}

enum ls_err ls_calibration_put_factor(struct ls_calibration *c,
                                      const struct ls_calibration_pattern *p, struct ls_diag *diag)
{
    if (p->channel >= c->n_channels || !*p->pattern || !(p->duty >= 1e-6 && p->duty <= 1) ||
        !(p->factor >= 1e-3 && p->factor <= 1e3) || !(p->sigma >= 0 && p->sigma <= 1e3))
        return ls_fail(diag, LS_ERR_INVALID,
                       "pattern factor of channel %u, pattern \"%.15s\", duty %g: %g +- %g is none",
                       p->channel, p->pattern, p->duty, p->factor, p->sigma);
    for (uint32_t i = 0; i < c->n_patterns; i++) {
        struct ls_calibration_pattern *old = &c->patterns[i];
        if (old->channel == p->channel && ls_calibration_same_duty(old->duty, p->duty) &&
            !strcmp(old->pattern, p->pattern)) {
            *old = *p;
            return LS_OK;
        }
    }
    if (c->n_patterns == LS_CALIBRATION_MAX_PATTERNS)
        return ls_fail(diag, LS_ERR_LIMIT, "calibration: at most %d pattern factors",
                       LS_CALIBRATION_MAX_PATTERNS);
    struct ls_calibration_pattern *grown =
        realloc(c->patterns, (c->n_patterns + 1) * sizeof *grown);
    if (!grown)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for pattern factors");
    c->patterns = grown;
    c->patterns[c->n_patterns++] = *p;
    return LS_OK;
}

static struct ls_calibration_residual *find_residual(struct ls_calibration *c, const char *name)
{
    for (uint32_t i = 0; i < c->n_residuals; i++)
        if (!strncmp(c->residuals[i].name, name, sizeof c->residuals[i].name - 1))
            return &c->residuals[i];
    return NULL;
}

enum ls_err ls_calibration_put_residual(struct ls_calibration *c, const char *name, double value,
                                        const char *unit, struct ls_diag *diag)
{
    if (!*name || !isfinite(value))
        return ls_fail(diag, LS_ERR_INVALID, "residual \"%.60s\": %g is no number", name, value);
    struct ls_calibration_residual *r = find_residual(c, name);
    if (!r) {
        if (c->n_residuals == LS_CALIBRATION_MAX_RESIDUALS)
            return ls_fail(diag, LS_ERR_LIMIT, "calibration: at most %d residuals",
                           LS_CALIBRATION_MAX_RESIDUALS);
        r = realloc(c->residuals, (c->n_residuals + 1) * sizeof *r);
        if (!r)
            return ls_fail(diag, LS_ERR_NOMEM, "out of memory for residuals");
        c->residuals = r;
        r += c->n_residuals++;
    }
    snprintf(r->name, sizeof r->name, "%s", name);
    snprintf(r->unit, sizeof r->unit, "%s", unit);
    r->value = value;
    return LS_OK;
}

enum ls_err ls_calibration_add_measured(struct ls_calibration *c, struct ls_diag *diag)
{
    uint32_t n = c->n_lights;
    if (!c->flags)
        c->flags = calloc(n, sizeof *c->flags);
    if (!c->sigma_direction_deg)
        c->sigma_direction_deg = calloc(n, sizeof *c->sigma_direction_deg);
    if (!c->measured_direction) {
        c->measured_direction = calloc(n, sizeof *c->measured_direction);
        if (c->measured_direction)
            memcpy(c->measured_direction, c->direction, n * sizeof *c->direction);
    }
    return c->flags && c->sigma_direction_deg && c->measured_direction
               ? LS_OK
               : ls_fail(diag, LS_ERR_NOMEM, "out of memory for measured lights");
}

enum ls_err ls_calibration_add_polarisation(struct ls_calibration *c, uint32_t n_cameras,
                                            struct ls_diag *diag)
{
    if (n_cameras < 1 || n_cameras > LS_CALIBRATION_MAX_CAMERAS)
        return ls_fail(diag, LS_ERR_LIMIT, "polarisation of %u cameras: expected 1 to %d",
                       n_cameras, LS_CALIBRATION_MAX_CAMERAS);
    free(c->a_v);
    free(c->a_h);
    c->n_polarised = n_cameras;
    c->a_v = calloc((size_t)n_cameras * c->n_lights, sizeof *c->a_v);
    c->a_h = calloc((size_t)n_cameras * c->n_lights, sizeof *c->a_h);
    if (c->a_v && c->a_h)
        return LS_OK;
    free(c->a_v);
    free(c->a_h);
    c->a_v = c->a_h = NULL;
    c->n_polarised = 0;
    return ls_fail(diag, LS_ERR_NOMEM, "out of memory for polarisation factors");
}
