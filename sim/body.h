/*
 * body: the analytic shapes of the simulated subject: rectangles, spheres and open tubes.
 * Layer: sim. Threads: any; pure. Ownership: values.
 *
 * Every shape has a parametrisation (u, v) in [0, 1]^2 per part:
 *   quad    part 0 in front (the side its normal points to), 1 behind; origin + u edge + v edge
 *   sphere  part 0; u longitude (0.5 towards +z), v from the top
 *   tube    part 0 outside, 1 inside; u longitude as above, v from the bottom; axis along y
 */
#ifndef LS_SIM_BODY_H
#define LS_SIM_BODY_H

#include "sim/vec.h"

#include <stdbool.h>
#include <stdint.h>

enum sim_shape { SIM_QUAD, SIM_SPHERE, SIM_TUBE };

struct sim_body {
    enum sim_shape shape;
    struct sim_vec origin; /* quad: corner; sphere: centre; tube: middle of the bottom */
    struct sim_vec u, v;   /* quad: edges, across each other */
    struct sim_vec normal; /* quad: unit, u x v */
    float radius, height;  /* sphere, tube */
    float u2, v2;          /* quad: squared edge lengths */
    struct sim_vec centre; /* of the bounding sphere */
    float bound;           /* its radius */
};

struct sim_hit {
    float t, u, v;
    int part;
    struct sim_vec normal; /* unit, on the side the ray came from */
};

/** @u and @v are made perpendicular to each other by the caller. */
struct sim_body sim_quad(struct sim_vec corner, struct sim_vec u, struct sim_vec v);
struct sim_body sim_sphere(struct sim_vec centre, double radius);
struct sim_body sim_tube(struct sim_vec bottom, double radius, double height);

/** Nearest hit with t in (t_min, t_max) of the ray @o + t @d, @d unit. */
bool sim_body_hit(const struct sim_body *body, struct sim_vec o, struct sim_vec d, float t_min,
                  float t_max, struct sim_hit *hit);

/** Is there any hit with t in (t_min, t_max)? */
bool sim_body_blocks(const struct sim_body *body, struct sim_vec o, struct sim_vec d, float t_min,
                     float t_max);

/** Point and unit normal at (u, v) of a part. */
void sim_body_point(const struct sim_body *body, int part, double u, double v, struct sim_vec *x,
                    struct sim_vec *normal);

/** Area of the patch [u, u + du] x [v, v + dv] of a part, m^2. */
double sim_body_area(const struct sim_body *body, double v, double du, double dv);

#endif
