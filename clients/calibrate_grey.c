#include "clients/calibrate_grey.h"

#include "core/merge.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* What a matte sphere's pictures never show. */
static const double most_misfit = 0.10, most_rejected = 0.25, most_saturated = 0.02;
static const double most_step_m = 0.05, well_lit = 0.4;
enum { MOST_PASSES = 4 };

/* The pictures of one channel being added up. */
struct sums {
    const struct ls_calibrate_picture **pattern;
    uint32_t n, at;    /* at: of those handed out so far */
    float *sum;        /* [pattern][pixel of the view] */
    uint8_t *validity; /* the same */
};

struct work {
    const struct ls_calibrate_take *take;
    struct ls_grey *grey;
    uint32_t channel, white;
    struct ls_shading *fits; /* where this pass puts them, [light] with a stride */
    uint32_t stride;
    struct sums *sums; /* NULL in the first pass */
    uint64_t n_px, n_saturated;
    float *whole; /* a picture of the camera's size */
    uint8_t *whole_validity;
};

void ls_grey_destroy(struct ls_grey *grey)
{
    if (!grey)
        return;
    ls_sphere_view_destroy(grey->view);
    free(grey->numbers);
    free(grey->flags);
    free(grey->shading);
    free(grey->factors);
    free(grey);
}

void ls_grey_strength(const struct ls_grey *grey, uint32_t light, uint32_t channel,
                      double strength[3])
{
    const struct ls_shading *s = &grey->shading[(size_t)light * grey->n_channels + channel];
    for (uint32_t c = 0; c < 3; c++)
        strength[c] = s->sigma[c] > 0 ? s->strength[c] : 0;
}

static struct ls_diag *diag_of(const struct work *w)
{
    return &w->take->context->diag;
}

static const char *name_of(const struct work *w, uint32_t channel)
{
    return w->take->document->channels[channel].name;
}

/* ---- where the sphere is ---- */

static enum ls_err copy_picture(void *user, const struct ls_calibrate_picture *picture,
                                const float *e, const uint8_t *validity, struct ls_diag *diag)
{
    struct work *w = user;
    const struct ls_take_document *d = w->take->document;
    memcpy(w->whole, e, (size_t)d->width * d->height * sizeof *e);
    return LS_OK;
}

static enum ls_err not_found(const struct work *w, const struct ls_diag *why)
{
    return ls_fail(diag_of(w), LS_ERR_NOT_FOUND,
                   "%.300s Put the grey sphere at the stage's centre, whole in the picture of the "
                   "camera, and check --radius",
                   why->text);
}

static enum ls_err locate(struct work *w, double radius_m)
{
    const struct ls_sphere nominal = {.radius_m = radius_m};
    const struct ls_calibrate_region all = {0};
    const struct ls_calibrate_picture *sphere = ls_calibrate_find(w->take, w->white, -1, "sphere");
    if (!sphere)
        return ls_fail(
            diag_of(w), LS_ERR_STATE,
            "take %s has no full sphere in %s, where the grey sphere's outline is looked "
            "for: photograph one",
            w->take->id, name_of(w, w->white));
    enum ls_err err = ls_calibrate_fetch(w->take, &sphere, 1, all, copy_picture, w);
    struct ls_diag inner = {0};
    if (err)
        return err;
    err = ls_sphere_locate(&w->take->camera, w->whole, &nominal, &w->grey->sphere,
                           &w->grey->outline, &inner);
    return err ? not_found(w, &inner) : LS_OK;
}

static enum ls_err look(struct work *w)
{
    struct ls_diag inner = {0};
    ls_sphere_view_destroy(w->grey->view);
    w->grey->view = NULL;
    enum ls_err err = ls_sphere_view_create(&w->take->camera, w->take->document->cfa,
                                            &w->grey->sphere, NULL, 0, &w->grey->view, &inner);
    if (!err)
        err = ls_sphere_outline(&w->take->camera, &w->grey->sphere, &w->grey->outline, &inner);
    return err ? not_found(w, &inner) : LS_OK;
}

/* ---- one picture ---- */

static void add_to_sums(const struct ls_sphere_view *view, struct sums *s, uint32_t light,
                        const float *e, const uint8_t *validity)
{
    for (uint32_t k = 0; k < s->n; k++) {
        float weight = s->pattern[k]->weights[light];
        float *sum = s->sum + (size_t)k * view->n;
        uint8_t *worst = s->validity + (size_t)k * view->n;
        for (uint32_t j = 0; weight > 0 && j < view->n; j++) {
            uint32_t at = view->pixels[j].index;
            sum[j] += weight * e[at];
            if (validity[at] != LS_VALIDITY_OK)
                worst[j] = validity[at];
        }
    }
}

static enum ls_err use_light(void *user, const struct ls_calibrate_picture *picture, const float *e,
                             const uint8_t *validity, struct ls_diag *diag)
{
    struct work *w = user;
    const struct ls_sphere_view *view = w->grey->view;
    uint32_t light = (uint32_t)picture->light;
    const float *p = w->take->document->position_m[light];
    const double position[3] = {(double)p[0], (double)p[1], (double)p[2]};
    for (uint32_t j = 0; picture->channel == w->white && j < view->n; j++)
        w->n_saturated += validity[view->pixels[j].index] == LS_VALIDITY_SATURATED;
    w->n_px += picture->channel == w->white ? view->n : 0;
    if (w->sums)
        add_to_sums(view, w->sums, light, e, validity);
    return ls_shading_fit(view, position, e, validity, &w->fits[(size_t)light * w->stride], diag);
}

static enum ls_err fit_channel(struct work *w)
{
    const struct ls_take_document *d = w->take->document;
    LS_CLEANUP_FREE const struct ls_calibrate_picture **lights =
        calloc(d->n_lights, sizeof *lights);
    uint32_t n = 0;
    if (!lights)
        return ls_fail(diag_of(w), LS_ERR_NOMEM, "out of memory");
    for (uint32_t i = 0; i < w->take->n_pictures; i++)
        if (w->take->pictures[i].channel == w->channel && w->take->pictures[i].light >= 0)
            lights[n++] = &w->take->pictures[i];
    return ls_calibrate_fetch(w->take, lights, n, ls_calibrate_around(w->take, &w->grey->outline),
                              use_light, w);
}

/* ---- is it a grey sphere, and where exactly? ---- */

static int ascending(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static double middle(double *v, uint32_t n)
{
    qsort(v, n, sizeof *v, ascending);
    return n ? v[n / 2] : 0;
}

static enum ls_err judge(struct work *w, const struct ls_shading *fits)
{
    struct ls_grey *grey = w->grey;
    LS_CLEANUP_FREE double *misfit = calloc(2 * (size_t)grey->n_lights, sizeof *misfit);
    uint32_t n = 0;
    if (!misfit)
        return ls_fail(diag_of(w), LS_ERR_NOMEM, "out of memory");
    double *rejected = misfit + grey->n_lights;
    for (uint32_t i = 0; i < grey->n_lights; i++)
        if (fits[i].lit > well_lit) {
            misfit[n] = fits[i].misfit;
            rejected[n++] = fits[i].rejected;
        }
    grey->misfit = middle(misfit, n);
    grey->rejected = middle(rejected, n);
    grey->saturated = w->n_px ? (double)w->n_saturated / (double)w->n_px : 0;
    if (grey->saturated > most_saturated)
        return ls_fail(diag_of(w), LS_ERR_NOT_FOUND,
                       "%.0f %% of the grey sphere is saturated under single lights even in the "
                       "shortest exposure: use shorter exposures",
                       100 * grey->saturated);
    if (!(grey->misfit < most_misfit) || !(grey->rejected < most_rejected))
        return ls_fail(diag_of(w), LS_ERR_NOT_FOUND,
                       "what stands in the middle is not shaded like a matte sphere (%.0f %% off, "
                       "%.0f %% of its pixels far off): put the grey sphere there, at the stage's "
                       "centre, and check --radius",
                       100 * grey->misfit, 100 * grey->rejected);
    return LS_OK;
}

/* One Gauss-Newton step of the sphere's centre; @far: by more than its error. */
static enum ls_err move(struct work *w, const struct ls_shading *fits, bool *far)
{
    struct ls_grey *grey = w->grey;
    double step[3], sigma[3];
    enum ls_err err = ls_centre_step(fits, grey->n_lights, step, sigma, diag_of(w));
    if (err)
        return err;
    double length = hypot(hypot(step[0], step[1]), step[2]);
    for (int k = 0; k < 3; k++)
        grey->sphere.centre_m[k] += step[k];
    *far = length > hypot(hypot(sigma[0], sigma[1]), sigma[2]);
    if (!(length < most_step_m))
        return ls_fail(
            diag_of(w), LS_ERR_NOT_FOUND,
            "the shading puts the sphere %.0f mm from its outline: check --radius and the "
            "camera's position in the rig file",
            1e3 * length);
    return look(w);
}

/* Passes over white find where the sphere really stands. An outline may be millimetres off along
 * the view, where a step leaves a tenth; 0.3 mm there are 0.1 % of a gain, the same in all colours.
 */
static enum ls_err refine(struct work *w)
{
    LS_CLEANUP_FREE struct ls_shading *fits = calloc(w->grey->n_lights, sizeof *fits);
    enum ls_err err = fits ? LS_OK : ls_fail(diag_of(w), LS_ERR_NOMEM, "out of memory");
    bool far = true;
    w->fits = fits;
    w->stride = 1;
    w->channel = w->white;
    for (int pass = 0; pass < MOST_PASSES && far && !err; pass++) {
        memset(fits, 0, w->grey->n_lights * sizeof *fits);
        w->n_px = w->n_saturated = 0;
        err = fit_channel(w);
        if (!err)
            err = judge(w, fits);
        if (!err)
            err = move(w, fits, &far);
    }
    return err;
}

/* ---- patterns ---- */

static enum ls_err begin_sums(struct work *w, struct sums *s)
{
    *s = (struct sums){.pattern = calloc(LS_GREY_PATTERNS, sizeof *s->pattern)};
    if (!s->pattern)
        return ls_fail(diag_of(w), LS_ERR_NOMEM, "out of memory");
    for (uint32_t i = 0; i < w->take->n_pictures; i++) {
        const struct ls_calibrate_picture *p = &w->take->pictures[i];
        if (p->channel != w->channel || p->light >= 0)
            continue;
        if (s->n == LS_GREY_PATTERNS)
            return ls_fail(diag_of(w), LS_ERR_LIMIT,
                           "take %s has more than %d pictures of patterns in %s", w->take->id,
                           LS_GREY_PATTERNS, name_of(w, w->channel));
        s->pattern[s->n++] = p;
    }
    s->sum = calloc((size_t)s->n * w->grey->view->n + 1, sizeof *s->sum);
    s->validity = calloc((size_t)s->n * w->grey->view->n + 1, 1);
    return s->sum && s->validity ? LS_OK : ls_fail(diag_of(w), LS_ERR_NOMEM, "out of memory");
}

static void end_sums(struct sums *s)
{
    free(s->pattern);
    free(s->sum);
    free(s->validity);
}

static enum ls_err use_pattern(void *user, const struct ls_calibrate_picture *picture,
                               const float *e, const uint8_t *validity, struct ls_diag *diag)
{
    struct work *w = user;
    struct ls_grey *grey = w->grey;
    uint32_t k = w->sums->at++;
    for (uint32_t j = 0; j < grey->view->n; j++) {
        uint32_t at = grey->view->pixels[j].index;
        w->whole[at] = w->sums->sum[(size_t)k * grey->view->n + j];
        w->whole_validity[at] = w->sums->validity[(size_t)k * grey->view->n + j];
    }
    struct ls_pattern_factor factor;
    struct ls_diag inner = {0};
    if (ls_pattern_factor(grey->view, w->whole, w->whole_validity, e, validity, picture->duty,
                          &factor, &inner))
        return ls_fail(diag, LS_ERR_NOT_FOUND, "%s: %.300s", picture->id, inner.text);
    struct ls_grey_factor *out = &grey->factors[grey->n_factors++];
    *out = (struct ls_grey_factor){picture->channel, "", picture->duty, factor, 1};
    memcpy(out->pattern, picture->pattern, sizeof out->pattern);
    return LS_OK;
}

static bool same_class(const struct ls_grey_factor *a, const struct ls_grey_factor *b)
{
    return a->channel == b->channel && !strcmp(a->pattern, b->pattern) && a->duty == b->duty;
}

/* The pictures of a partition become one factor. From @first on. */
static enum ls_err combine(struct ls_grey *grey, uint32_t first, struct ls_diag *diag)
{
    uint32_t kept = first;
    LS_CLEANUP_FREE struct ls_pattern_factor *each = calloc(LS_GREY_PATTERNS, sizeof *each);
    enum ls_err err = each ? LS_OK : ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    for (uint32_t i = first; i < grey->n_factors && !err; i++) {
        struct ls_grey_factor head = grey->factors[i];
        uint32_t n = 0;
        bool known = false;
        for (uint32_t j = first; j < kept; j++)
            known |= same_class(&grey->factors[j], &head);
        for (uint32_t j = i; j < grey->n_factors && !known; j++)
            if (same_class(&grey->factors[j], &head))
                each[n++] = grey->factors[j].value;
        if (known)
            continue;
        head.pictures = n;
        err = ls_pattern_factor_combine(each, n, &head.value, diag);
        grey->factors[kept++] = head;
    }
    grey->n_factors = kept;
    return err;
}

static enum ls_err fit_patterns(struct work *w)
{
    uint32_t first = w->grey->n_factors;
    enum ls_err err =
        ls_calibrate_fetch(w->take, w->sums->pattern, w->sums->n,
                           ls_calibrate_around(w->take, &w->grey->outline), use_pattern, w);
    return err ? err : combine(w->grey, first, diag_of(w));
}

/* ---- gains ---- */

static enum ls_err solve(struct work *w, uint32_t channel)
{
    struct ls_grey *grey = w->grey;
    uint32_t n = grey->n_lights, colours = grey->n_colours;
    LS_CLEANUP_FREE double *strength = calloc((size_t)n * (2 * colours + 1), sizeof *strength);
    LS_CLEANUP_FREE uint8_t *one_sided = calloc(n, 1);
    LS_CLEANUP_FREE uint8_t *flags = calloc(n, 1);
    if (!strength || !one_sided || !flags)
        return ls_fail(diag_of(w), LS_ERR_NOMEM, "out of memory");
    double *sigma = strength + (size_t)n * colours, *lit = sigma + (size_t)n * colours;
    for (uint32_t i = 0; i < n; i++) {
        const struct ls_shading *s = &grey->shading[(size_t)i * grey->n_channels + channel];
        const float *v = w->take->document->direction[i];
        const double direction[3] = {(double)v[0], (double)v[1], (double)v[2]};
        memcpy(strength + (size_t)i * colours, s->strength, colours * sizeof *strength);
        memcpy(sigma + (size_t)i * colours, s->sigma, colours * sizeof *sigma);
        lit[i] = s->lit;
        one_sided[i] = ls_gains_one_sided(direction, &w->take->camera.eye_m, 1);
    }
    const struct ls_gains_input input = {n, 1, colours, strength, sigma, lit, one_sided};
    grey->gains[channel].flags = flags;
    struct ls_diag inner = {0};
    enum ls_err err = ls_gains_solve(&input, &grey->gains[channel], &inner);
    grey->gains[channel].flags = NULL;
    for (uint32_t i = 0; i < n; i++)
        grey->flags[i] |= flags[i];
    return err ? ls_fail(diag_of(w), err, "%s: %.300s", name_of(w, channel), inner.text) : LS_OK;
}

static enum ls_err solve_all(struct work *w, double reflectance)
{
    struct ls_grey *grey = w->grey;
    const struct ls_take_document *d = w->take->document;
    const struct ls_gains *channels[LS_DOCUMENT_CHANNELS];
    double rho[LS_DOCUMENT_CHANNELS * 3];
    float p[LS_DOCUMENT_CHANNELS][3];
    uint32_t order[LS_DOCUMENT_CHANNELS], n = 0;
    struct ls_shading_settled settled;
    order[n++] = w->white; /* white first */
    for (uint32_t c = 0; c < grey->n_channels; c++)
        if (c != w->white)
            order[n++] = c;
    enum ls_err err =
        ls_shading_settle(grey->shading, grey->n_lights * grey->n_channels, &settled, diag_of(w));
    grey->misplaced_deg = err ? 0 : settled.spread_deg;
    for (uint32_t k = 0; k < n && !err; k++)
        err = solve(w, order[k]);
    for (uint32_t k = 0; k < n && !err; k++)
        if (!d->channels[order[k]].spectrum)
            err = ls_gains_scale_polarised(&grey->gains[order[k]], &grey->gains[w->white],
                                           grey->n_lights, 1, grey->n_colours, diag_of(w));
    for (uint32_t k = 0; k < n; k++)
        channels[k] = &grey->gains[order[k]];
    for (uint32_t k = 0; k < n * grey->n_colours; k++)
        rho[k] = reflectance;
    if (!err)
        err = ls_gains_closure(channels, n, 0, grey->n_colours, rho, &grey->scale, p, diag_of(w));
    for (uint32_t k = 0; k < n && !err; k++)
        memcpy(grey->p[order[k]], p[k], sizeof p[k]);
    return err;
}

/* ---- the whole ---- */

static enum ls_err measure_channel(struct work *w, uint32_t channel)
{
    struct sums sums;
    w->channel = channel;
    w->fits = w->grey->shading + channel;
    w->stride = w->grey->n_channels;
    enum ls_err err = begin_sums(w, &sums);
    w->sums = &sums;
    if (!err)
        err = fit_channel(w);
    if (!err)
        err = fit_patterns(w);
    w->sums = NULL;
    end_sums(&sums);
    return err;
}

static enum ls_err check_complete(const struct work *w)
{
    for (uint32_t c = 0; c < w->grey->n_channels; c++)
        if (!ls_calibrate_has_all(w->take, c))
            return ls_fail(
                diag_of(w), LS_ERR_STATE,
                "take %s does not show every light of the rig in %s: photograph the grey "
                "sphere with kind \"each\" in every channel and all lights",
                w->take->id, name_of(w, c));
    return LS_OK;
}

static enum ls_err measure(struct work *w, double radius_m, double reflectance)
{
    enum ls_err err = check_complete(w);
    if (!err)
        err = locate(w, radius_m);
    if (!err)
        err = look(w);
    if (!err)
        err = refine(w);
    for (uint32_t c = 0; c < w->grey->n_channels && !err; c++)
        err = measure_channel(w, c);
    return err ? err : solve_all(w, reflectance);
}

static enum ls_err allocate(struct work *w)
{
    const struct ls_take_document *d = w->take->document;
    struct ls_grey *grey = w->grey;
    size_t px = (size_t)d->width * d->height, n = d->n_lights;
    grey->n_lights = d->n_lights;
    grey->n_channels = d->n_channels;
    grey->n_colours = d->mono ? 1 : 3;
    size_t each = n * (3 + grey->n_colours);
    grey->numbers = calloc(each * grey->n_channels, sizeof *grey->numbers);
    grey->flags = calloc(n, 1);
    grey->shading = calloc(n * grey->n_channels, sizeof *grey->shading);
    grey->factors = calloc((size_t)LS_GREY_PATTERNS * d->n_channels, sizeof *grey->factors);
    w->whole = calloc(px, sizeof *w->whole);
    w->whole_validity = calloc(px, 1);
    if (!grey->numbers || !grey->flags || !grey->shading || !grey->factors || !w->whole ||
        !w->whole_validity)
        return ls_fail(diag_of(w), LS_ERR_NOMEM, "out of memory");
    for (uint32_t c = 0; c < grey->n_channels; c++) {
        double *at = grey->numbers + each * c;
        grey->gains[c] =
            (struct ls_gains){.g = at, .k = at + n, .sigma_k = at + 2 * n, .colour = at + 3 * n};
    }
    return LS_OK;
}

enum ls_err ls_calibrate_grey(const struct ls_calibrate_take *take, double radius_m,
                              double reflectance, struct ls_grey **out)
{
    struct work w = {.take = take, .grey = calloc(1, sizeof *w.grey)};
    int white = ls_calibrate_white(take);
    if (!w.grey)
        return ls_fail(&take->context->diag, LS_ERR_NOMEM, "out of memory");
    enum ls_err err = allocate(&w);
    if (!err && white < 0)
        err =
            ls_fail(&take->context->diag, LS_ERR_STATE, "the rig has no channel of kind spectrum");
    w.white = (uint32_t)white;
    if (!err)
        err = measure(&w, radius_m, reflectance);
    free(w.whole);
    free(w.whole_validity);
    if (err)
        ls_grey_destroy(w.grey);
    else
        *out = w.grey;
    return err;
}
