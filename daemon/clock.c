#include "daemon/clock.h"

#include <assert.h>
#include <math.h>
#include <string.h>

struct sums {
    double w, wx, wy, wxx, wxy;
};

static uint32_t held(const struct ls_clock *clock)
{
    return clock->n < LS_CLOCK_PAIRS ? clock->n : LS_CLOCK_PAIRS;
}

/* Difference of two counters that may be either way round. */
static double delta(uint64_t a, uint64_t b)
{
    return a >= b ? (double)(a - b) : -(double)(b - a);
}

static double smallest_delay(const struct ls_clock *clock)
{
    double least = INFINITY;
    for (uint32_t i = 0; i < held(clock); i++)
        least = fmin(least, (double)(clock->pairs[i].after - clock->pairs[i].before));
    return least;
}

static double weight(const struct ls_clock *clock, const struct ls_clock_pair *pair, double least)
{
    double excess = (double)(pair->after - pair->before) - least;
    double sigma = excess / 2 + least / 10 + clock->floor;
    return 1 / (sigma * sigma);
}

/* x: nominal time since ticks0; y: how far the reference is from that. */
static void point(const struct ls_clock *clock, const struct ls_clock_pair *pair, double *x,
                  double *y)
{
    uint64_t middle = pair->before + (pair->after - pair->before) / 2;
    *x = delta(pair->ticks, clock->ticks0) * clock->nominal;
    *y = delta(middle, clock->ref0) - *x;
}

static void fit(struct ls_clock *clock)
{
    double least = smallest_delay(clock);
    struct sums s = {0};
    for (uint32_t i = 0; i < held(clock); i++) {
        double x, y, w = weight(clock, &clock->pairs[i], least);
        point(clock, &clock->pairs[i], &x, &y);
        s.w += w;
        s.wx += w * x;
        s.wy += w * y;
    }
    double mean_x = s.wx / s.w, mean_y = s.wy / s.w;
    for (uint32_t i = 0; i < held(clock); i++) {
        double x, y, w = weight(clock, &clock->pairs[i], least);
        point(clock, &clock->pairs[i], &x, &y);
        s.wxx += w * (x - mean_x) * (x - mean_x);
        s.wxy += w * (x - mean_x) * (y - mean_y);
    }
    double prior = 1 / (LS_CLOCK_DRIFT_PPM * 1e-6 * LS_CLOCK_DRIFT_PPM * 1e-6);
    clock->drift = s.wxy / (s.wxx + prior);
    clock->offset = mean_y - clock->drift * mean_x;
    double squares = 0;
    clock->residual_max = 0;
    for (uint32_t i = 0; i < held(clock); i++) {
        double x, y, w = weight(clock, &clock->pairs[i], least);
        point(clock, &clock->pairs[i], &x, &y);
        double r = y - clock->offset - clock->drift * x;
        squares += w * r * r;
        clock->residual_max = fmax(clock->residual_max, fabs(r));
    }
    clock->residual_rms = sqrt(squares / s.w);
}

void ls_clock_init(struct ls_clock *clock, double hz, double floor_ns)
{
    assert(hz > 0 && floor_ns > 0);
    memset(clock, 0, sizeof *clock);
    clock->nominal = 1e9 / hz;
    clock->floor = floor_ns;
}

enum ls_err ls_clock_add(struct ls_clock *clock, uint64_t ticks, uint64_t before_ns,
                         uint64_t after_ns)
{
    if (after_ns < before_ns)
        return LS_ERR_INVALID;
    /* The newest pair is the origin, so that rounding stays small however long the take. */
    clock->pairs[clock->n++ % LS_CLOCK_PAIRS] =
        (struct ls_clock_pair){.ticks = ticks, .before = before_ns, .after = after_ns};
    if (clock->n == 2 * LS_CLOCK_PAIRS)
        clock->n = LS_CLOCK_PAIRS;
    clock->ticks0 = ticks;
    clock->ref0 = before_ns;
    fit(clock);
    return LS_OK;
}

double ls_clock_map(const struct ls_clock *clock, uint64_t ticks)
{
    assert(clock->n > 0);
    double x = delta(ticks, clock->ticks0) * clock->nominal;
    double ref = (double)clock->ref0 + (clock->offset + x + clock->drift * x);
    return ref > 0 ? ref : 0;
}

double ls_clock_inverse(const struct ls_clock *clock, double ref_ns)
{
    assert(clock->n > 0);
    double x = (ref_ns - (double)clock->ref0 - clock->offset) / (1 + clock->drift);
    return (double)clock->ticks0 + x / clock->nominal;
}

double ls_clock_drift_ppm(const struct ls_clock *clock)
{
    return clock->drift * 1e6;
}
