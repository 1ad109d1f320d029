/*
 * sphere_view: the pixels of one camera that see a sphere, and what they see of it.
 * Layer: core. Threads: read only once created. Ownership: create / destroy.
 *
 * Pixels whose middle lies within LS_SPHERE_BORDER_PX of the outline are left out (they mix the
 * sphere with what is behind it), and so are defective ones. A sphere of more than
 * LS_SPHERE_MAX_PIXELS is sampled: whole 2 x 2 cells in equal steps, so that a mosaic keeps all its
 * colours. Blocks divide the pixels into about two hundred squares; errors of a fit are estimated
 * from what differs between them.
 */
#ifndef LS_CORE_SPHERE_VIEW_H
#define LS_CORE_SPHERE_VIEW_H

#include "core/error.h"
#include "core/pinhole.h"
#include "core/pixel.h"
#include "core/sphere_outline.h"

#include <stddef.h>
#include <stdint.h>

enum {
    LS_SPHERE_MAX_PIXELS = 1 << 15,
    LS_SPHERE_BLOCKS = 16, /* a side */
};
#define LS_SPHERE_BORDER_PX 1.5

struct ls_sphere_pixel {
    uint32_t index;      /* y width + x */
    uint8_t colour;      /* camera channel of the mosaic; 0 for mono */
    uint8_t block;       /* < LS_SPHERE_BLOCKS^2 */
    float x[3], n[3];    /* point and unit normal, stage frame, m */
    float v[3];          /* unit, towards the camera */
    float nv;            /* n . v */
    float shifted[3][6]; /* x, n for the centre moved by shift_m along each axis */
};

struct ls_sphere_view {
    struct ls_pinhole camera;
    struct ls_sphere sphere;
    enum ls_cfa cfa;
    uint32_t n_colours; /* 3, or 1 for mono */
    double shift_m;     /* by which `shifted` was moved */
    uint32_t step;      /* every step-th cell of 2 x 2 in both directions was taken */
    uint32_t n;
    struct ls_sphere_pixel *pixels;
};

/**
 * Point and unit normal that a point of the picture shows, of a sphere of @part of its radius: part
 * below 1 keeps clear of the rim. Point and normal are those of the whole sphere. Returns 0 where
 * the ray misses. RT-safe.
 */
int ls_sphere_hit(const struct ls_pinhole *camera, const struct ls_sphere *sphere, double x_px,
                  double y_px, double part, double x[3], double n[3]);

/**
 * @defects: ascending y width + x, or NULL. Errors: LS_ERR_INVALID (the camera does not see it, or
 * fewer than 200 pixels of it), LS_ERR_NOMEM. @out: (transfer full).
 */
LS_MUST_CHECK enum ls_err ls_sphere_view_create(const struct ls_pinhole *camera, enum ls_cfa cfa,
                                                const struct ls_sphere *sphere,
                                                const uint32_t *defects, uint32_t n_defects,
                                                struct ls_sphere_view **out, struct ls_diag *diag);

/** NULL is allowed. */
void ls_sphere_view_destroy(struct ls_sphere_view *view);

#endif
