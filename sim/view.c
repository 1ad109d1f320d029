#include "sim/view.h"

#include <stdlib.h>
#include <string.h>

int sim_view_cfa(const char *name, enum ls_cfa *out)
{
    static const struct {
        const char *name;
        enum ls_cfa cfa;
    } orders[] = {{"mono", LS_CFA_NONE},
                  {"RG", LS_CFA_RGGB},
                  {"GR", LS_CFA_GRBG},
                  {"GB", LS_CFA_GBRG},
                  {"BG", LS_CFA_BGGR}};
    for (size_t i = 0; i < sizeof orders / sizeof *orders; i++)
        if (!strcmp(name, orders[i].name)) {
            *out = orders[i].cfa;
            return 0;
        }
    return -1;
}

static void aim(const struct sim_view_config *c, struct sim_view *view)
{
    const double *p = c->position_m, *l = c->look_at_m;
    view->eye = sim_vec(p[0], p[1], p[2]);
    view->forward = sim_unit(sim_vec(l[0] - p[0], l[1] - p[1], l[2] - p[2]));
    view->up = sim_upright(view->forward, sim_vec(0, 1, 0));
    view->right = sim_cross(view->forward, view->up);
    view->pitch = c->sensor_width_mm / c->width / c->focal_length_mm;
}

struct sim_vec sim_view_ray(const struct sim_view *view, double x, double y)
{
    double right = (x + 0.5 - view->width / 2.0) * view->pitch;
    double up = (view->height / 2.0 - y - 0.5) * view->pitch;
    struct sim_vec d = sim_along(view->forward, view->right, (float)right);
    return sim_unit(sim_along(d, view->up, (float)up));
}

void sim_view_project(const struct sim_view *view, struct sim_vec point, double *x, double *y)
{
    struct sim_vec d = sim_sub(point, view->eye);
    double depth = sim_dot(d, view->forward);
    *x = depth > 0 ? sim_dot(d, view->right) / depth / view->pitch + view->width / 2.0 : NAN;
    *y = depth > 0 ? view->height / 2.0 - sim_dot(d, view->up) / depth / view->pitch : NAN;
}

static struct sim_vec lean(const struct sim_surface *surface, const struct sim_body *body,
                           const struct sim_hit *hit)
{
    if (surface->bend == 0)
        return hit->normal;
    struct sim_vec u = sim_unit(body->u), v = sim_unit(body->v);
    float along_u = surface->bend * (2 * hit->u - 1), along_v = surface->bend * (2 * hit->v - 1);
    return sim_unit(sim_along(sim_along(hit->normal, u, along_u), v, along_v));
}

static float weave(const struct sim_surface *surface, const struct sim_hit *hit)
{
    if (surface->weave == 0)
        return 1;
    float a = sinf((float)(2 * M_PI) * surface->weave_u * hit->u);
    float b = sinf((float)(2 * M_PI) * surface->weave_v * hit->v);
    return 1 + surface->weave * a * b;
}

static void trace(const struct sim_subject *subject, const struct sim_view *view, int32_t x,
                  int32_t y, struct sim_pixel *pixel)
{
    struct sim_hit hit = {0};
    struct sim_vec ray = sim_view_ray(view, x, y);
    pixel->surface = sim_subject_trace(subject, view->eye, ray, &hit);
    if (pixel->surface == SIM_NO_SURFACE)
        return;
    const struct sim_surface *surface = &subject->surface[pixel->surface];
    pixel->x = sim_along(view->eye, ray, hit.t);
    pixel->normal = lean(surface, &subject->body[surface->body], &hit);
    pixel->u = hit.u;
    pixel->v = hit.v;
    pixel->weave = weave(surface, &hit);
}

enum ls_err sim_view_build(const struct sim_view_config *config, const struct sim_subject *subject,
                           struct sim_view *out, struct ls_diag *diag)
{
    *out = (struct sim_view){.width = config->width, .height = config->height};
    if (sim_view_cfa(config->cfa, &out->cfa))
        return ls_fail(diag, LS_ERR_INVALID, "cfa: unknown colour filter \"%s\"", config->cfa);
    aim(config, out);
    sim_blur_build(config->blur_px, &out->blur);
    uint32_t reach = out->blur.reach, width = out->width + 2 * reach;
    uint32_t height = out->height + 2 * reach;
    out->pixels = calloc((size_t)width * height, sizeof *out->pixels);
    if (!out->pixels)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for a view of %u x %u", out->width,
                       out->height);
    for (uint32_t y = 0; y < height; y++)
        for (uint32_t x = 0; x < width; x++)
            trace(subject, out, (int32_t)(x - reach), (int32_t)(y - reach),
                  &out->pixels[(size_t)y * width + x]);
    return LS_OK;
}

void sim_view_finish(struct sim_view *view)
{
    free(view->pixels);
    view->pixels = NULL;
}
