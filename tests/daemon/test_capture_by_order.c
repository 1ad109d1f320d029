/*
 * capture: cameras without a line or a clock, whose frames are told apart by their order.
 */
#include "tests/daemon/capture_fixture.h"

#include <glib.h>
#include <string.h>

static void test_software(void)
{
    struct stage *s = new_stage();
    s->options.software = s->options.timed = s->options.no_time = true;
    g_assert_cmpint(shoot(s), ==, LS_OK);
    expect_complete(s);
    clear(s);
}

static void test_software_lost(void)
{
    struct stage *s = new_stage();
    s->options.software = s->options.timed = s->options.no_time = true;
    s->options.faults[timed_pulse(2, 1, 0)] = FAKE_VANISHED;
    s->options.faults[timed_pulse(N_LIGHTS - 1, 2, 2)] = FAKE_LOST;
    g_assert_cmpint(shoot(s), ==, LS_OK);
    expect_complete(s);
    /* the step after a missing one is out of order and shot again, too */
    g_assert_cmpuint(s->report.final.shots_lost, >=, 3);
    clear(s);
}

/* A light that is off when the camera exposes gives a dark picture of a lit step. */
static void test_software_dark(void)
{
    struct stage *s = new_stage();
    s->options.software = s->options.timed = s->options.no_time = true;
    s->options.faults[timed_pulse(2, 0, 0)] = FAKE_UNLIT;
    s->options.faults[timed_pulse(6, 1, 1)] = FAKE_CUT;
    s->options.faults[timed_pulse(N_LIGHTS - 1, 2, 2)] = FAKE_UNLIT;
    g_assert_cmpint(shoot(s), ==, LS_OK);
    expect_complete(s);
    /* each of the three, and nothing else */
    g_assert_cmpuint(s->report.final.shots_lost, ==, 3);
    g_assert_nonnull(strstr(s->report.repaired, "W-0002 (1 shot)"));
    g_assert_nonnull(strstr(s->report.repaired, "W-0006 (1 shot)"));
    clear(s);
}

/* Two frames in a row, later than the patience of 328 ms: each comes while the next step is on. */
static void test_software_slow(void)
{
    struct stage *s = new_stage();
    s->options.software = s->options.timed = s->options.no_time = true;
    s->options.faults[timed_pulse(5, 1, 0)] = FAKE_SLOWER;
    s->options.faults[timed_pulse(6, 1, 0)] = FAKE_SLOWER;
    g_assert_cmpint(shoot(s), ==, LS_OK);
    expect_complete(s);
    g_assert_cmpuint(s->report.final.shots_lost, ==, 2);
    clear(s);
}

/* The step's event comes with the end of the hold, long after the other camera's frame. */
static void test_mixed(void)
{
    struct stage *s = new_stage();
    s->options.n_cameras = 2;
    s->options.software = s->options.timed = s->options.no_time = s->options.mixed = true;
    s->options.faults[timed_pulse(2, 1, 0)] = FAKE_SLOW;
    g_assert_cmpint(shoot(s), ==, LS_OK);
    expect_complete(s);
    g_assert_cmpuint(s->report.final.shots_lost, ==, 0);
    clear(s);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/capture/software-triggered-cameras-hold-the-light", test_software);
    g_test_add_func("/capture/a-software-triggered-camera-that-misses-is-repaired",
                    test_software_lost);
    g_test_add_func("/capture/a-held-light-that-goes-off-too-early-is-repaired",
                    test_software_dark);
    g_test_add_func("/capture/frames-later-than-patience-are-nobodys", test_software_slow);
    g_test_add_func("/capture/a-long-hold-costs-the-other-camera-nothing", test_mixed);
    return g_test_run();
}
