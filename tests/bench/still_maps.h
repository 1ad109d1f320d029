/*
 * still_maps: what turns sums over a still_take's white field into other spectra.
 * Layer: tests. Threads: one. Ownership: the arrays are the caller's.
 */
#ifndef LS_TESTS_BENCH_STILL_MAPS_H
#define LS_TESTS_BENCH_STILL_MAPS_H

#include "tests/bench/still_take.h"

/** Eq. 1's ratio of spectrum @s >= 1, demosaiced as @method says: out[pixels][3]. */
void still_ratio(const struct still_take *take, uint32_t s, enum ls_demosaic_method method,
                 float *out);

/** The matrix of core/linear.h from the take's segments: out[pixels][3][3]. */
void still_matrix(const struct still_take *take, uint32_t s, float *out);

/** The ratio of core/separate.h for every spectrum, the white one too: out[SPECTRA][pixels][3]. */
void still_separated_ratios(const struct still_take *take, float *out);

/** p(s,c) over that of the polarised white. */
void still_tint(const struct still_take *take, uint32_t s, double tint[3]);

#endif
