#include "clients/calibrate_result.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

/* Beyond these the result is used with a remark. */
static const double good_misfit = 0.05;       /* of a matte sphere's shading */
static const double good_sigma_k = 0.005;     /* of the middle unflagged light */
static const double good_direction_deg = 1.0; /* rms, from the rig file */
static const double good_chrome_deg = 2.0;
static const double good_factor = 0.005;
static const double good_model = 0.1; /* a_V, measured against the half vector */

static void remark(struct ls_calibrate_remarks *remarks, const char *fmt, ...) LS_PRINTF(2, 3);
static void remark(struct ls_calibrate_remarks *remarks, const char *fmt, ...)
{
    va_list args;
    if (remarks->n == LS_CALIBRATE_REMARKS)
        return;
    va_start(args, fmt);
    vsnprintf(remarks->text[remarks->n], sizeof remarks->text[0], fmt, args);
    va_end(args);
    remarks->n++;
}

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
    remark(remarks, "no base calibration: no spectra, chart or camera matrix; relighting offers "
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
    uint32_t white = (uint32_t)ls_calibrate_white(m->grey_take);
    for (uint32_t i = 0; i < c->n_lights && !err; i++) {
        double nominal[3], measured[3], sigma = 0;
        for (int k = 0; k < 3; k++) {
            c->position_m[i][k] = d->position_m[i][k];
            c->direction[i][k] = d->direction[i][k];
            nominal[k] = measured[k] = (double)d->direction[i][k];
        }
        c->omega_sr[i] = (float)d->omega_sr[i];
        c->flags[i] = grey->flags[i];
        if (ls_direction_combine(nominal, &grey->shading[(size_t)i * grey->n_channels + white], 1,
                                 measured, &sigma, NULL))
            sigma = 0;
        for (int k = 0; k < 3; k++)
            c->measured_direction[i][k] = (float)measured[k];
        c->sigma_direction_deg[i] = (float)sigma;
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
        memcpy(c->p[s], grey->p[s], sizeof c->p[s]);
    }
    c->scale = grey->scale;
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
            remark(remarks,
                   "the factor of %s in %s is known to %.1f %% only: photograph it brighter, "
                   "or with a longer exposure",
                   f->pattern, c->channels[f->channel].name,
                   100 * f->value.sigma / f->value.factor);
    }
    if (!err && carried > c->n_patterns)
        remark(remarks,
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
        remark(remarks,
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

/* ---- residuals ---- */

static int ascending(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* sigma_k / k of the middle unflagged light. */
static double middle_sigma(const struct ls_calibration *c, uint32_t s, double *room)
{
    uint32_t n = 0;
    for (uint32_t i = 0; i < c->n_lights; i++)
        if (!c->flags[i])
            room[n++] = (double)(c->sigma_k[(size_t)s * c->n_lights + i] /
                                 c->k[(size_t)s * c->n_lights + i]);
    qsort(room, n, sizeof *room, ascending);
    return n ? room[n / 2] : 0;
}

/* rms angle between measured and nominal directions, in lights that have one and no flag. */
static double direction_rms(const struct ls_calibration *c, double *worst, uint32_t *n)
{
    double sum = 0;
    *worst = *n = 0;
    for (uint32_t i = 0; i < c->n_lights; i++) {
        const float *a = c->direction[i], *b = c->measured_direction[i];
        if (c->flags[i] || !(c->sigma_direction_deg[i] > 0))
            continue;
        double d =
            hypot(hypot((double)(a[0] - b[0]), (double)(a[1] - b[1])), (double)(a[2] - b[2]));
        double deg = 2 * asin(fmin(d / 2, 1)) * 180 / M_PI;
        sum += deg * deg;
        *worst = fmax(*worst, deg);
        ++*n;
    }
    return *n ? sqrt(sum / *n) : 0;
}

/* The residuals of one calibration, and the first error of putting them there. */
struct residuals {
    struct ls_calibration *calibration;
    struct ls_diag *diag;
    enum ls_err err;
};

static void put(struct residuals *r, double value, const char *unit, const char *fmt, ...)
    LS_PRINTF(4, 5);
static void put(struct residuals *r, double value, const char *unit, const char *fmt, ...)
{
    char name[64];
    va_list args;
    va_start(args, fmt);
    vsnprintf(name, sizeof name, fmt, args);
    va_end(args);
    if (!r->err)
        r->err = ls_calibration_put_residual(r->calibration, name, value, unit, r->diag);
}

static void put_grey(struct residuals *r, const struct ls_grey *grey,
                     struct ls_calibrate_remarks *remarks)
{
    const double *at = grey->sphere.centre_m;
    put(r, 1e3 * hypot(hypot(at[0], at[1]), at[2]), "mm", "grey sphere from the centre");
    put(r, grey->outline.radius_px, "px", "grey sphere's radius");
    put(r, 100 * grey->misfit, "%", "shading, rms of the middle light");
    put(r, 100 * grey->rejected, "%", "pixels off the shading");
    put(r, 100 * grey->saturated, "%", "pixels saturated");
    put(r, grey->misplaced_deg, "deg", "lights beside their places");
    if (grey->misfit > good_misfit)
        remark(remarks,
               "the sphere's shading is %.1f %% off: is it clean, matte, and well in the "
               "middle?",
               100 * grey->misfit);
}

static void put_gains(struct residuals *r, const struct ls_grey *grey,
                      struct ls_calibrate_remarks *remarks)
{
    struct ls_calibration *c = r->calibration;
    LS_CLEANUP_FREE double *room = calloc(c->n_lights, sizeof *room);
    for (uint32_t s = 0; s < c->n_channels && room; s++) {
        const char *name = c->channels[s].name;
        double sigma = middle_sigma(c, s, room);
        put(r, 100 * sigma, "%", "error of k in %s, middle light", name);
        put(r, 100 * grey->gains[s].sigma_mean, "%", "of that, common to all lights of %s", name);
        put(r, grey->gains[s].chi2, "", "chi2 per degree of freedom in %s", name);
        if (sigma > good_sigma_k)
            remark(remarks, "the gains in %s are known to %.1f %% only: use longer exposures", name,
                   100 * sigma);
    }
}

static void put_directions(struct residuals *r, const struct ls_calibrate_measured *m,
                           struct ls_calibrate_remarks *remarks)
{
    double worst;
    uint32_t n;
    double rms = direction_rms(r->calibration, &worst, &n);
    put(r, n, "lights", "directions by shading");
    put(r, rms, "deg", "directions by shading, rms from the rig file");
    put(r, worst, "deg", "directions by shading, worst");
    if (rms > good_direction_deg)
        remark(remarks,
               "the lights stand %.1f degrees (rms) from where the rig file says: check its "
               "axes and the camera's position",
               rms);
    if (!m->chrome)
        return;
    put(r, m->chrome->n_seen, "lights", "directions by the chrome ball");
    put(r, m->chrome->rms_deg, "deg", "directions by the chrome ball, rms from the rig file");
    put(r, m->chrome->worst_deg, "deg", "directions by the chrome ball, worst");
    put(r, m->chrome->shading_deg, "deg", "chrome ball against shading, rms");
    put(r, m->chrome->n_mirror, "lights", "mirror reflectivity measured");
    put(r, 100 * m->chrome->spread[0], "%", "mirror reflectivity, spread");
    if (m->chrome->rms_deg > good_chrome_deg)
        remark(remarks,
               "the chrome ball sees the lights %.1f degrees (rms) from where the rig file "
               "says: does it stand where the grey sphere stood?",
               m->chrome->rms_deg);
}

static void put_gloss(struct residuals *r, const struct ls_gloss *gloss,
                      struct ls_calibrate_remarks *remarks)
{
    double sum = 0;
    uint32_t n = 0;
    for (uint32_t i = 0; i < gloss->n_lights; i++) {
        sum += gloss->sigma[i];
        n += gloss->sigma[i] > 0;
    }
    put(r, gloss->n_measured, "lights", "polarisation measured");
    put(r, n ? sum / n : 0, "", "error of a_V, mean");
    put(r, gloss->model_rms, "", "a_V against the half vector, rms");
    put(r, gloss->n_inseparable, "lights", "inseparable");
    if (gloss->n_saturated)
        remark(remarks,
               "highlights of %u lights on the black sphere are saturated: their polarisation "
               "comes from the half vector; add a shorter exposure",
               gloss->n_saturated);
    if (gloss->model_rms > good_model)
        remark(remarks,
               "the black sphere's polarisation is %.2f (rms) off the half vector's: are "
               "vertical and horizontal exchanged, or the camera's polariser turned?",
               gloss->model_rms);
}

static void remark_flags(const struct ls_calibration *c, struct ls_calibrate_remarks *remarks)
{
    uint32_t dead = 0, uncertain = 0, first = 0;
    for (uint32_t i = c->n_lights; i-- > 0;) {
        dead += !!(c->flags[i] & LS_LIGHT_DEAD);
        uncertain += !!(c->flags[i] & LS_LIGHT_UNCERTAIN);
        if (c->flags[i] & LS_LIGHT_DEAD)
            first = i;
    }
    if (dead)
        remark(remarks,
               "%u lights are dead in some channel, light %u first: replace them, or leave "
               "them out",
               dead, first);
    if (uncertain)
        remark(remarks, "%u lights could not be measured from here: their gains are taken as 1",
               uncertain);
}

static enum ls_err fill_provenance(const struct ls_calibrate_measured *m, struct ls_calibration *c)
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
    snprintf(out->software, sizeof out->software, "lightstagectl 0.1.0");
    for (size_t i = 0; i < sizeof takes / sizeof *takes; i++) {
        if (!takes[i].take)
            continue;
        struct ls_calibration_take *t = &out->takes[out->n_takes++];
        snprintf(t->subject, sizeof t->subject, "%s", takes[i].subject);
        snprintf(t->take, sizeof t->take, "%.63s", takes[i].take->id);
    }
    return LS_OK;
}

static enum ls_err fill_residuals(const struct ls_calibrate_measured *m, struct ls_calibration *c,
                                  struct ls_calibrate_remarks *remarks, struct ls_diag *diag)
{
    struct residuals r = {c, diag, LS_OK};
    c->n_residuals = 0;
    put_grey(&r, m->grey, remarks);
    put_gains(&r, m->grey, remarks);
    put_directions(&r, m, remarks);
    if (m->gloss)
        put_gloss(&r, m->gloss, remarks);
    remark_flags(c, remarks);
    return r.err ? r.err : fill_provenance(m, c);
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
        err = fill_residuals(m, c, remarks, diag);
    if (err)
        ls_calibration_destroy(c);
    else
        *out = c;
    return err;
}

/* ---- the report ---- */

static const struct {
    uint8_t flag;
    const char *name;
} flag_names[] = {
    {LS_LIGHT_ONE_SIDED, "one-sided"}, {LS_LIGHT_DEAD, "dead"}, {LS_LIGHT_UNCERTAIN, "uncertain"}};

enum { N_FLAGS = sizeof flag_names / sizeof *flag_names };

static uint32_t count_flag(const struct ls_calibration *c, uint8_t flag)
{
    uint32_t n = 0;
    for (uint32_t i = 0; i < c->n_lights; i++)
        n += !!(c->flags[i] & flag);
    return n;
}

static const char *verdict(const struct ls_calibrate_remarks *remarks)
{
    return remarks->n ? "usable, with remarks" : "good";
}

void ls_calibrate_print(const struct ls_calibration *c, const struct ls_calibrate_remarks *remarks)
{
    for (uint32_t i = 0; i < c->n_residuals; i++)
        printf("  %-48s %10.4g %s\n", c->residuals[i].name, c->residuals[i].value,
               c->residuals[i].unit);
    for (uint32_t i = 0; i < c->n_patterns; i++) {
        const struct ls_calibration_pattern *p = &c->patterns[i];
        printf("  factor of %-11s in %-8s at duty %.5f     %10.4f +- %.4f\n", p->pattern,
               c->channels[p->channel].name, p->duty, p->factor, p->sigma);
    }
    if (c->has_mirror)
        printf("  %-48s %10.4f %.4f %.4f\n", "mirror reflectivity", c->mirror_reflectivity[0],
               c->mirror_reflectivity[1], c->mirror_reflectivity[2]);
    for (int i = 0; i < N_FLAGS; i++)
        printf("  lights flagged %-33s %10u\n", flag_names[i].name,
               count_flag(c, flag_names[i].flag));
    for (uint32_t i = 0; i < remarks->n; i++)
        printf("remark: %s\n", remarks->text[i]);
    printf("verdict: %s\n", verdict(remarks));
}

json_t *ls_calibrate_json(const struct ls_calibration *c,
                          const struct ls_calibrate_remarks *remarks, const char *file)
{
    json_t *residuals = json_object(), *flags = json_object(), *sentences = json_array();
    json_t *factors = json_array();
    for (uint32_t i = 0; i < c->n_residuals; i++)
        json_object_set_new(residuals, c->residuals[i].name, json_real(c->residuals[i].value));
    for (int i = 0; i < N_FLAGS; i++)
        json_object_set_new(flags, flag_names[i].name,
                            json_integer(count_flag(c, flag_names[i].flag)));
    for (uint32_t i = 0; i < remarks->n; i++)
        json_array_append_new(sentences, json_string(remarks->text[i]));
    for (uint32_t i = 0; i < c->n_patterns; i++)
        json_array_append_new(
            factors,
            json_pack("{ss ss sf sf sf}", "channel", c->channels[c->patterns[i].channel].name,
                      "pattern", c->patterns[i].pattern, "duty", c->patterns[i].duty, "factor",
                      c->patterns[i].factor, "sigma", c->patterns[i].sigma));
    return json_pack("{ss ss so so so so}", "file", file, "verdict", verdict(remarks), "residuals",
                     residuals, "factors", factors, "flags", flags, "remarks", sentences);
}
