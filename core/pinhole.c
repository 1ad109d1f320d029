#include "core/pinhole.h"

#include "core/vec3.h"

#include <string.h>

static void upright(struct ls_pinhole *c)
{
    const double y[3] = {0, 1, 0}, back[3] = {0, 0, -1}, x[3] = {1, 0, 0};
    ls_along3(y, c->forward, -ls_dot3(y, c->forward), c->up);
    if (ls_length3(c->up) < 1e-4) {
        const double *other = fabs(c->forward[2]) < 0.9 ? back : x;
        ls_along3(other, c->forward, -ls_dot3(other, c->forward), c->up);
    }
    ls_unit3(c->up);
    ls_cross3(c->forward, c->up, c->right);
}

enum ls_err ls_pinhole_aim(const double position_m[3], const double look_at_m[3],
                           double focal_length_mm, double sensor_width_mm, uint32_t width,
                           uint32_t height, struct ls_pinhole *out, struct ls_diag *diag)
{
    *out = (struct ls_pinhole){.width = width, .height = height};
    if (!(focal_length_mm > 0 && focal_length_mm < 1e6 && sensor_width_mm > 0 &&
          sensor_width_mm < 1e6) ||
        !width || !height)
        return ls_fail(diag, LS_ERR_INVALID,
                       "camera: a lens of %g mm on a sensor %g mm wide of %u x %u pixels is none",
                       focal_length_mm, sensor_width_mm, width, height);
    memcpy(out->eye_m, position_m, sizeof out->eye_m);
    ls_along3(look_at_m, position_m, -1, out->forward);
    if (!(ls_unit3(out->forward) > 1e-9) || !isfinite(out->forward[0] + out->eye_m[0]))
        return ls_fail(diag, LS_ERR_INVALID,
                       "camera at (%g, %g, %g): it looks at (%g, %g, %g), which is no direction",
                       position_m[0], position_m[1], position_m[2], look_at_m[0], look_at_m[1],
                       look_at_m[2]);
    upright(out);
    out->pitch = sensor_width_mm / width / focal_length_mm;
    return LS_OK;
}

void ls_pinhole_ray(const struct ls_pinhole *c, double x, double y, double d[3])
{
    ls_along3(c->forward, c->right, (x - c->width / 2.0) * c->pitch, d);
    ls_along3(d, c->up, (c->height / 2.0 - y) * c->pitch, d);
    ls_unit3(d);
}

void ls_pinhole_project(const struct ls_pinhole *c, const double point[3], double *x, double *y)
{
    double d[3];
    ls_along3(point, c->eye_m, -1, d);
    double depth = ls_dot3(d, c->forward);
    *x = depth > 0 ? ls_dot3(d, c->right) / depth / c->pitch + c->width / 2.0 : NAN;
    *y = depth > 0 ? c->height / 2.0 - ls_dot3(d, c->up) / depth / c->pitch : NAN;
}
