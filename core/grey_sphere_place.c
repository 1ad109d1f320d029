#include "core/grey_sphere_work.h"

#include "core/sample.h"
#include "core/vec3.h"

#include <stdlib.h>
#include <string.h>

/* What a matte sphere's pictures never show. */
static const double most_misfit = 0.10, most_rejected = 0.25, most_saturated = 0.02;
static const double most_step_m = 0.05, well_lit = 0.4;
enum { MOST_PASSES = 4, ENOUGH_LIGHTS = 100 };

/* ---- its outline ---- */

static enum ls_err copy_picture(void *user, const struct ls_lit_picture *picture, const float *e,
                                const uint8_t *validity, struct ls_diag *diag)
{
    struct ls_grey_work *w = user;
    const struct ls_pinhole *p = &w->rig->cameras[w->camera].pinhole;
    memcpy(w->whole, e, (size_t)p->width * p->height * sizeof *e);
    return LS_OK;
}

static enum ls_err not_found(const struct ls_grey_work *w, const struct ls_diag *why)
{
    return ls_fail(w->diag, LS_ERR_NOT_FOUND,
                   "%.300s; put the grey sphere at the stage's centre, whole in the picture of the "
                   "camera, and check its radius",
                   why->text);
}

static const struct ls_lit_picture *full_sphere(const struct ls_grey_work *w)
{
    for (uint32_t k = 0; k < w->rig->n_pictures; k++) {
        const struct ls_lit_picture *p = &w->rig->pictures[k];
        if (p->channel == w->grey->white && p->light < 0 && strcmp(p->pattern, "sphere") == 0)
            return p;
    }
    return NULL;
}

/* A sphere of another radius seems to stand nearer or farther by as much. */
static enum ls_err judge_place(const struct ls_grey_work *w, const struct ls_sphere *found)
{
    const struct ls_sphere *nominal = &w->rig->nominal;
    const double *eye = w->rig->cameras[w->camera].pinhole.eye_m;
    double off[3], near[3], far[3];
    ls_along3(found->centre_m, nominal->centre_m, -1, off);
    ls_along3(nominal->centre_m, eye, -1, near);
    ls_along3(found->centre_m, eye, -1, far);
    if (ls_length3(off) < nominal->radius_m)
        return LS_OK;
    return ls_fail(
        w->diag, LS_ERR_NOT_FOUND,
        "the outline puts the grey sphere %.0f mm from the stage's centre, if its radius "
        "is %.0f mm; were it %.0f mm, it would stand there: check its radius, its place "
        "and the camera's in the rig file",
        1e3 * ls_length3(off), 1e3 * nominal->radius_m,
        1e3 * nominal->radius_m * ls_length3(near) / ls_length3(far));
}

static enum ls_err locate(struct ls_grey_work *w)
{
    struct ls_grey_view *v = &w->grey->cameras[w->camera];
    const struct ls_lit_picture *sphere = full_sphere(w);
    struct ls_diag inner = {{0}};
    if (!sphere)
        return ls_fail(w->diag, LS_ERR_STATE,
                       "the take has no full sphere in %s, where the grey sphere's outline is "
                       "looked for: photograph one",
                       w->rig->channels[w->grey->white].name);
    enum ls_err err =
        w->source->read(w->source->user, w->camera, &sphere, 1, NULL, copy_picture, w, w->diag);
    if (err)
        return err;
    err = ls_sphere_locate(&w->rig->cameras[w->camera].pinhole, w->whole, &w->rig->nominal,
                           &v->sphere, &v->outline, &inner);
    return err ? not_found(w, &inner) : judge_place(w, &v->sphere);
}

static enum ls_err look(struct ls_grey_work *w)
{
    struct ls_grey_view *v = &w->grey->cameras[w->camera];
    const struct ls_pinhole *pinhole = &w->rig->cameras[w->camera].pinhole;
    struct ls_diag inner = {{0}};
    ls_sphere_view_destroy(v->view);
    v->view = NULL;
    enum ls_err err = ls_sphere_view_create(pinhole, w->rig->cameras[w->camera].cfa, &v->sphere,
                                            NULL, 0, &v->view, &inner);
    if (!err)
        err = ls_sphere_outline(pinhole, &v->sphere, &v->outline, &inner);
    return err ? not_found(w, &inner) : LS_OK;
}

/* ---- its shading: is it a grey sphere, and where exactly? ---- */

static enum ls_err judge(struct ls_grey_work *w, const struct ls_shading *fits)
{
    struct ls_grey_view *v = &w->grey->cameras[w->camera];
    uint32_t n = 0, n_lights = w->grey->n_lights;
    LS_CLEANUP_FREE float *misfit = calloc(2 * (size_t)n_lights, sizeof *misfit);
    if (!misfit)
        return ls_fail(w->diag, LS_ERR_NOMEM, "out of memory for a grey sphere");
    float *rejected = misfit + n_lights;
    for (uint32_t i = 0; i < n_lights; i++)
        if (fits[i].lit > well_lit) {
            misfit[n] = (float)fits[i].misfit;
            rejected[n++] = (float)fits[i].rejected;
        }
    v->misfit = n ? (double)ls_median(misfit, n) : 0;
    v->rejected = n ? (double)ls_median(rejected, n) : 0;
    v->saturated = w->n_px ? (double)w->n_saturated / (double)w->n_px : 0;
    if (v->saturated > most_saturated)
        return ls_fail(w->diag, LS_ERR_NOT_FOUND,
                       "%.0f %% of the grey sphere is saturated under single lights even in the "
                       "shortest exposure: use shorter exposures",
                       100 * v->saturated);
    if (!(v->misfit < most_misfit) || !(v->rejected < most_rejected))
        return ls_fail(w->diag, LS_ERR_NOT_FOUND,
                       "what stands in the middle is not shaded like a matte sphere (%.0f %% off, "
                       "%.0f %% of its pixels far off): put the grey sphere there, at the stage's "
                       "centre, and check its radius",
                       100 * v->misfit, 100 * v->rejected);
    return LS_OK;
}

/* One Gauss-Newton step of the sphere's centre; @far: by more than its error. */
static enum ls_err move(struct ls_grey_work *w, struct ls_shading *fits, bool *far)
{
    struct ls_grey_view *v = &w->grey->cameras[w->camera];
    struct ls_shading_settled settled;
    double step[3], sigma[3];
    enum ls_err err = ls_shading_settle(fits, w->grey->n_lights, &settled, w->diag);
    if (!err)
        err = ls_centre_step(fits, w->grey->n_lights, settled.moved ? settled.spread_deg : 0, step,
                             sigma, w->diag);
    if (err)
        return err;
    for (int k = 0; k < 3; k++)
        v->sphere.centre_m[k] += step[k];
    *far = ls_length3(step) > ls_length3(sigma);
    if (!(ls_length3(step) < most_step_m))
        return ls_fail(w->diag, LS_ERR_NOT_FOUND,
                       "the shading puts the sphere %.0f mm from its outline: check its radius and "
                       "the camera's position in the rig file",
                       1e3 * ls_length3(step));
    return look(w);
}

static enum ls_err refine(struct ls_grey_work *w)
{
    uint32_t n = w->grey->n_lights, every = n > ENOUGH_LIGHTS ? n / ENOUGH_LIGHTS : 1;
    LS_CLEANUP_FREE struct ls_shading *fits = calloc(n, sizeof *fits);
    enum ls_err err =
        fits ? LS_OK : ls_fail(w->diag, LS_ERR_NOMEM, "out of memory for a grey sphere");
    bool far = true;
    w->fits = fits;
    w->stride = 1;
    w->channel = w->grey->white;
    for (int pass = 0; pass < MOST_PASSES && far && !err; pass++) {
        w->n_px = w->n_saturated = 0;
        err = ls_grey_fit(w, every);
        if (!err)
            err = judge(w, fits);
        if (!err)
            err = move(w, fits, &far);
    }
    return err;
}

enum ls_err ls_grey_place(struct ls_grey_work *w)
{
    enum ls_err err = locate(w);
    if (!err)
        err = look(w);
    return err ? err : refine(w);
}
