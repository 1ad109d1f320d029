#include "core/smooth_order.h"

#include "core/vec3.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>

/* Squared chord: no transcendental function, so the same on every machine. */
static double apart(const double a[3], const double b[3])
{
    double d = 2 - 2 * ls_dot3(a, b);
    return d > 0 ? d : 0;
}

static double chord(double (*d)[3], uint32_t a, uint32_t b)
{
    return sqrt(apart(d[a], d[b]));
}

static bool unit(const float in[3], double out[3])
{
    double length = 0;
    for (int k = 0; k < 3; k++) {
        out[k] = (double)in[k];
        length += out[k] * out[k];
    }
    for (int k = 0; k < 3; k++)
        out[k] /= sqrt(length);
    return length > 0 && isfinite(length);
}

static void follow_nearest(double (*d)[3], uint32_t n, uint32_t *order)
{
    for (uint32_t i = 0; i < n; i++)
        order[i] = i;
    for (uint32_t k = 1; k < n; k++) {
        uint32_t best = k;
        for (uint32_t j = k; j < n; j++) {
            double now = apart(d[order[k - 1]], d[order[j]]);
            double so_far = apart(d[order[k - 1]], d[order[best]]);
            if (now < so_far || (now == so_far && order[j] < order[best]))
                best = j;
        }
        uint32_t light = order[best];
        order[best] = order[k];
        order[k] = light;
    }
}

static void reverse(uint32_t *order, uint32_t first, uint32_t last)
{
    for (; first < last; first++, last--) {
        uint32_t light = order[first];
        order[first] = order[last];
        order[last] = light;
    }
}

/* What the path gains when [i, j] runs the other way round. */
static double gain(double (*d)[3], uint32_t n, const uint32_t *order, uint32_t i, uint32_t j)
{
    double before = i > 0 ? chord(d, order[i - 1], order[i]) : 0;
    double after = i > 0 ? chord(d, order[i - 1], order[j]) : 0;
    if (j + 1 < n) {
        before += chord(d, order[j], order[j + 1]);
        after += chord(d, order[i], order[j + 1]);
    }
    return before - after;
}

static bool shorten(double (*d)[3], uint32_t n, uint32_t *order)
{
    bool better = false;
    for (uint32_t i = 0; i + 1 < n; i++)
        for (uint32_t j = i + 1; j < n; j++)
            if (gain(d, n, order, i, j) > 1e-9) {
                reverse(order, i, j);
                better = true;
            }
    return better;
}

enum ls_err ls_smooth_order(const float (*directions)[3], uint32_t n, uint32_t *order,
                            struct ls_diag *diag)
{
    if (n > LS_SMOOTH_ORDER_MAX_LIGHTS)
        return ls_fail(diag, LS_ERR_LIMIT, "%u lights to put in order: expected at most %d", n,
                       LS_SMOOTH_ORDER_MAX_LIGHTS);
    LS_CLEANUP_FREE double(*d)[3] = calloc(n + 1, sizeof *d);
    if (!d)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory for an order of lights");
    for (uint32_t i = 0; i < n; i++)
        if (!unit(directions[i], d[i]))
            return ls_fail(diag, LS_ERR_INVALID, "light %u has no direction", i);
    follow_nearest(d, n, order);
    for (int round = 0; round < LS_SMOOTH_ORDER_ROUNDS && shorten(d, n, order); round++)
        ;
    return LS_OK;
}

double ls_smooth_order_step(const float (*directions)[3], uint32_t n, const uint32_t *order)
{
    double sum = 0;
    for (uint32_t k = 1; k < n; k++) {
        double a[3], b[3];
        if (unit(directions[order[k - 1]], a) && unit(directions[order[k]], b))
            sum += acos(fmax(-1, fmin(1, ls_dot3(a, b))));
    }
    return n > 1 ? sum / (n - 1) : 0;
}
