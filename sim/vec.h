/*
 * vec: three floats with the handful of operations ray tracing needs.
 * Layer: sim. Threads: any; pure. Ownership: values.
 */
#ifndef LS_SIM_VEC_H
#define LS_SIM_VEC_H

#include <math.h>

struct sim_vec {
    float x, y, z;
};

static inline struct sim_vec sim_vec(double x, double y, double z)
{
    return (struct sim_vec){(float)x, (float)y, (float)z};
}

static inline struct sim_vec sim_vec_of(const float v[3])
{
    return (struct sim_vec){v[0], v[1], v[2]};
}

static inline struct sim_vec sim_add(struct sim_vec a, struct sim_vec b)
{
    return (struct sim_vec){a.x + b.x, a.y + b.y, a.z + b.z};
}

static inline struct sim_vec sim_sub(struct sim_vec a, struct sim_vec b)
{
    return (struct sim_vec){a.x - b.x, a.y - b.y, a.z - b.z};
}

static inline struct sim_vec sim_mul(struct sim_vec a, float s)
{
    return (struct sim_vec){a.x * s, a.y * s, a.z * s};
}

/** a + b s */
static inline struct sim_vec sim_along(struct sim_vec a, struct sim_vec b, float s)
{
    return (struct sim_vec){a.x + b.x * s, a.y + b.y * s, a.z + b.z * s};
}

static inline float sim_dot(struct sim_vec a, struct sim_vec b)
{
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

static inline struct sim_vec sim_cross(struct sim_vec a, struct sim_vec b)
{
    return (struct sim_vec){a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

/* fminf and fmaxf are calls where the compiler must heed NaN; these are one instruction. */
static inline float sim_min(float a, float b)
{
    return a < b ? a : b;
}

static inline float sim_max(float a, float b)
{
    return a > b ? a : b;
}

static inline float sim_length(struct sim_vec a)
{
    return sqrtf(sim_dot(a, a));
}

static inline struct sim_vec sim_unit(struct sim_vec a)
{
    return sim_mul(a, 1.0f / sim_length(a));
}

/** The unit vector across @axis that is nearest to @up; any across it where they coincide. */
static inline struct sim_vec sim_upright(struct sim_vec axis, struct sim_vec up)
{
    struct sim_vec v = sim_along(up, axis, -sim_dot(up, axis));
    float length = sim_length(v);
    if (length > 1e-4f)
        return sim_mul(v, 1.0f / length);
    struct sim_vec other = fabsf(axis.z) < 0.9f ? sim_vec(0, 0, -1) : sim_vec(1, 0, 0);
    return sim_unit(sim_along(other, axis, -sim_dot(other, axis)));
}

#endif
