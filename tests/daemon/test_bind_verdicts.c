/* bind: single frames and events, each with the verdict and the reason it must have. */
#include "tests/daemon/bind_camera.h"

#include <glib.h>

/* One frame at step 1 after an anchor at step -1: the pieces of the cross-check one by one. */
static enum ls_bind_reason verdict_of(struct ls_camera_frame frame, double mapped_us,
                                      uint32_t event_flags, bool extra_before)
{
    struct ls_bind_config config = bind_camera(true, true, true);
    struct ls_bind *bind = NULL;
    g_assert_cmpint(ls_bind_create(&config, 4, 4, &bind), ==, LS_OK);
    struct ls_camera_frame anchor = {.frame_id = 10, .trigger_counter = 100};
    ls_bind_anchor(bind, &anchor);
    ls_bind_arm(bind, 4);
    for (uint32_t i = 0; i < 4; i++) {
        struct ls_step_event event = {
            .step = i, .us = 1000000 + i * PERIOD_US, .flags = i == 1 ? event_flags : 0};
        g_assert_cmpint(ls_bind_event(bind, &event, 2013.7), ==, LS_OK);
    }
    ls_bind_until(bind, 2000000);
    struct ls_camera_frame between = {.frame_id = 11, .trigger_counter = 101, .slot = 1};
    struct ls_bind_verdict verdict;
    if (extra_before) {
        g_assert_cmpint(ls_bind_frame(bind, &between, 1000000 + PERIOD_US / 2, 0), ==, LS_OK);
        g_assert_true(ls_bind_next(bind, &verdict));
        g_assert_cmpint(verdict.reason, ==, LS_BIND_NO_PULSE);
    }
    g_assert_cmpint(ls_bind_frame(bind, &frame, mapped_us, 0), ==, LS_OK);
    g_assert_true(ls_bind_next(bind, &verdict));
    g_assert_true((verdict.outcome == LS_BIND_BOUND) == (verdict.reason == LS_BIND_FINE));
    ls_bind_destroy(bind);
    return verdict.reason;
}

static void test_cross_check(void)
{
    const double at = 1000000 + PERIOD_US;
    struct ls_camera_frame good = {
        .frame_id = 12, .trigger_counter = 102, .chunk_exposure_us = 2013.7};
    g_assert_cmpint(verdict_of(good, at, 0, false), ==, LS_BIND_FINE);

    struct ls_camera_frame dropped_before = good;
    dropped_before.frame_id = 11;
    dropped_before.trigger_counter = 101;
    g_assert_cmpint(verdict_of(dropped_before, at, 0, false), ==, LS_BIND_FINE);

    struct ls_camera_frame one_too_many = good;
    one_too_many.frame_id = 13;
    one_too_many.trigger_counter = 103;
    g_assert_cmpint(verdict_of(one_too_many, at, 0, false), ==, LS_BIND_IDS);

    struct ls_camera_frame counter_off = good;
    counter_off.trigger_counter = 103;
    g_assert_cmpint(verdict_of(counter_off, at, 0, false), ==, LS_BIND_IDS);

    struct ls_camera_frame other_exposure = good;
    other_exposure.chunk_exposure_us = 513.7;
    g_assert_cmpint(verdict_of(other_exposure, at, 0, false), ==, LS_BIND_EXPOSURE);

    g_assert_cmpint(verdict_of(good, at + 1000, 0, false), ==, LS_BIND_RESIDUAL);
    g_assert_cmpint(verdict_of(good, at, LS_EVENT_CLIPPED, false), ==, LS_BIND_CLIPPED);
    g_assert_cmpint(verdict_of(good, at, LS_EVENT_LATE, false), ==, LS_BIND_FINE);
    g_assert_cmpint(verdict_of(good, at, 0, true), ==, LS_BIND_SUSPECT);
    g_assert_cmpint(verdict_of(good, at + PERIOD_US / 2.0, 0, false), ==, LS_BIND_NO_PULSE);

    struct ls_camera_frame stale = good;
    stale.frame_id = 10;
    g_assert_cmpint(verdict_of(stale, at, 0, false), ==, LS_BIND_STALE);

    struct ls_camera_frame incomplete = good; /* whatever its trailer says: pixels are missing */
    incomplete.status = LS_FRAME_LOST;
    g_assert_cmpint(verdict_of(incomplete, at, 0, false), ==, LS_BIND_LOST);
}

/* Two pulses a millisecond apart, by a controller that hurries after it was late: the frame is
 * decided only when no second pulse can be near it any more, then belongs to neither, and the next
 * one is not trusted. */
static void test_two_pulses(void)
{
    struct ls_bind_config config = bind_camera(true, true, false);
    struct ls_bind *bind = NULL;
    struct ls_bind_verdict verdict;
    g_assert_cmpint(ls_bind_create(&config, 3, 4, &bind), ==, LS_OK);
    struct ls_camera_frame frame = {.frame_id = 10, .trigger_counter = 20};
    ls_bind_anchor(bind, &frame);
    ls_bind_arm(bind, 3);
    const uint64_t us[3] = {1000000, 1001000, 1001000 + PERIOD_US};
    for (uint32_t i = 0; i < 3; i++) {
        struct ls_step_event event = {.step = i, .us = us[i]};
        g_assert_cmpint(ls_bind_event(bind, &event, 0), ==, LS_OK);
        ls_bind_until(bind, us[i] + 100);
        if (i == 1)
            continue;
        frame.frame_id++;
        frame.trigger_counter++;
        g_assert_cmpint(ls_bind_frame(bind, &frame, (double)us[i], 0), ==, LS_OK);
        if (i == 0)
            g_assert_false(ls_bind_next(bind, &verdict));
    }
    ls_bind_until(bind, us[2] + PERIOD_US);
    g_assert_true(ls_bind_next(bind, &verdict));
    g_assert_cmpint(verdict.reason, ==, LS_BIND_TWO_PULSES);
    g_assert_true(ls_bind_next(bind, &verdict));
    g_assert_cmpint(verdict.reason, ==, LS_BIND_SUSPECT);
    for (uint32_t i = 0; i < 3; i++)
        g_assert_cmpint(ls_bind_outcome(bind, i), ==, LS_BIND_AMBIGUOUS);
    ls_bind_destroy(bind);
}

static void test_lost_events(void)
{
    struct ls_bind_config config = bind_camera(true, false, false);
    struct ls_bind *bind = NULL;
    g_assert_cmpint(ls_bind_create(&config, 8, 4, &bind), ==, LS_OK);
    ls_bind_arm(bind, 8);
    struct ls_step_event event = {.step = 2, .us = 1000000};
    g_assert_cmpint(ls_bind_event(bind, &event, 0), ==, LS_OK);
    struct ls_bind_verdict verdict;
    for (uint32_t i = 0; i < 2; i++) {
        g_assert_true(ls_bind_next(bind, &verdict));
        g_assert_cmpuint(verdict.step, ==, i);
        g_assert_cmpint(verdict.outcome, ==, LS_BIND_AMBIGUOUS);
    }
    g_assert_false(ls_bind_next(bind, &verdict));
    g_assert_cmpint(ls_bind_event(bind, &event, 0), ==, LS_ERR_MISMATCH);
    event.step = 8;
    g_assert_cmpint(ls_bind_event(bind, &event, 0), ==, LS_ERR_MISMATCH);
    ls_bind_destroy(bind);
}

/* A frame of the program before arrives in the next: it is nobody's, and no harm is done. */
static void test_rearm(void)
{
    struct ls_bind_config config = bind_camera(true, true, false);
    struct ls_bind *bind = NULL;
    struct ls_bind_verdict verdict;
    g_assert_cmpint(ls_bind_create(&config, 4, 4, &bind), ==, LS_OK);
    struct ls_camera_frame frame = {.frame_id = 10, .trigger_counter = 20};
    ls_bind_anchor(bind, &frame);
    uint64_t us = 1000000;
    for (int pass = 0; pass < 3; pass++, us += 1000000) {
        ls_bind_arm(bind, 2);
        for (uint32_t i = 0; i < 2; i++) {
            struct ls_step_event event = {.step = i, .us = us + i * PERIOD_US};
            g_assert_cmpint(ls_bind_event(bind, &event, 0), ==, LS_OK);
        }
        ls_bind_until(bind, us + PERIOD_US);
        frame.frame_id++; /* the second frame of every pass is lost */
        frame.trigger_counter++;
        g_assert_cmpint(ls_bind_frame(bind, &frame, (double)us, 0), ==, LS_OK);
        g_assert_true(ls_bind_next(bind, &verdict));
        g_assert_cmpuint(verdict.step, ==, 0);
        g_assert_cmpint(verdict.outcome, ==, LS_BIND_BOUND);
        ls_bind_until(bind, us + 500000);
        g_assert_true(ls_bind_next(bind, &verdict));
        g_assert_cmpint(verdict.outcome, ==, LS_BIND_MISSING);
        frame.frame_id++;
        frame.trigger_counter++;
    }
    ls_bind_destroy(bind);
}

/* Frames that come later and later, each within a patience of the one before: the last comes ten
 * patiences after its pulse. After it none comes any more, and that is noticed a patience later. */
static void test_slow_frames(void)
{
    enum { STEPS = 12 };
    struct ls_bind_config config = bind_camera(true, true, false);
    struct ls_bind *bind = NULL;
    struct ls_bind_verdict verdict;
    uint64_t now_us = 1000000 + STEPS * PERIOD_US;
    g_assert_cmpint(ls_bind_create(&config, STEPS, STEPS, &bind), ==, LS_OK);
    struct ls_camera_frame frame = {.frame_id = 10, .trigger_counter = 20};
    ls_bind_anchor(bind, &frame);
    ls_bind_arm(bind, STEPS);
    for (uint32_t i = 0; i < STEPS; i++) {
        struct ls_step_event event = {.step = i, .us = 1000000 + i * PERIOD_US};
        g_assert_cmpint(ls_bind_event(bind, &event, 0), ==, LS_OK);
    }
    for (uint32_t i = 0; i < STEPS - 1; i++) {
        ls_bind_until(bind, now_us);
        frame.frame_id++;
        frame.trigger_counter++;
        g_assert_cmpint(ls_bind_frame(bind, &frame, 1000000.0 + i * PERIOD_US, 0), ==, LS_OK);
        g_assert_true(ls_bind_next(bind, &verdict));
        g_assert_cmpuint(verdict.step, ==, i);
        g_assert_cmpint(verdict.outcome, ==, LS_BIND_BOUND);
        g_assert_false(ls_bind_next(bind, &verdict));
        now_us += (uint64_t)config.patience_us - 1;
    }
    ls_bind_until(bind, now_us);
    g_assert_false(ls_bind_next(bind, &verdict));
    ls_bind_until(bind, now_us + 2);
    g_assert_true(ls_bind_next(bind, &verdict));
    g_assert_cmpint(verdict.outcome, ==, LS_BIND_MISSING);
    ls_bind_destroy(bind);
}

/* One step at a time: what a step's frames were, and what became of the step. */
struct turn {
    bool quiet; /* before it, nothing was triggered for a patience */
    int frames; /* new ones that arrive while the step is open */
    enum ls_bind_outcome outcome;
};

static void take_turns(const struct turn *turns, uint32_t n)
{
    struct ls_bind_config config = bind_camera(false, false, false);
    struct ls_bind *bind = NULL;
    struct ls_bind_verdict verdict;
    g_assert_cmpint(ls_bind_create(&config, 16, 8, &bind), ==, LS_OK);
    struct ls_camera_frame frame = {.frame_id = 1};
    ls_bind_anchor(bind, &frame);
    ls_bind_arm(bind, n);
    for (uint32_t i = 0; i < n; i++) {
        if (turns[i].quiet)
            ls_bind_quiet(bind);
        ls_bind_open(bind, i);
        for (int k = 0; k < turns[i].frames; k++) {
            frame.frame_id++;
            g_assert_cmpint(ls_bind_frame(bind, &frame, 0, 0), ==, LS_OK);
        }
        ls_bind_next(bind, &verdict);
        g_assert_cmpint(ls_bind_outcome(bind, i), !=, LS_BIND_BOUND); /* not before its event */
        struct ls_step_event event = {.step = i, .us = 1000000 * (i + 1)};
        g_assert_cmpint(ls_bind_event(bind, &event, 0), ==, LS_OK);
        while (ls_bind_next(bind, &verdict))
            ;
        if (ls_bind_outcome(bind, i) == LS_BIND_OPEN)
            ls_bind_expire(bind, i);
        while (ls_bind_next(bind, &verdict))
            ;
        g_assert_cmpint(ls_bind_outcome(bind, i), ==, turns[i].outcome);
    }
    ls_bind_destroy(bind);
}

static void test_by_order(void)
{
    const struct turn clean[] = {
        {false, 1, LS_BIND_BOUND}, {false, 1, LS_BIND_BOUND}, {false, 1, LS_BIND_BOUND}};
    take_turns(clean, 3);
    /* nothing came; then its frame and the next one's together; then in step again */
    const struct turn late[] = {{false, 1, LS_BIND_BOUND},
                                {false, 0, LS_BIND_MISSING},
                                {false, 2, LS_BIND_AMBIGUOUS},
                                {false, 1, LS_BIND_BOUND}};
    take_turns(late, 4);
    /* never came at all */
    const struct turn gone[] = {{false, 0, LS_BIND_MISSING},
                                {false, 0, LS_BIND_MISSING},
                                {true, 1, LS_BIND_BOUND},
                                {false, 1, LS_BIND_BOUND}};
    take_turns(gone, 4);
    /* each frame comes a step too late: never sure until they are all in, or it was quiet */
    const struct turn behind[] = {{false, 0, LS_BIND_MISSING},   {false, 1, LS_BIND_AMBIGUOUS},
                                  {false, 1, LS_BIND_AMBIGUOUS}, {false, 2, LS_BIND_AMBIGUOUS},
                                  {false, 1, LS_BIND_BOUND},     {false, 0, LS_BIND_MISSING},
                                  {false, 1, LS_BIND_AMBIGUOUS}, {true, 1, LS_BIND_BOUND}};
    take_turns(behind, 8);
}

/* The event of a step that was opened is lost: its frame is not the next one's, though ids say so.
 */
static void test_by_order_lost_event(void)
{
    struct ls_bind_config config = bind_camera(false, false, false);
    struct ls_bind *bind = NULL;
    struct ls_bind_verdict verdict;
    g_assert_cmpint(ls_bind_create(&config, 2, 4, &bind), ==, LS_OK);
    struct ls_camera_frame frame = {.frame_id = 1};
    ls_bind_anchor(bind, &frame);
    ls_bind_arm(bind, 2);
    ls_bind_open(bind, 0);
    ls_bind_open(bind, 1);
    const struct ls_step_event event = {.step = 1, .us = 1000000};
    g_assert_cmpint(ls_bind_event(bind, &event, 0), ==, LS_OK);
    frame.frame_id = 2;
    g_assert_cmpint(ls_bind_frame(bind, &frame, 0, 0), ==, LS_OK);
    g_assert_true(ls_bind_next(bind, &verdict));
    g_assert_cmpint(verdict.reason, ==, LS_BIND_IDS);
    g_assert_cmpint(ls_bind_outcome(bind, 1), ==, LS_BIND_AMBIGUOUS);
    g_assert_true(ls_bind_suspect(bind)); /* one frame is still owed */
    ls_bind_destroy(bind);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/bind/frames-that-keep-coming-are-waited-for", test_slow_frames);
    g_test_add_func("/bind/every-disagreement-has-its-reason", test_cross_check);
    g_test_add_func("/bind/a-frame-near-two-pulses-is-neithers", test_two_pulses);
    g_test_add_func("/bind/steps-whose-events-were-lost-are-ambiguous", test_lost_events);
    g_test_add_func("/bind/the-anchor-outlives-a-program", test_rearm);
    g_test_add_func("/bind/a-camera-without-time-is-bound-by-order", test_by_order);
    g_test_add_func("/bind/by-order-a-lost-event-leaves-its-frame-nobodys",
                    test_by_order_lost_event);
    return g_test_run();
}
