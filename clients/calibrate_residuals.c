#include "clients/calibrate_residuals.h"

#include "core/sample.h"
#include "core/vec3.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>

/* Beyond these the result is used with a remark. */
static const double good_misfit = 0.05;       /* of a matte sphere's shading */
static const double good_sigma_k = 0.005;     /* of the middle unflagged light */
static const double good_direction_deg = 1.0; /* rms, from the rig file */
static const double good_chrome_deg = 2.0;
static const double good_model = 0.1; /* a_V, measured against the half vector */

void ls_calibrate_remark(struct ls_calibrate_remarks *remarks, const char *fmt, ...)
{
    va_list args;
    if (remarks->n == LS_CALIBRATE_REMARKS)
        return;
    va_start(args, fmt);
    vsnprintf(remarks->text[remarks->n], sizeof remarks->text[0], fmt, args);
    va_end(args);
    remarks->n++;
}

/* sigma_k / k of the middle unflagged light. */
static double middle_sigma(const struct ls_calibration *c, uint32_t s, float *room)
{
    uint32_t n = 0;
    for (uint32_t i = 0; i < c->n_lights; i++)
        if (!c->flags[i])
            room[n++] = c->sigma_k[(size_t)s * c->n_lights + i] / c->k[(size_t)s * c->n_lights + i];
    return n ? (double)ls_median(room, n) : 0;
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
    const struct ls_grey_view *v = &grey->cameras[0];
    put(r, 1e3 * ls_length3(v->sphere.centre_m), "mm", "grey sphere from the centre");
    put(r, v->outline.radius_px, "px", "grey sphere's radius");
    put(r, 100 * v->misfit, "%", "shading, rms of the middle light");
    put(r, 100 * v->rejected, "%", "pixels off the shading");
    put(r, 100 * v->saturated, "%", "pixels saturated");
    put(r, grey->settled.spread_deg, "deg", "lights beside their places");
    if (v->misfit > good_misfit)
        ls_calibrate_remark(
            remarks,
            "the sphere's shading is %.1f %% off: is it clean, matte, and well in the "
            "middle?",
            100 * v->misfit);
}

static void put_gains(struct residuals *r, const struct ls_grey *grey,
                      struct ls_calibrate_remarks *remarks)
{
    struct ls_calibration *c = r->calibration;
    LS_CLEANUP_FREE float *room = calloc(c->n_lights, sizeof *room);
    if (!room && !r->err)
        r->err = ls_fail(r->diag, LS_ERR_NOMEM, "out of memory for residuals");
    for (uint32_t s = 0; s < c->n_channels && room; s++) {
        const char *name = c->channels[s].name;
        double sigma = middle_sigma(c, s, room);
        put(r, 100 * sigma, "%", "error of k in %s, middle light", name);
        put(r, 100 * grey->gains[s].sigma_mean, "%", "of that, common to all lights of %s", name);
        put(r, grey->gains[s].chi2, "", "chi2 per degree of freedom in %s", name);
        if (sigma > good_sigma_k)
            ls_calibrate_remark(remarks,
                                "the gains in %s are known to %.1f %% only: use longer exposures",
                                name, 100 * sigma);
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
        ls_calibrate_remark(
            remarks,
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
        ls_calibrate_remark(
            remarks,
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
        ls_calibrate_remark(
            remarks,
            "highlights of %u lights on the black sphere are saturated: their polarisation "
            "comes from the half vector; add a shorter exposure",
            gloss->n_saturated);
    if (gloss->model_rms > good_model)
        ls_calibrate_remark(
            remarks,
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
        ls_calibrate_remark(
            remarks,
            "%u lights are dead in some channel, light %u first: replace them, or leave "
            "them out",
            dead, first);
    if (uncertain)
        ls_calibrate_remark(remarks,
                            "%u lights could not be measured from here: their gains are taken as 1",
                            uncertain);
}

enum ls_err ls_calibrate_residuals(const struct ls_calibrate_measured *m, struct ls_calibration *c,
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
    return r.err;
}
