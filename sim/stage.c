#include "sim/stage.h"

#include <math.h>
#include <time.h>

uint64_t sim_now_ns(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC_RAW, &now);
    return (uint64_t)now.tv_sec * 1000000000u + (uint64_t)now.tv_nsec;
}

void sim_wait_until(pthread_cond_t *wake, pthread_mutex_t *lock, uint64_t true_ns)
{
    uint64_t now = sim_now_ns();
    if (true_ns <= now)
        return;
    struct timespec until;
    clock_gettime(CLOCK_MONOTONIC, &until);
    uint64_t ns = (uint64_t)until.tv_nsec + (true_ns - now);
    until.tv_sec += (time_t)(ns / 1000000000u);
    until.tv_nsec = (long)(ns % 1000000000u);
    pthread_cond_timedwait(wake, lock, &until);
}

static double ticks_per_ns(const struct sim_clock *clock)
{
    return (1.0 + clock->drift_ppm * 1e-6) * clock->hz / 1e9;
}

uint64_t sim_clock_at(const struct sim_clock *clock, uint64_t true_ns)
{
    double ns = (double)(int64_t)(true_ns - clock->start_ns);
    return clock->epoch_ticks + (uint64_t)(int64_t)floor(ns * ticks_per_ns(clock));
}

uint64_t sim_clock_true(const struct sim_clock *clock, uint64_t ticks)
{
    double since = (double)(int64_t)(ticks - clock->epoch_ticks);
    return clock->start_ns + (uint64_t)(int64_t)ceil(since / ticks_per_ns(clock));
}
