/*
 * What whole takes count: every frame bound or discarded, losses and repairs at the camera they
 * happened to, and times that add up.
 */
#include "tests/daemon/capture_fixture.h"

#include <glib.h>
#include <inttypes.h>

static struct stage *two_cameras(void)
{
    struct stage *s = new_stage();
    s->options.n_cameras = 2;
    return s;
}

static struct ls_histogram_summary latency(const struct stage *s, uint32_t camera,
                                           enum ls_latency which)
{
    return ls_histogram_summary(&s->metrics.cameras[camera].latencies[which]);
}

static uint64_t sum(const _Atomic uint64_t *counters)
{
    uint64_t total = 0;
    for (uint32_t i = 0; i < LS_BIND_REASONS; i++)
        total += counters[i];
    return total;
}

/* The steps that gave no usable frame, and no others, are lost shots. */
static void expect_lost(const struct stage *s, uint32_t camera, uint64_t n)
{
    const struct ls_camera_metrics *m = &s->metrics.cameras[camera];
    g_assert_cmpuint(m->shots_lost, ==, n);
    g_assert_cmpuint(sum(m->steps_unbound), ==, n);
    g_assert_cmpuint(m->frames_bound + n, ==, s->metrics.pulses);
}

static void expect_clean(const struct stage *s, uint32_t camera)
{
    expect_lost(s, camera, 0);
    g_assert_cmpuint(sum(s->metrics.cameras[camera].frames_discarded), ==, 0);
}

/* Each camera 0's share of a take in which camera 1 saw nothing wrong; camera 1 discards what
 * repairs give it twice, in the merge stage, after its frames were bound. */
static struct stage *shoot_with(enum fake_fault fault)
{
    struct stage *s = two_cameras();
    s->options.faults[FIRST_LIGHT + 3 * 5 + 1] = (unsigned char)fault;
    g_assert_cmpint(shoot(s), ==, LS_OK);
    expect_complete(s);
    expect_clean(s, 1);
    return s;
}

static void test_dropped(void)
{
    struct stage *s = shoot_with(FAKE_DROPPED);
    expect_lost(s, 0, 1);
    g_assert_cmpuint(s->metrics.cameras[0].shots_repaired, ==, 1);
    g_assert_cmpuint(s->metrics.cameras[0].steps_unbound[LS_BIND_NO_FRAME], ==, 1);
    g_assert_cmpuint(sum(s->metrics.cameras[0].frames_discarded), ==, 0);
    clear(s);
}

static void test_incomplete(void)
{
    struct stage *s = shoot_with(FAKE_LOST);
    expect_lost(s, 0, 1);
    g_assert_cmpuint(s->metrics.cameras[0].frames_discarded[LS_BIND_LOST], ==, 1);
    g_assert_cmpuint(sum(s->metrics.cameras[0].frames_discarded), ==, 1);
    clear(s);
}

static void test_late(void)
{
    struct stage *s = two_cameras();
    s->options.faults[N_STEPS - 1] =
        FAKE_SLOWER; /* 400 ms, beyond the last step's patience of 330 */
    g_assert_cmpint(shoot(s), ==, LS_OK);
    expect_complete(s);
    expect_clean(s, 1);
    g_assert_cmpuint(s->metrics.cameras[0].shots_lost, >=, 1);
    /* it may spoil the repair that it comes into, which is then lost again */
    expect_lost(s, 0, s->metrics.cameras[0].shots_lost);
    g_assert_cmpuint(s->metrics.cameras[0].shots_repaired, ==, 1);
    /* after the next program was armed, it is a frame of no step at all */
    const _Atomic uint64_t *discarded = s->metrics.cameras[0].frames_discarded;
    g_assert_cmpuint(discarded[LS_BIND_STALE] + discarded[LS_BIND_NO_PULSE], ==, 1);
    clear(s);
}

static void test_times(void)
{
    struct stage *s = two_cameras();
    s->options.frame_delay_us = 4000;
    g_assert_cmpint(shoot(s), ==, LS_OK);
    for (uint32_t i = 0; i < 2; i++) {
        struct ls_histogram_summary frame = latency(s, i, LS_LATENCY_FRAME);
        struct ls_histogram_summary merged = latency(s, i, LS_LATENCY_MERGED);
        struct ls_histogram_summary stored = latency(s, i, LS_LATENCY_STORED);
        struct ls_histogram_summary total = latency(s, i, LS_LATENCY_TOTAL);
        expect_clean(s, i);
        g_test_message("us: frame %" PRIu64 " %" PRIu64 ", merged %" PRIu64 ", stored %" PRIu64,
                       frame.p50 / 1000, frame.max / 1000, merged.p50 / 1000, stored.p50 / 1000);
        g_assert_cmpuint(frame.count, ==, N_STEPS);
        g_assert_cmpuint(merged.count, ==, N_ALL);
        g_assert_cmpuint(stored.count, ==, N_ALL);
        g_assert_cmpuint(total.count, ==, N_ALL);
        /* half of the frames, those of the two longer pulses, took 4 ms and their exposure; 50 us
         * are the clock's fit and half a bucket */
        g_assert_cmpuint(frame.p50, >=, (4000 + s->plan.pulse_us[1] - 50) * 1000ull);
        g_assert_cmpuint(total.max, >=, stored.max);
        /* each part is the time between the same two moments in the sums as in the whole, and the
         * last frames are some of all */
        g_assert_cmpuint(total.sum, >=, merged.sum + stored.sum);
        g_assert_cmpuint(total.sum, <=, merged.sum + stored.sum + frame.sum);
    }
    clear(s);
}

static void test_camera_apart(void)
{
    struct stage *s = two_cameras();
    s->options.lose_light = 3;
    g_assert_cmpint(shoot(s), ==, LS_OK);
    g_assert_cmpuint(s->metrics.cameras[0].shots_lost, ==, (1 + s->config.retries) * N_EXPOSURES);
    g_assert_cmpuint(s->metrics.cameras[0].shots_repaired, ==, 0);
    g_assert_cmpuint(s->metrics.cameras[1].shots_lost, ==, 0);
    g_assert_cmpuint(latency(s, 0, LS_LATENCY_STORED).count, ==, N_ALL - 1);
    g_assert_cmpuint(latency(s, 1, LS_LATENCY_STORED).count, ==, N_ALL);
    clear(s);
}

static void test_adds_up(void)
{
    struct stage *s = two_cameras();
    struct ls_metrics *first = g_new(struct ls_metrics, 1);
    g_assert_cmpint(shoot(s), ==, LS_OK);
    *first = s->metrics;
    clear(s);
    s = two_cameras();
    s->metrics = *first;
    g_assert_cmpint(shoot(s), ==, LS_OK);
    g_assert_cmpuint(s->metrics.pulses, ==, 2 * first->pulses);
    g_assert_cmpuint(latency(s, 1, LS_LATENCY_TOTAL).count, ==, 2 * N_ALL);
    g_free(first);
    clear(s);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/capture-metrics/a-dropped-pulse-is-a-lost-shot-and-no-frame", test_dropped);
    g_test_add_func("/capture-metrics/an-incomplete-frame-is-discarded-and-repaired",
                    test_incomplete);
    g_test_add_func("/capture-metrics/a-frame-too-late-is-discarded-and-its-shot-repaired",
                    test_late);
    g_test_add_func("/capture-metrics/times-add-up-to-the-way-from-pulse-to-disk", test_times);
    g_test_add_func("/capture-metrics/a-camera-s-losses-are-its-own", test_camera_apart);
    g_test_add_func("/capture-metrics/takes-add-to-what-was-counted-before", test_adds_up);
    return g_test_run();
}
