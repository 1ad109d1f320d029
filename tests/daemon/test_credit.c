/* credit: room counted right, and a live subject spared the flashing band. */
#include "daemon/credit.h"

#include <glib.h>

static void test_least_room(void)
{
    const struct ls_credit_camera cameras[] = {
        {.queued = 20, .settled = 7}, {.queued = 10, .settled = 8}, {.queued = 30, .settled = 2}};
    g_assert_cmpuint(ls_credit_limit(cameras, 1, 100), ==, 23);
    g_assert_cmpuint(ls_credit_limit(cameras, 2, 100), ==, 14);
    g_assert_cmpuint(ls_credit_limit(cameras, 3, 10), ==, 10);
}

static void test_ring_full(void)
{
    for (uint32_t queued = 0; queued <= LS_CREDIT_SPARE; queued++) {
        const struct ls_credit_camera camera = {.queued = queued, .settled = 7};
        g_assert_cmpuint(ls_credit_limit(&camera, 1, 100), ==, 7);
    }
}

static void test_still(void)
{
    struct ls_credit credit;
    ls_credit_init(&credit, 100, 32, false, 13889);
    g_assert_cmpuint(ls_credit_grant(&credit, 0, 0, 3, 0), ==, 3);
    g_assert_cmpuint(ls_credit_grant(&credit, 3, 3, 4, 1000), ==, 4);
    g_assert_cmpuint(ls_credit_grant(&credit, 4, 4, 2, 2000), ==, 4);
}

/*
 * A merge stage that frees one slot every 80 ms (12.5 Hz, in the middle of the band): pulses must
 * come at the planned period or after a pause, and bursts below 3 Hz.
 */
static void test_starved(void)
{
    enum { PERIOD_US = 13889, N = 200, SLOTS = 32, ROOM = SLOTS - LS_CREDIT_SPARE };
    struct ls_credit credit;
    uint32_t granted = 0, fired = 0, bursts = 0;
    uint64_t last_us = 0, burst_us = 0;
    ls_credit_init(&credit, N, SLOTS, true, PERIOD_US);
    for (uint64_t us = 1000000; fired < N && us < 60000000; us += 500) {
        uint32_t freed = (uint32_t)((us - 1000000) / 80000);
        uint32_t settled = freed < fired ? freed : fired;
        uint32_t limit = settled + ROOM < N ? settled + ROOM : N;
        granted = ls_credit_grant(&credit, granted, fired, limit, us * 1000);
        g_assert_cmpuint(granted, <=, limit);
        if (fired == granted || us - last_us < PERIOD_US)
            continue;
        bool follows = last_us && us - last_us < PERIOD_US + 1000;
        if (!follows) {
            g_assert_true(bursts == 0 || us - burst_us >= 333334);
            burst_us = us;
            bursts++;
        }
        last_us = us;
        fired++;
    }
    g_assert_cmpuint(fired, ==, N);
    g_assert_cmpuint(bursts, >, 1);
    g_assert_cmpuint(bursts, <, 20);
}

static void test_slow_plan(void)
{
    struct ls_credit credit;
    ls_credit_init(&credit, 100, 32, true, 100000); /* 10 Hz, allowed by the operator */
    g_assert_cmpuint(ls_credit_grant(&credit, 0, 0, 1, 0), ==, 1);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/credit/the-camera-with-the-least-room-counts", test_least_room);
    g_test_add_func("/credit/ring-full-stops-credit", test_ring_full);
    g_test_add_func("/credit/a-still-subject-gets-every-slot-at-once", test_still);
    g_test_add_func("/credit/a-starved-live-take-pauses-instead-of-flashing", test_starved);
    g_test_add_func("/credit/an-allowed-slow-plan-is-not-held-back", test_slow_plan);
    return g_test_run();
}
