/* clock: lines fitted to noisy pairs, against clocks whose truth is known. */
#include "daemon/clock.h"

#include <glib.h>
#include <math.h>

/* A device clock of @hz that runs @ppm fast, read over a link with queueing. */
struct device {
    double hz, ppm;
    uint64_t epoch;
    GRand *rand;
};

static uint64_t ticks_at(const struct device *device, double host_ns)
{
    return device->epoch +
           (uint64_t)llround(host_ns * 1e-9 * device->hz * (1 + device->ppm * 1e-6));
}

static double queueing(GRand *rand, double mean_ns)
{
    return -mean_ns * log(1 - g_rand_double(rand));
}

/* Request and answer wait independently; the device reads its clock between them. */
static void read_clock(struct device *device, struct ls_clock *clock, double host_ns)
{
    double there = 50e3 + queueing(device->rand, 200e3),
           back = 50e3 + queueing(device->rand, 200e3);
    g_assert_cmpint(ls_clock_add(clock, ticks_at(device, host_ns + there), (uint64_t)host_ns,
                                 (uint64_t)(host_ns + there + back)),
                    ==, LS_OK);
}

static double error_at(const struct device *device, const struct ls_clock *clock, double host_ns)
{
    return ls_clock_map(clock, ticks_at(device, host_ns)) - host_ns;
}

static struct device make_device(double hz, double ppm)
{
    guint32 seed = g_test_rand_int();
    g_test_message("seed %u", seed);
    return (struct device){
        .hz = hz, .ppm = ppm, .epoch = 987654321098765ull, .rand = g_rand_new_with_seed(seed)};
}

static void test_drift(void)
{
    for (int sign = -1; sign <= 1; sign += 2) {
        struct device device = make_device(1e9, 100 * sign);
        struct ls_clock clock;
        ls_clock_init(&clock, device.hz, 1000);
        for (int i = 0; i < 60; i++)
            read_clock(&device, &clock, 1e9 + i * 1e8);
        /* The bounds stated in clock.h; 60 pairs over 6 s. */
        g_assert_cmpfloat(fabs(error_at(&device, &clock, 7e9)), <, 60e3);
        g_assert_cmpfloat(fabs(ls_clock_drift_ppm(&clock) + device.ppm), <, 20);
        g_rand_free(device.rand);
    }
}

static void test_short_baseline(void)
{
    /* Six reads in 100 ms with 0.2 ms of queueing could "show" thousands of ppm. */
    struct device device = make_device(1e6, 100);
    struct ls_clock clock;
    for (int tries = 0; tries < 20; tries++) {
        ls_clock_init(&clock, device.hz, 1000);
        for (int i = 0; i < 6; i++)
            read_clock(&device, &clock, 1e9 + i * 20e6);
        /* three standard deviations of two crystals of 100 ppm */
        g_assert_cmpfloat(fabs(ls_clock_drift_ppm(&clock)), <, 600);
    }
    /* a second later: queueing's part plus at most 400 ppm of wrong drift */
    g_assert_cmpfloat(fabs(error_at(&device, &clock, 2.1e9)), <, 1e6);
    g_rand_free(device.rand);
}

static void test_slow_reads(void)
{
    struct device device = make_device(1e9, -40);
    struct ls_clock clock;
    ls_clock_init(&clock, device.hz, 1000);
    for (int i = 0; i < 40; i++) {
        read_clock(&device, &clock, 1e9 + i * 1e8);
        double host = 1e9 + i * 1e8 + 5e7; /* a read that waited 20 ms on one side only */
        g_assert_cmpint(ls_clock_add(&clock, ticks_at(&device, host), (uint64_t)host,
                                     (uint64_t)host + 20000000),
                        ==, LS_OK);
    }
    /* Equal weights would be wrong by half of 20 ms on half of the pairs: 5 ms. */
    g_assert_cmpfloat(fabs(error_at(&device, &clock, 5e9)), <, 150e3);
    g_rand_free(device.rand);
}

static void test_bound_pairs(void)
{
    /* Camera (ns) against controller (us): no delay, 2 us of jitter, 150 ppm between them. */
    struct device camera = make_device(1e9, 150);
    struct ls_clock clock;
    ls_clock_init(&clock, 1e9, 2000);
    double worst = 0;
    for (int i = 0; i < 500; i++) {
        double us = floor(5e6 + i * 13889.0), jitter = g_rand_double_range(camera.rand, -2e3, 2e3);
        uint64_t ticks = ticks_at(&camera, us * 1e3 + jitter);
        if (i > 20)
            worst = fmax(worst, fabs(ls_clock_map(&clock, ticks) - us * 1e3));
        g_assert_cmpint(ls_clock_add(&clock, ticks, (uint64_t)us * 1000, (uint64_t)us * 1000), ==,
                        LS_OK);
    }
    /* jitter of the sample itself plus that of a line through 20 and more of them */
    g_assert_cmpfloat(worst, <, 5e3);
    g_assert_cmpfloat(clock.residual_rms, <, 2e3);
    g_rand_free(camera.rand);
}

static void test_inverse(void)
{
    struct device device = make_device(1e6, 80);
    struct ls_clock clock;
    ls_clock_init(&clock, device.hz, 1000);
    for (int i = 0; i < 30; i++)
        read_clock(&device, &clock, 1e9 + i * 1e8);
    for (double ns = 0.5e9; ns < 10e9; ns += 1e9) {
        double ticks = ls_clock_inverse(&clock, ns);
        /* a tick is 1000 ns: rounding to it costs half of that, doubles of this size 256 ns */
        g_assert_cmpfloat(fabs(ls_clock_map(&clock, (uint64_t)llround(ticks)) - ns), <, 1000);
    }
    g_rand_free(device.rand);
}

static void test_backwards(void)
{
    struct ls_clock clock;
    ls_clock_init(&clock, 1e9, 1);
    g_assert_cmpint(ls_clock_add(&clock, 5, 11, 10), ==, LS_ERR_INVALID);
    g_assert_cmpuint(clock.n, ==, 0);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/clock/a-drift-of-100-ppm-is-found", test_drift);
    g_test_add_func("/clock/a-short-baseline-invents-no-drift", test_short_baseline);
    g_test_add_func("/clock/slow-reads-hardly-count", test_slow_reads);
    g_test_add_func("/clock/bound-pairs-map-to-microseconds", test_bound_pairs);
    g_test_add_func("/clock/inverse-undoes-map", test_inverse);
    g_test_add_func("/clock/a-pair-that-runs-backwards-is-refused", test_backwards);
    return g_test_run();
}
