/*
 * vec3: three doubles with the handful of operations geometry needs.
 * Layer: core. Threads: any; pure, RT-safe. Ownership: values.
 */
#ifndef LS_CORE_VEC3_H
#define LS_CORE_VEC3_H

#include <math.h>

static inline double ls_dot3(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static inline double ls_length3(const double a[3])
{
    return sqrt(ls_dot3(a, a));
}

static inline double ls_distance3(const double a[3], const double b[3])
{
    const double d[3] = {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
    return ls_length3(d);
}

static inline void ls_cross3(const double a[3], const double b[3], double out[3])
{
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

/** out = a + s b; they may be the same. */
static inline void ls_along3(const double a[3], const double b[3], double s, double out[3])
{
    for (int k = 0; k < 3; k++)
        out[k] = a[k] + s * b[k];
}

/** Scale to length 1; returns the length it had. */
static inline double ls_unit3(double a[3])
{
    double length = ls_length3(a);
    for (int k = 0; k < 3; k++)
        a[k] /= length;
    return length;
}

/** Solve the symmetric positive definite m x = b, m = {xx, xy, xz, yy, yz, zz}; 0, or -1 if it is
 * not positive definite to 1e-12 of its diagonal. */
static inline int ls_solve3(const double m[6], const double b[3], double x[3])
{
    double a = m[0], c = m[1], d = m[2], e = m[3], f = m[4], g = m[5];
    double i = e * g - f * f, j = d * f - c * g, k = c * f - d * e;
    double det = a * i + c * j + d * k;
    if (!(a > 0 && e > 0 && g > 0 && det > 1e-12 * a * e * g))
        return -1;
    x[0] = (i * b[0] + j * b[1] + k * b[2]) / det;
    x[1] = (j * b[0] + (a * g - d * d) * b[1] + (c * d - a * f) * b[2]) / det;
    x[2] = (k * b[0] + (c * d - a * f) * b[1] + (a * e - c * c) * b[2]) / det;
    return 0;
}

#endif
