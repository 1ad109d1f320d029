/*
 * light_set: weighted sums over lights, as weighted sums over the pictures that were taken.
 * Layer: daemon. Threads: any. Ownership: sets belong to their source.
 *
 * Light by light, a picture's weight is that of its light. Multiplexed (core/multiplex.h), every
 * picture has a part in every light: a single light is a sum of all of them, none can be skipped
 * for its weight, and all must be there. Nothing is decoded that was not asked for.
 *
 * Where lights of a channel differ in colour, k has a factor for each colour of the camera
 * (core/gains.h), and a sum is right in the one colour whose factors it was made with: whoever
 * needs all three makes three, demosaics each and takes from each its own (before demosaicing
 * colours do not come apart: the filter reads all of them). R(i,c) = k(i) f(i,c) E(i,c), so a
 * photographed sum has strengths g(i,c) = 1 / (k(i) f(i,c)), with the factors of its own channel.
 */
#ifndef LS_DAEMON_LIGHT_SET_H
#define LS_DAEMON_LIGHT_SET_H

#include "core/error.h"
#include "daemon/field_source.h"

#include <stdbool.h>
#include <stdint.h>

/** row[n_pictures], for ls_accumulate: what sums the pictures to sum_i w[i] k(i) E_i, of all groups
 * together. @w: [n_lights], NULL = 1. @colour: 0..2, of the camera: k with its factors; -1: k
 * alone; the same where the lights do not differ. Errors: LS_ERR_NOMEM; LS_ERR_INVALID (w not
 * finite, or the pattern is not calibrated). */
LS_MUST_CHECK enum ls_err ls_light_set_row(const struct ls_light_set *set, const double *w,
                                           uint32_t n_lights, int32_t colour, float *row,
                                           struct ls_diag *diag);

/** Do its lights differ in colour? */
bool ls_light_set_is_coloured(const struct ls_light_set *set);

/** Is a single light a sum of several pictures? */
bool ls_light_set_is_summed(const struct ls_light_set *set);

bool ls_light_set_is_multiplexed(const struct ls_light_set *set);

/** Is there what light @light needs? Of multiplexed groups all pictures must be there. */
bool ls_light_set_has(const struct ls_field_source *source, const struct ls_light_set *set,
                      uint32_t light);

/** Can every weight of a multiplexed set be served? True of other sets. LS_ERR_STATE: pictures are
 * missing, or their pattern is not calibrated. */
LS_MUST_CHECK enum ls_err ls_light_set_ready(const struct ls_field_source *source,
                                             const struct ls_light_set *set, struct ls_diag *diag);

/** Coefficient c of the shot noise of a sum V = sum_j row[j] m_j: its variance is shot x c x V if
 * all lights are alike. @w as given to ls_light_set_row; it weighs some light. */
double ls_light_set_shot(const struct ls_light_set *set, const double *w, uint32_t n_lights,
                         const float *row);

#endif
