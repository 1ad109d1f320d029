#include "core/sphere_view.h"

#include "core/vec3.h"

#include <stdlib.h>

enum { MIN_PIXELS = 200 };

/* First point of the ray on the sphere; 0 if it misses. */
static int hit(const double eye[3], const double d[3], const double centre[3], double radius,
               double x[3], double n[3])
{
    double o[3];
    ls_along3(eye, centre, -1, o);
    double b = ls_dot3(o, d), h = b * b - ls_dot3(o, o) + radius * radius;
    if (!(h > 0) || -b - sqrt(h) <= 0)
        return 0;
    ls_along3(eye, d, -b - sqrt(h), x);
    ls_along3(x, centre, -1, n);
    ls_unit3(n);
    return 1;
}

int ls_sphere_hit(const struct ls_pinhole *camera, const struct ls_sphere *sphere, double x_px,
                  double y_px, double part, double x[3], double n[3])
{
    double d[3];
    ls_pinhole_ray(camera, x_px, y_px, d);
    return hit(camera->eye_m, d, sphere->centre_m, part * sphere->radius_m, x, n) &&
           hit(camera->eye_m, d, sphere->centre_m, sphere->radius_m, x, n);
}

struct frame {
    double x, y, radius; /* of the outline, px */
    double shrink;       /* of the radius that keeps clear of the border */
    uint32_t x0, y0, x1, y1;
};

static enum ls_err frame_of(const struct ls_pinhole *camera, const struct ls_sphere *sphere,
                            struct frame *f, struct ls_diag *diag)
{
    struct ls_outline outline;
    enum ls_err err = ls_sphere_outline(camera, sphere, &outline, diag);
    if (err)
        return err;
    *f = (struct frame){.x = outline.x_px, .y = outline.y_px, .radius = outline.radius_px};
    f->shrink = 1 - LS_SPHERE_BORDER_PX / f->radius;
    double reach = f->radius * 1.1 + 2;
    f->x0 = (uint32_t)fmin(camera->width, fmax(0, floor(f->x - reach)));
    f->y0 = (uint32_t)fmin(camera->height, fmax(0, floor(f->y - reach)));
    f->x1 = (uint32_t)fmax(0, fmin(camera->width, ceil(f->x + reach)));
    f->y1 = (uint32_t)fmax(0, fmin(camera->height, ceil(f->y + reach)));
    return LS_OK;
}

static int block_of(double at, double middle, double radius)
{
    int b = (int)floor((at - middle + radius) / (2 * radius) * LS_SPHERE_BLOCKS);
    return b < 0 ? 0 : b >= LS_SPHERE_BLOCKS ? LS_SPHERE_BLOCKS - 1 : b;
}

static int see(const struct ls_sphere_view *v, const struct frame *f, uint32_t px, uint32_t py,
               struct ls_sphere_pixel *out)
{
    const double *eye = v->camera.eye_m, *centre = v->sphere.centre_m;
    double d[3], x[3], n[3], moved[3], r = v->sphere.radius_m;
    ls_pinhole_ray(&v->camera, px + 0.5, py + 0.5, d);
    if (!(f->shrink > 0) ||
        !ls_sphere_hit(&v->camera, &v->sphere, px + 0.5, py + 0.5, f->shrink, x, n))
        return 0;
    *out = (struct ls_sphere_pixel){.index = py * v->camera.width + px,
                                    .colour = (uint8_t)ls_cfa_channel(v->cfa, px, py)};
    out->block = (uint8_t)(block_of(py + 0.5, f->y, f->radius) * LS_SPHERE_BLOCKS +
                           block_of(px + 0.5, f->x, f->radius));
    for (int k = 0; k < 3; k++) {
        out->x[k] = (float)x[k];
        out->n[k] = (float)n[k];
        out->v[k] = (float)-d[k];
    }
    out->nv = (float)-ls_dot3(n, d);
    for (int axis = 0; axis < 3; axis++) {
        for (int k = 0; k < 3; k++)
            moved[k] = centre[k] + (k == axis ? v->shift_m : 0);
        if (!hit(eye, d, moved, r, x, n))
            return 0;
        for (int k = 0; k < 3; k++) {
            out->shifted[axis][k] = (float)x[k];
            out->shifted[axis][3 + k] = (float)n[k];
        }
    }
    return 1;
}

static int by_index(const void *a, const void *b)
{
    uint32_t x = *(const uint32_t *)a, y = *(const uint32_t *)b;
    return (x > y) - (x < y);
}

/* Every step-th cell of 2 x 2 in both directions. */
static void collect(struct ls_sphere_view *v, const struct frame *f, uint32_t step,
                    const uint32_t *defects, uint32_t n_defects)
{
    v->n = 0;
    for (uint32_t y = f->y0; y < f->y1; y++)
        for (uint32_t x = f->x0; x < f->x1; x++) {
            uint32_t index = y * v->camera.width + x;
            if ((x / 2) % step || (y / 2) % step ||
                (n_defects && bsearch(&index, defects, n_defects, sizeof index, by_index)))
                continue;
            v->n += see(v, f, x, y, &v->pixels[v->n]) ? 1 : 0;
        }
}

enum ls_err ls_sphere_view_create(const struct ls_pinhole *camera, enum ls_cfa cfa,
                                  const struct ls_sphere *sphere, const uint32_t *defects,
                                  uint32_t n_defects, struct ls_sphere_view **out,
                                  struct ls_diag *diag)
{
    struct frame f;
    enum ls_err err = frame_of(camera, sphere, &f, diag);
    if (err)
        return err;
    struct ls_sphere_view *v = calloc(1, sizeof *v);
    if (!v)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for a sphere");
    *v = (struct ls_sphere_view){.camera = *camera, .sphere = *sphere, .cfa = cfa};
    v->n_colours = cfa == LS_CFA_NONE ? 1 : 3;
    v->shift_m = 1e-3 * sphere->radius_m;
    double area = (double)(f.x1 - f.x0) * (f.y1 - f.y0);
    uint32_t step = (uint32_t)ceil(sqrt(fmax(1, area / LS_SPHERE_MAX_PIXELS)));
    v->step = step;
    size_t cells = ((f.x1 - f.x0) / 2 / step + 2) * (size_t)((f.y1 - f.y0) / 2 / step + 2);
    v->pixels = calloc(4 * cells, sizeof *v->pixels);
    if (!v->pixels) {
        ls_sphere_view_destroy(v);
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for the pixels of a sphere");
    }
    collect(v, &f, step, defects, n_defects);
    if (v->n < MIN_PIXELS) {
        uint32_t n = v->n;
        ls_sphere_view_destroy(v);
        return ls_fail(diag, LS_ERR_INVALID,
                       "sphere: its picture has %u usable pixels, expected at least %d: it stands "
                       "outside the camera's view or is too small in it",
                       n, MIN_PIXELS);
    }
    *out = v;
    return LS_OK;
}

void ls_sphere_view_destroy(struct ls_sphere_view *v)
{
    if (!v)
        return;
    free(v->pixels);
    free(v);
}
