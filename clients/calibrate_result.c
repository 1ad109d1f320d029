#include "clients/calibrate_result.h"

#include "clients/calibrate_residuals.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

/* Beyond these the result is used with a remark. */
static const double good_factor = 0.005;

/* ---- what was not measured ---- */

static enum ls_err check_base(const struct ls_calibrate_measured *m,
                              const struct ls_calibration *base, struct ls_diag *diag)
{
    const struct ls_take_document *d = m->grey_take->document;
    if (base->n_lights != d->n_lights || base->n_channels != d->n_channels ||
        base->n_colours != m->grey->n_colours)
        return ls_fail(
            diag, LS_ERR_MISMATCH,
            "the base calibration is of %u lights, %u channels and %u colours, the rig of %u, "
            "%u and %u: give the base of this rig, or none",
            base->n_lights, base->n_channels, base->n_colours, d->n_lights, d->n_channels,
            m->grey->n_colours);
    for (uint32_t c = 0; c < d->n_channels; c++)
        if (strcmp(base->channels[c].name, d->channels[c].name))
            return ls_fail(
                diag, LS_ERR_MISMATCH,
                "the base calibration's channel %u is %s, the rig's %s: give the base of this "
                "rig, or none",
                c, base->channels[c].name, d->channels[c].name);
    if (strcmp(base->camera.pixel_format, m->grey_take->pixel_format))
        return ls_fail(
            diag, LS_ERR_MISMATCH,
            "the base calibration's camera constants are of %s, the take is in %s: give the base "
            "of this camera, or none",
            base->camera.pixel_format, m->grey_take->pixel_format);
    return LS_OK;
}

/* A copy by way of its own format. */
static enum ls_err copy(const struct ls_calibration *from, struct ls_calibration **out,
                        struct ls_diag *diag)
{
    LS_CLEANUP_FREE char *text = NULL;
    enum ls_err err = ls_calibration_write(from, &text, diag);
    return err ? err : ls_calibration_parse(text, strlen(text), out, diag);
}

static void fill_camera(const struct ls_calibrate_take *take, struct ls_calibration_camera *c)
{
    c->black_dn = take->black_dn;
    c->full_scale_dn = take->full_scale_dn;
    c->electrons_per_dn = take->electrons_per_dn;
    c->read_noise_dn = take->read_noise_dn;
    c->exposure_offset_us = take->exposure_offset_us;
    c->range_low = take->range_low;
    c->range_high = take->range_high;
    snprintf(c->cfa, sizeof c->cfa, "%s", take->cfa);
    snprintf(c->pixel_format, sizeof c->pixel_format, "%s", take->pixel_format);
}

static enum ls_err begin(const struct ls_calibrate_measured *m, const struct ls_calibration *base,
                         struct ls_calibration **out, struct ls_calibrate_remarks *remarks,
                         struct ls_diag *diag)
{
    const struct ls_take_document *d = m->grey_take->document;
    if (base) {
        enum ls_err err = check_base(m, base, diag);
        return err ? err : copy(base, out, diag);
    }
    ls_calibrate_remark(
        remarks, "no base calibration: no spectra, chart or camera matrix; relighting offers "
                 "--solve tristimulus only. Give --base FILE");
    enum ls_err err =
        ls_calibration_create(d->n_lights, d->n_channels, m->grey->n_colours, out, diag);
    if (err)
        return err;
    for (uint32_t c = 0; c < d->n_channels; c++) {
        struct ls_calibration_channel *channel = &(*out)->channels[c];
        memcpy(channel->name, d->channels[c].name,
               strnlen(d->channels[c].name, sizeof channel->name - 1));
        channel->polariser = !d->channels[c].spectrum;
    }
    fill_camera(m->grey_take, &(*out)->camera);
    return LS_OK;
}

/* ---- what was ---- */

static enum ls_err fill_lights(const struct ls_calibrate_measured *m, struct ls_calibration *c,
                               struct ls_diag *diag)
{
    const struct ls_take_document *d = m->grey_take->document;
    const struct ls_grey *grey = m->grey;
    enum ls_err err = ls_calibration_add_measured(c, diag);
    for (uint32_t i = 0; i < c->n_lights && !err; i++) {
        for (int k = 0; k < 3; k++) {
            c->position_m[i][k] = d->position_m[i][k];
            c->direction[i][k] = d->direction[i][k];
            c->measured_direction[i][k] = (float)grey->direction[i][k];
        }
        c->sigma_direction_deg[i] = (float)grey->sigma_direction_deg[i];
        c->omega_sr[i] = (float)d->omega_sr[i];
        c->flags[i] = grey->flags[i];
    }
    return err;
}

static bool has_colours(const struct ls_grey *grey)
{
    for (uint32_t s = 0; s < grey->n_channels; s++)
        for (uint32_t i = 0; i < grey->n_lights * grey->n_colours; i++)
            if (grey->gains[s].colour[i] != 1)
                return true;
    return false;
}

static enum ls_err fill_gains(const struct ls_calibrate_measured *m, struct ls_calibration *c,
                              struct ls_diag *diag)
{
    const struct ls_grey *grey = m->grey;
    size_t n = c->n_lights, each = n * c->n_colours;
    for (uint32_t s = 0; s < c->n_channels; s++) {
        for (size_t i = 0; i < n; i++) {
            c->k[s * n + i] = (float)grey->gains[s].k[i];
            c->sigma_k[s * n + i] = (float)grey->gains[s].sigma_k[i];
        }
        memcpy(c->p[s], grey->cameras[0].p[s], sizeof c->p[s]);
    }
    c->scale = grey->cameras[0].scale;
    free(c->k_colour);
    c->k_colour = NULL;
    if (!has_colours(grey))
        return LS_OK;
    c->k_colour = calloc(c->n_channels * each, sizeof *c->k_colour);
    for (size_t i = 0; c->k_colour && i < c->n_channels * each; i++)
        c->k_colour[i] = (float)grey->gains[i / each].colour[i % each];
    return c->k_colour ? LS_OK : ls_fail(diag, LS_ERR_NOMEM, "out of memory");
}

static enum ls_err fill_factors(const struct ls_calibrate_measured *m, struct ls_calibration *c,
                                struct ls_calibrate_remarks *remarks, struct ls_diag *diag)
{
    const struct ls_grey *grey = m->grey;
    enum ls_err err = LS_OK;
    uint32_t carried = c->n_patterns;
    c->n_patterns = 0; /* a factor of another day is no measurement */
    for (uint32_t i = 0; i < grey->n_factors && !err; i++) {
        const struct ls_grey_factor *f = &grey->factors[i];
        struct ls_calibration_pattern pattern = {.channel = f->channel,
                                                 .duty = f->duty,
                                                 .factor = f->value.factor,
                                                 .sigma = f->value.sigma};
        snprintf(pattern.pattern, sizeof pattern.pattern, "%.15s", f->pattern);
        err = ls_calibration_put_factor(c, &pattern, diag);
        if (f->value.sigma > good_factor * f->value.factor)
            ls_calibrate_remark(
                remarks,
                "the factor of %s in %s is known to %.1f %% only: photograph it brighter, "
                "or with a longer exposure",
                f->pattern, c->channels[f->channel].name, 100 * f->value.sigma / f->value.factor);
    }
    if (!err && carried > c->n_patterns)
        ls_calibrate_remark(
            remarks,
            "the base knows %u patterns, this calibration %u: what was not photographed "
            "on the grey sphere is uncalibrated now",
            carried, c->n_patterns);
    return err;
}

static enum ls_err fill_probes(const struct ls_calibrate_measured *m, struct ls_calibration *c,
                               struct ls_calibrate_remarks *remarks, struct ls_diag *diag)
{
    if (m->chrome && m->chrome->n_mirror) {
        c->has_mirror = true;
        memcpy(c->mirror_reflectivity, m->chrome->reflectivity, sizeof c->mirror_reflectivity);
    } else if (m->chrome) {
        ls_calibrate_remark(
            remarks,
            "the chrome ball's reflectivity was not measured: its highlights are saturated "
            "or dim; add a shorter or longer exposure");
    }
    if (!m->gloss)
        return LS_OK;
    enum ls_err err = ls_calibration_add_polarisation(c, 1, diag);
    for (uint32_t i = 0; i < c->n_lights && !err; i++) {
        c->a_v[i] = (float)m->gloss->a_v[i];
        c->a_h[i] = (float)m->gloss->a_h[i];
    }
    return err;
}

static void fill_provenance(const struct ls_calibrate_measured *m, struct ls_calibration *c)
{
    const struct {
        const char *subject;
        const struct ls_calibrate_take *take;
    } takes[] = {{"grey sphere", m->grey_take},
                 {"chrome ball", m->chrome_take},
                 {"black glossy sphere", m->gloss_take}};
    struct ls_calibration_provenance *out = &c->provenance;
    time_t now = time(NULL);
    struct tm utc;
    *out = (struct ls_calibration_provenance){0};
    strftime(out->date, sizeof out->date, "%Y-%m-%dT%H:%M:%SZ", gmtime_r(&now, &utc));
    snprintf(out->software, sizeof out->software, "lightstagectl " LS_VERSION);
    for (size_t i = 0; i < sizeof takes / sizeof *takes; i++) {
        if (!takes[i].take)
            continue;
        struct ls_calibration_take *t = &out->takes[out->n_takes++];
        snprintf(t->subject, sizeof t->subject, "%s", takes[i].subject);
        snprintf(t->take, sizeof t->take, "%.63s", takes[i].take->id);
    }
}

enum ls_err ls_calibrate_result(const struct ls_calibrate_measured *m,
                                const struct ls_calibration *base, struct ls_calibration **out,
                                struct ls_calibrate_remarks *remarks, struct ls_diag *diag)
{
    struct ls_calibration *c = NULL;
    remarks->n = 0;
    enum ls_err err = begin(m, base, &c, remarks, diag);
    if (!err)
        err = fill_lights(m, c, diag);
    if (!err)
        err = fill_gains(m, c, diag);
    if (!err)
        err = fill_factors(m, c, remarks, diag);
    if (!err)
        err = fill_probes(m, c, remarks, diag);
    if (!err)
        err = ls_calibrate_residuals(m, c, remarks, diag);
    if (err) {
        ls_calibration_destroy(c);
        return err;
    }
    fill_provenance(m, c);
    *out = c;
    return LS_OK;
}
