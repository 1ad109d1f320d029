#include "sim/body.h"

#include <stddef.h>

struct sim_body sim_quad(struct sim_vec corner, struct sim_vec u, struct sim_vec v)
{
    struct sim_body body = {.shape = SIM_QUAD, .origin = corner, .u = u, .v = v};
    body.normal = sim_unit(sim_cross(u, v));
    body.u2 = sim_dot(u, u);
    body.v2 = sim_dot(v, v);
    body.centre = sim_along(sim_along(corner, u, 0.5f), v, 0.5f);
    body.bound = 0.5f * sqrtf(body.u2 + body.v2);
    return body;
}

struct sim_body sim_sphere(struct sim_vec centre, double radius)
{
    return (struct sim_body){.shape = SIM_SPHERE,
                             .origin = centre,
                             .radius = (float)radius,
                             .centre = centre,
                             .bound = (float)radius};
}

struct sim_body sim_tube(struct sim_vec bottom, double radius, double height)
{
    struct sim_body body = {
        .shape = SIM_TUBE, .origin = bottom, .radius = (float)radius, .height = (float)height};
    body.centre = sim_add(bottom, sim_vec(0, height / 2, 0));
    body.bound = (float)sqrt(radius * radius + height * height / 4);
    return body;
}

static float longitude(struct sim_vec n)
{
    return 0.5f + atan2f(n.x, n.z) * (float)(0.5 / M_PI);
}

static bool hit_quad(const struct sim_body *b, struct sim_vec o, struct sim_vec d, float t_min,
                     float t_max, struct sim_hit *hit)
{
    float nd = sim_dot(b->normal, d);
    if (fabsf(nd) < 1e-9f)
        return false;
    float t = sim_dot(b->normal, sim_sub(b->origin, o)) / nd;
    if (!(t > t_min && t < t_max))
        return false;
    struct sim_vec p = sim_sub(sim_along(o, d, t), b->origin);
    float u = sim_dot(p, b->u), v = sim_dot(p, b->v);
    if (u < 0 || u > b->u2 || v < 0 || v > b->v2)
        return false;
    if (hit)
        *hit = (struct sim_hit){.t = t,
                                .u = u / b->u2,
                                .v = v / b->v2,
                                .part = nd > 0,
                                .normal = sim_mul(b->normal, nd > 0 ? -1 : 1)};
    return true;
}

static bool hit_sphere(const struct sim_body *b, struct sim_vec o, struct sim_vec d, float t_min,
                       float t_max, struct sim_hit *hit)
{
    struct sim_vec p = sim_sub(o, b->origin);
    float half_b = sim_dot(p, d), c = sim_dot(p, p) - b->radius * b->radius;
    float q = half_b * half_b - c;
    if (q < 0)
        return false;
    float root = sqrtf(q), t = -half_b - root;
    if (!(t > t_min))
        t = -half_b + root;
    if (!(t > t_min && t < t_max))
        return false;
    if (hit) {
        struct sim_vec n = sim_unit(sim_along(p, d, t));
        float polar = acosf(fmaxf(-1, fminf(1, n.y)));
        *hit = (struct sim_hit){
            .t = t, .u = longitude(n), .v = polar * (float)(1 / M_PI), .normal = n};
    }
    return true;
}

static bool tube_at(const struct sim_body *b, struct sim_vec p, struct sim_vec d, float t,
                    struct sim_hit *hit)
{
    float y = p.y + t * d.y;
    if (y < 0 || y > b->height)
        return false;
    if (hit) {
        struct sim_vec n = sim_mul(sim_vec(p.x + t * d.x, 0, p.z + t * d.z), 1 / b->radius);
        int inside = sim_dot(n, d) > 0;
        *hit = (struct sim_hit){.t = t,
                                .u = longitude(n),
                                .v = y / b->height,
                                .part = inside,
                                .normal = inside ? sim_mul(n, -1) : n};
    }
    return true;
}

static bool hit_tube(const struct sim_body *b, struct sim_vec o, struct sim_vec d, float t_min,
                     float t_max, struct sim_hit *hit)
{
    struct sim_vec p = sim_sub(o, b->origin);
    float a = d.x * d.x + d.z * d.z;
    if (a < 1e-12f)
        return false;
    float half_b = p.x * d.x + p.z * d.z, c = p.x * p.x + p.z * p.z - b->radius * b->radius;
    float q = half_b * half_b - a * c;
    if (q < 0)
        return false;
    float root = sqrtf(q), t = (-half_b - root) / a;
    if (t > t_min && t < t_max && tube_at(b, p, d, t, hit))
        return true;
    t = (-half_b + root) / a;
    return t > t_min && t < t_max && tube_at(b, p, d, t, hit);
}

bool sim_body_hit(const struct sim_body *body, struct sim_vec o, struct sim_vec d, float t_min,
                  float t_max, struct sim_hit *hit)
{
    switch (body->shape) {
    case SIM_QUAD:
        return hit_quad(body, o, d, t_min, t_max, hit);
    case SIM_SPHERE:
        return hit_sphere(body, o, d, t_min, t_max, hit);
    default:
        return hit_tube(body, o, d, t_min, t_max, hit);
    }
}

bool sim_body_blocks(const struct sim_body *body, struct sim_vec o, struct sim_vec d, float t_min,
                     float t_max)
{
    return sim_body_hit(body, o, d, t_min, t_max, NULL);
}

void sim_body_point(const struct sim_body *b, int part, double u, double v, struct sim_vec *x,
                    struct sim_vec *normal)
{
    if (b->shape == SIM_QUAD) {
        *x = sim_along(sim_along(b->origin, b->u, (float)u), b->v, (float)v);
        *normal = sim_mul(b->normal, part ? -1 : 1);
        return;
    }
    double phi = 2 * M_PI * (u - 0.5);
    if (b->shape == SIM_SPHERE) {
        double theta = M_PI * v;
        *normal = sim_vec(sin(theta) * sin(phi), cos(theta), sin(theta) * cos(phi));
        *x = sim_along(b->origin, *normal, b->radius);
        return;
    }
    struct sim_vec n = sim_vec(sin(phi), 0, cos(phi));
    *x = sim_add(sim_along(b->origin, n, b->radius), sim_vec(0, v * b->height, 0));
    *normal = sim_mul(n, part ? -1 : 1);
}

double sim_body_area(const struct sim_body *b, double v, double du, double dv)
{
    if (b->shape == SIM_QUAD)
        return sqrt((double)b->u2 * b->v2) * du * dv;
    if (b->shape == SIM_TUBE)
        return 2 * M_PI * b->radius * b->height * du * dv;
    return 2 * M_PI * b->radius * b->radius * du * (cos(M_PI * v) - cos(M_PI * (v + dv)));
}
