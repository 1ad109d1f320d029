/*
 * clock: one device clock as a line (offset, drift) against another, fitted from timestamp pairs.
 * Layer: daemon. Threads: one at a time per ls_clock. Ownership: embedded, no heap.
 *
 * A pair says "the device showed `ticks` while the reference stood between `before` and `after`".
 * The reference is host CLOCK_MONOTONIC_RAW in ns for latches and status reads, or the controller's
 * clock in ns for bound (camera, controller) pairs, where before == after. The newest
 * LS_CLOCK_PAIRS pairs are fitted by weighted least squares: the error of a midpoint is at most
 * half its delay, and what exceeds the smallest delay seen is queueing, so
 *     sigma_i = (delay_i - delay_min) / 2 + delay_min / 10 + floor
 * and the drift has a prior of zero mean and LS_CLOCK_DRIFT_PPM, so that a baseline too short to
 * show the drift does not invent one.
 *
 * Accuracy: pairs of 100 us delay with exponential queueing of 200 us mean, 10 per second: after
 * 5 s the offset is within 20 us and, 100 ppm apart, the drift within 10 ppm.
 */
#ifndef LS_DAEMON_CLOCK_H
#define LS_DAEMON_CLOCK_H

#include "core/error.h"

#include <stdint.h>

enum {
    LS_CLOCK_PAIRS = 64,
    LS_CLOCK_DRIFT_PPM = 200, /* standard deviation of the prior; two crystals of 100 ppm */
};

struct ls_clock_pair {
    uint64_t ticks;
    uint64_t before, after; /* ns of the reference */
};

struct ls_clock {
    double nominal;                             /* ns of the reference per tick, without drift */
    double floor;                               /* ns: what a pair without delay is worth */
    uint32_t n;                                 /* pairs ever added */
    struct ls_clock_pair pairs[LS_CLOCK_PAIRS]; /* ring */
    /* the line: reference = ref0 + offset + (ticks - ticks0) * nominal * (1 + drift) */
    uint64_t ticks0, ref0;
    double offset, drift;
    double residual_rms; /* ns, of the pairs fitted, weighted */
    double residual_max; /* ns, of the pairs fitted; a midpoint is off by up to half its delay */
};

/** No pairs yet. @hz: nominal ticks per second; @floor_ns: error of a perfect pair, > 0. RT-safe.
 */
void ls_clock_init(struct ls_clock *clock, double hz, double floor_ns);

/** Add a pair and refit. LS_ERR_INVALID if after < before. RT-safe. */
enum ls_err ls_clock_add(struct ls_clock *clock, uint64_t ticks, uint64_t before_ns,
                         uint64_t after_ns);

/** Reference time at @ticks, ns; needs at least one pair. Before the reference's zero: 0. RT-safe.
 */
double ls_clock_map(const struct ls_clock *clock, uint64_t ticks);

/** Ticks at reference time @ref_ns, the inverse of ls_clock_map. RT-safe. */
double ls_clock_inverse(const struct ls_clock *clock, double ref_ns);

/** Drift against nominal in ppm; positive: reference time passes faster than the ticks say.
 * RT-safe. */
double ls_clock_drift_ppm(const struct ls_clock *clock);

#endif
