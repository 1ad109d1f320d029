/*
 * capture: what keeps people and LEDs safe in a running take: heat, and what is left lit after it.
 */
#include "daemon/capture_private.h"
#include "daemon/realtime.h"
#include "tests/daemon/capture_fixture.h"

#include <glib.h>
#include <string.h>

enum { WORK_LEVEL = 2000 };

static bool has_alarm(struct stage *s, const char *text)
{
    struct ls_takedir *take;
    bool found = false;
    g_assert_cmpint(ls_takedir_open(s->folder, &take, NULL), ==, LS_OK);
    for (size_t i = 0; i < take->n_alarms; i++)
        found |= strstr(take->alarms[i], text) != NULL;
    ls_takedir_close(take);
    return found;
}

static void pause_for_heat(struct stage *s)
{
    s->options.hot_at = FIRST_LIGHT + 10;
    s->options.hot_ms = 200;
    uint64_t began_ns = ls_host_ns();
    g_assert_cmpint(shoot(s), ==, LS_OK);
    g_assert_cmpint((int64_t)(ls_host_ns() - began_ns), >,
                    1200000000); /* and a second's patience */
    expect_complete(s);
    g_assert_true(has_alarm(s, "s until the dome had cooled: it was at 71 C"));
    clear(s);
}

static void test_hot(void)
{
    pause_for_heat(new_stage());
}

static void test_hot_stepwise(void)
{
    struct stage *s = new_stage();
    s->options.software = s->options.timed = true;
    pause_for_heat(s);
}

static void test_hot_too_long(void)
{
    struct stage *s = new_stage();
    s->options.hot_at = FIRST_LIGHT + 10;
    s->options.hot_ms = 3600000;
    set_up(s);
    s->capture->sequencer.cooling_us = 300000;
    g_assert_cmpint(ls_capture_run(s->capture, &s->report, &s->diag), ==, LS_ERR_LIMIT);
    g_test_message("%s", s->diag.text);
    g_assert_nonnull(strstr(s->diag.text, "too hot, 71 C at step"));
    g_assert_nonnull(strstr(s->diag.text, "LEDs are dark; let it cool, then resume the take"));
    g_assert_true(fake_rig_is_dark(s->rig));
    /* granted before it was hot: no more than the ring has slots, 16 and those of the retention */
    g_assert_cmpuint(fake_rig_pulses(s->rig), <, s->options.hot_at + 24);
    s->options.hot_at = 0;
    resume(s);
    clear(s);
}

static struct stage *with_work_light(void)
{
    struct stage *s = new_stage();
    s->work_level = WORK_LEVEL;
    return s;
}

static void test_work_after_a_take(void)
{
    struct stage *s = with_work_light();
    g_assert_cmpint(shoot(s), ==, LS_OK);
    expect_complete(s);
    g_assert_cmpuint(fake_rig_work_light(s->rig), ==, WORK_LEVEL);
    clear(s);
    s = new_stage();
    g_assert_cmpint(shoot(s), ==, LS_OK);
    g_assert_cmpuint(fake_rig_work_light(s->rig), ==, 0);
    clear(s);
}

static void test_no_work_light_with_a_fault(void)
{
    struct stage *s = with_work_light();
    s->options.interlock_at = 20;
    g_assert_cmpint(shoot(s), ==, LS_ERR_REFUSED);
    g_assert_cmpuint(fake_rig_work_light(s->rig), ==, 0);
    g_assert_null(strstr(s->diag.text, "work light"));
    g_assert_true(has_alarm(s, "no work light: interlock open"));
    clear(s);
}

static void test_a_noisy_link_is_told(void)
{
    struct stage *s = new_stage();
    s->options.noisy_link = true;
    g_assert_cmpint(shoot(s), ==, LS_OK);
    g_assert_true(has_alarm(s, "its frames come by UDP"));
    clear(s);
    s = new_stage();
    g_assert_cmpint(shoot(s), ==, LS_OK);
    g_assert_false(has_alarm(s, "UDP"));
    clear(s);
}

static gpointer run_thread(gpointer data)
{
    struct stage *s = data;
    return GINT_TO_POINTER(ls_capture_run(s->capture, &s->report, &s->diag));
}

static void interrupt(void (*by)(struct ls_capture *capture), const char *sentence, unsigned level)
{
    struct stage *s = with_work_light();
    struct ls_capture_progress progress;
    set_up(s);
    GThread *thread = g_thread_new("run", run_thread, s);
    do {
        g_thread_yield();
        ls_capture_progress(s->capture, &progress);
    } while (progress.steps_bound < FIRST_LIGHT + 6);
    by(s->capture);
    g_assert_cmpint(GPOINTER_TO_INT(g_thread_join(thread)), ==, LS_ERR_ABORTED);
    g_assert_true(fake_rig_is_dark(s->rig));
    g_assert_nonnull(strstr(s->diag.text, sentence));
    g_assert_cmpuint(fake_rig_work_light(s->rig), ==, level);
    clear(s);
}

static void test_abort_and_blank(void)
{
    interrupt(ls_capture_abort, "aborted: the work light is on", WORK_LEVEL);
    interrupt(ls_capture_blank, "aborted: LEDs are dark", 0);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/capture/a-hot-dome-pauses-the-take", test_hot);
    g_test_add_func("/capture/a-hot-dome-pauses-a-take-of-one-step-at-a-time", test_hot_stepwise);
    g_test_add_func("/capture/a-dome-that-does-not-cool-ends-the-take-dark", test_hot_too_long);
    g_test_add_func("/capture/a-take-ends-in-the-work-light", test_work_after_a_take);
    g_test_add_func("/capture/a-link-too-noisy-for-a-packet-socket-is-told",
                    test_a_noisy_link_is_told);
    g_test_add_func("/capture/with-a-fault-latched-it-ends-dark", test_no_work_light_with_a_fault);
    g_test_add_func("/capture/an-abort-leaves-the-work-light-and-blank-does-not",
                    test_abort_and_blank);
    return g_test_run();
}
