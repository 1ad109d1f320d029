#include "core/grey_sphere_work.h"

#include "core/merge.h"
#include "core/vec3.h"

#include <stdlib.h>
#include <string.h>

void ls_grey_destroy(struct ls_grey *grey)
{
    if (!grey)
        return;
    for (uint32_t k = 0; k < grey->n_cameras; k++)
        ls_sphere_view_destroy(grey->cameras[k].view);
    free(grey->numbers);
    free(grey->flags);
    free(grey->shading);
    free(grey->direction);
    free(grey->sigma_direction_deg);
    free(grey->factors);
    free(grey);
}

static struct ls_shading *fits_of(const struct ls_grey *grey, uint32_t channel)
{
    return grey->shading + (size_t)channel * grey->n_lights * grey->n_cameras;
}

void ls_grey_strength(const struct ls_grey *grey, uint32_t light, uint32_t channel, uint32_t camera,
                      double strength[3])
{
    const struct ls_shading *s = fits_of(grey, channel) + (size_t)light * grey->n_cameras + camera;
    for (uint32_t c = 0; c < 3; c++)
        strength[c] = s->sigma[c] > 0 ? s->strength[c] : 0;
}

/* ---- one channel, one camera ---- */

static void position_of(const struct ls_grey_work *w, uint32_t light, double position[3])
{
    for (int k = 0; k < 3; k++)
        position[k] = (double)w->rig->position_m[light][k];
}

static enum ls_err use_light(void *user, const struct ls_lit_picture *picture, const float *e,
                             const uint8_t *validity, struct ls_diag *diag)
{
    struct ls_grey_work *w = user;
    const struct ls_sphere_view *view = w->grey->cameras[w->camera].view;
    uint32_t light = (uint32_t)picture->light;
    double position[3];
    position_of(w, light, position);
    for (uint32_t j = 0; picture->channel == w->grey->white && j < view->n; j++)
        w->n_saturated += validity[view->pixels[j].index] == LS_VALIDITY_SATURATED;
    w->n_px += picture->channel == w->grey->white ? view->n : 0;
    if (w->sums)
        ls_grey_sums_add(w, light, e, validity);
    return ls_shading_fit(view, position, e, validity, &w->fits[(size_t)light * w->stride], diag);
}

enum ls_err ls_grey_fit(struct ls_grey_work *w, uint32_t every)
{
    uint32_t n = w->grey->n_lights, m = 0;
    LS_CLEANUP_FREE const struct ls_lit_picture **some = calloc(n, sizeof *some);
    if (!some)
        return ls_fail(w->diag, LS_ERR_NOMEM, "out of memory for a grey sphere");
    for (uint32_t i = 0; i < n; i += every)
        some[m++] = w->lights[(size_t)w->channel * n + i];
    return w->source->read(w->source->user, w->camera, some, m,
                           &w->grey->cameras[w->camera].outline, use_light, w, w->diag);
}

static enum ls_err measure_channel(struct ls_grey_work *w, uint32_t channel, uint32_t camera)
{
    struct ls_grey_sums sums;
    w->channel = channel;
    w->camera = camera;
    w->fits = fits_of(w->grey, channel) + camera;
    w->stride = w->grey->n_cameras;
    enum ls_err err = ls_grey_sums_begin(w, &sums);
    w->sums = &sums;
    if (!err)
        err = ls_grey_fit(w, 1);
    if (!err)
        err = ls_grey_factors(w);
    w->sums = NULL;
    ls_grey_sums_end(&sums);
    return err;
}

/* ---- lights ---- */

static enum ls_err solve(struct ls_grey_work *w, uint32_t channel)
{
    struct ls_grey *grey = w->grey;
    uint32_t n = grey->n_lights, m = grey->n_cameras, colours = grey->n_colours;
    LS_CLEANUP_FREE double *strength = calloc((size_t)n * m * (2 * colours + 1), sizeof *strength);
    LS_CLEANUP_FREE uint8_t *one_sided = calloc(n, 1);
    double eye[LS_CALIBRATION_MAX_CAMERAS][3];
    struct ls_diag inner = {{0}};
    if (!strength || !one_sided)
        return ls_fail(w->diag, LS_ERR_NOMEM, "out of memory for a grey sphere");
    double *sigma = strength + (size_t)n * m * colours, *lit = sigma + (size_t)n * m * colours;
    for (uint32_t k = 0; k < n * m; k++) {
        const struct ls_shading *s = fits_of(grey, channel) + k;
        memcpy(strength + (size_t)k * colours, s->strength, colours * sizeof *strength);
        memcpy(sigma + (size_t)k * colours, s->sigma, colours * sizeof *sigma);
        lit[k] = s->lit;
    }
    for (uint32_t k = 0; k < m; k++)
        memcpy(eye[k], w->rig->cameras[k].pinhole.eye_m, sizeof eye[k]);
    for (uint32_t i = 0; i < n; i++) {
        double direction[3];
        position_of(w, i, direction);
        ls_unit3(direction);
        one_sided[i] = ls_gains_one_sided(direction, (const double(*)[3])eye, m);
    }
    const struct ls_gains_input input = {n, m, colours, strength, sigma, lit, one_sided};
    enum ls_err err = ls_gains_solve(&input, &grey->gains[channel], &inner);
    for (uint32_t i = 0; i < n; i++)
        grey->flags[i] |= grey->gains[channel].flags[i];
    return err ? ls_fail(w->diag, err, "%s: %.300s", w->rig->channels[channel].name, inner.text)
               : LS_OK;
}

static void place_lights(struct ls_grey_work *w)
{
    struct ls_grey *grey = w->grey;
    for (uint32_t i = 0; i < grey->n_lights; i++) {
        double nominal[3];
        position_of(w, i, nominal);
        ls_unit3(nominal);
        memcpy(grey->direction[i], nominal, sizeof nominal);
        if (ls_direction_combine(nominal, fits_of(grey, grey->white) + (size_t)i * grey->n_cameras,
                                 grey->n_cameras, grey->direction[i], &grey->sigma_direction_deg[i],
                                 NULL))
            grey->sigma_direction_deg[i] = 0;
    }
}

/* ---- scales ---- */

/* White comes first. */
static enum ls_err close_camera(struct ls_grey_work *w, uint32_t camera)
{
    struct ls_grey *grey = w->grey;
    const struct ls_gains *channels[LS_CALIBRATION_MAX_CHANNELS] = {&grey->gains[grey->white]};
    uint32_t order[LS_CALIBRATION_MAX_CHANNELS] = {grey->white}, n = 1;
    double rho[LS_CALIBRATION_MAX_CHANNELS * 3];
    float p[LS_CALIBRATION_MAX_CHANNELS][3] = {{0}};
    for (uint32_t c = 0; c < grey->n_channels; c++)
        if (c != grey->white) {
            channels[n] = &grey->gains[c];
            order[n++] = c;
        }
    for (uint32_t k = 0; k < n * grey->n_colours; k++)
        rho[k] = w->rig->reflectance;
    enum ls_err err = ls_gains_closure(channels, n, camera, grey->n_colours, rho,
                                       &grey->cameras[camera].scale, p, w->diag);
    for (uint32_t k = 0; k < n && !err; k++)
        memcpy(grey->cameras[camera].p[order[k]], p[k], sizeof p[k]);
    return err;
}

static enum ls_err conclude(struct ls_grey_work *w)
{
    struct ls_grey *grey = w->grey;
    enum ls_err err =
        ls_shading_settle(grey->shading, grey->n_lights * grey->n_channels * grey->n_cameras,
                          &grey->settled, w->diag);
    for (uint32_t c = 0; c < grey->n_channels && !err; c++)
        err = solve(w, c);
    for (uint32_t c = 0; c < grey->n_channels && !err; c++)
        if (!w->rig->channels[c].spectrum)
            err =
                ls_gains_scale_polarised(&grey->gains[c], &grey->gains[grey->white], grey->n_lights,
                                         grey->n_cameras, grey->n_colours, w->diag);
    for (uint32_t k = 0; k < grey->n_cameras && !err; k++)
        err = close_camera(w, k);
    if (!err)
        place_lights(w);
    return err;
}

/* ---- the whole ---- */

static enum ls_err measure(struct ls_grey_work *w)
{
    struct ls_grey *grey = w->grey;
    enum ls_err err = LS_OK;
    for (uint32_t k = 0; k < grey->n_cameras && !err; k++) {
        w->camera = k;
        err = ls_grey_place(w);
    }
    for (uint32_t c = 0; c < grey->n_channels && !err; c++) {
        uint32_t first = grey->n_factors;
        for (uint32_t k = 0; k < grey->n_cameras && !err; k++)
            err = measure_channel(w, c, k);
        if (!err)
            err = ls_grey_combine(grey, first, w->diag);
    }
    return err ? err : conclude(w);
}

static enum ls_err sort_pictures(struct ls_grey_work *w)
{
    const struct ls_grey_rig *rig = w->rig;
    for (uint32_t k = 0; k < rig->n_pictures; k++) {
        const struct ls_lit_picture *p = &rig->pictures[k];
        if (p->channel >= rig->n_channels || (p->light < 0 && !p->weights) ||
            (p->light >= 0 && (uint32_t)p->light >= rig->n_lights))
            return ls_fail(w->diag, LS_ERR_INVALID, "%s: shows no light or channel of the rig",
                           p->id);
        if (p->light >= 0)
            w->lights[(size_t)p->channel * rig->n_lights + (uint32_t)p->light] = p;
    }
    for (uint32_t k = 0; k < rig->n_channels * rig->n_lights; k++)
        if (!w->lights[k])
            return ls_fail(w->diag, LS_ERR_STATE,
                           "the take does not show every light of the rig in %s, light %u for one: "
                           "photograph the grey sphere with kind \"each\" in every channel and all "
                           "lights",
                           rig->channels[k / rig->n_lights].name, k % rig->n_lights);
    return LS_OK;
}

static enum ls_err check(const struct ls_grey_rig *rig, uint32_t *white, struct ls_diag *diag)
{
    bool mono = rig->cameras[0].cfa == LS_CFA_NONE;
    if (rig->n_lights < 1 || rig->n_lights > LS_CALIBRATION_MAX_LIGHTS || rig->n_channels < 1 ||
        rig->n_channels > LS_CALIBRATION_MAX_CHANNELS || rig->n_cameras < 1 ||
        rig->n_cameras > LS_CALIBRATION_MAX_CAMERAS)
        return ls_fail(diag, LS_ERR_LIMIT, "grey sphere: %u lights, %u channels, %u cameras",
                       rig->n_lights, rig->n_channels, rig->n_cameras);
    for (uint32_t k = 1; k < rig->n_cameras; k++)
        if ((rig->cameras[k].cfa == LS_CFA_NONE) != mono)
            return ls_fail(diag, LS_ERR_INVALID,
                           "grey sphere: some cameras see colours and some do not: measure them "
                           "apart");
    for (*white = 0; *white < rig->n_channels; ++*white)
        if (rig->channels[*white].spectrum)
            return LS_OK;
    return ls_fail(diag, LS_ERR_STATE, "the rig has no channel of kind spectrum");
}

static enum ls_err allocate(struct ls_grey_work *w)
{
    const struct ls_grey_rig *rig = w->rig;
    struct ls_grey *grey = w->grey;
    size_t n = rig->n_lights, m = rig->n_channels, px = 0;
    size_t each = n * (3 + grey->n_colours);
    for (uint32_t k = 0; k < rig->n_cameras; k++) {
        const struct ls_pinhole *p = &rig->cameras[k].pinhole;
        px = px > (size_t)p->width * p->height ? px : (size_t)p->width * p->height;
    }
    grey->numbers = calloc(each * m, sizeof *grey->numbers);
    grey->flags = calloc(n, m + 1);
    grey->shading = calloc(n * m * rig->n_cameras, sizeof *grey->shading);
    grey->direction = calloc(n, sizeof *grey->direction);
    grey->sigma_direction_deg = calloc(n, sizeof *grey->sigma_direction_deg);
    grey->factors = calloc(LS_GREY_PATTERNS * m * rig->n_cameras, sizeof *grey->factors);
    w->lights = calloc(n * m, sizeof *w->lights);
    w->whole = calloc(px, sizeof *w->whole);
    w->whole_validity = calloc(px, 1);
    if (!grey->numbers || !grey->flags || !grey->shading || !grey->direction ||
        !grey->sigma_direction_deg || !grey->factors || !w->lights || !w->whole ||
        !w->whole_validity)
        return ls_fail(w->diag, LS_ERR_NOMEM, "out of memory for a grey sphere");
    for (uint32_t c = 0; c < m; c++) {
        double *at = grey->numbers + each * c;
        grey->gains[c] = (struct ls_gains){.g = at,
                                           .k = at + n,
                                           .sigma_k = at + 2 * n,
                                           .colour = at + 3 * n,
                                           .flags = grey->flags + n * (c + 1)};
    }
    return LS_OK;
}

enum ls_err ls_grey_measure(const struct ls_grey_rig *rig, const struct ls_grey_source *source,
                            struct ls_grey **out, struct ls_diag *diag)
{
    uint32_t white = 0;
    enum ls_err err = check(rig, &white, diag);
    if (err)
        return err;
    struct ls_grey *grey = calloc(1, sizeof *grey);
    struct ls_grey_work w = {.rig = rig, .source = source, .grey = grey, .diag = diag};
    if (!grey)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for a grey sphere");
    grey->n_lights = rig->n_lights;
    grey->n_channels = rig->n_channels;
    grey->n_cameras = rig->n_cameras;
    grey->n_colours = rig->cameras[0].cfa == LS_CFA_NONE ? 1 : 3;
    grey->white = white;
    err = allocate(&w);
    if (!err)
        err = sort_pictures(&w);
    if (!err)
        err = measure(&w);
    free(w.lights);
    free(w.whole);
    free(w.whole_validity);
    if (err)
        ls_grey_destroy(grey);
    else
        *out = grey;
    return err;
}
