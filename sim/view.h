/*
 * view: what each pixel of a camera looks at, traced once.
 * Layer: sim. Threads: built on one, then read only. Ownership: finish frees.
 */
#ifndef LS_SIM_VIEW_H
#define LS_SIM_VIEW_H

#include "core/error.h"
#include "core/pixel.h"
#include "sim/blur.h"
#include "sim/scene.h"
#include "sim/subject.h"

/** The point one pixel sees. */
struct sim_pixel {
    struct sim_vec x, normal; /* shading normal, towards the camera */
    float u, v;               /* within the surface */
    float weave;              /* factor on the diffuse part */
    uint16_t surface;         /* SIM_NO_SURFACE: nothing */
};

struct sim_view {
    uint32_t width, height;
    enum ls_cfa cfa;
    struct sim_vec eye, right, up, forward;
    double pitch; /* of the pixels over the focal length */
    struct sim_blur blur;
    struct sim_pixel *pixels; /* of the sensor and blur.reach around it: sim_view_pixel */
};

/** @config has passed sim_scene_config_check. */
LS_MUST_CHECK enum ls_err sim_view_build(const struct sim_view_config *config,
                                         const struct sim_subject *subject, struct sim_view *out,
                                         struct ls_diag *diag);
void sim_view_finish(struct sim_view *view);

/** A pixel; -blur.reach <= @x < width + blur.reach, the same for @y. */
static inline const struct sim_pixel *sim_view_pixel(const struct sim_view *view, int32_t x,
                                                     int32_t y)
{
    int32_t reach = (int32_t)view->blur.reach;
    size_t row = (size_t)(y + reach) * (view->width + 2 * view->blur.reach);
    return view->pixels + row + (size_t)(x + reach);
}

/** Unit direction of the ray through the middle of a pixel. */
struct sim_vec sim_view_ray(const struct sim_view *view, double x, double y);

/** Where a point lands, in pixels (middle of the first pixel: 0.5). Points behind: NaN. */
void sim_view_project(const struct sim_view *view, struct sim_vec point, double *x, double *y);

/** A colour filter's order from its configuration name; LS_CFA_NONE for "mono". -1: unknown. */
int sim_view_cfa(const char *name, enum ls_cfa *out);

#endif
