/*
 * capture: watches, the few darks between the lights that look for drift.
 */
#include "tests/daemon/capture_fixture.h"

#include <glib.h>
#include <string.h>

/* Alarms that begin with @text. */
static uint32_t count_alarms(struct stage *s, const char *text)
{
    struct ls_takedir *take;
    uint32_t n = 0;
    g_assert_cmpint(ls_takedir_open(s->folder, &take, NULL), ==, LS_OK);
    for (size_t i = 0; i < take->n_alarms; i++) {
        g_test_message("%s", take->alarms[i]);
        n += g_str_has_prefix(take->alarms[i], text);
    }
    ls_takedir_close(take);
    return n;
}

static void test_watches(void)
{
    struct stage *s = new_stage();
    s->watches = true;
    s->options.n_cameras = 2;
    g_assert_cmpint(shoot(s), ==, LS_OK);
    expect_complete(s);
    g_assert_cmpuint(count_alarms(s, "dark drift"), ==, 0);
    clear(s);
}

enum { SECOND_HALF = FIRST_LIGHT + N_EXPOSURES * N_LIGHTS / 2 + WATCH_FRAMES };

static void test_drift(void)
{
    struct stage *s = new_stage();
    s->watches = true;
    s->options.n_cameras = 2;
    s->options.drift_at = SECOND_HALF;
    g_assert_cmpint(shoot(s), ==, LS_OK);
    g_assert_cmpuint(s->report.missing_conditions, ==, 0);
    g_assert_cmpuint(count_alarms(s, "dark drift: camera front: watch-1 is +1.0"), ==, 1);
    g_assert_cmpuint(count_alarms(s, "dark drift: camera left: watch-1 is +1.0"), ==, 1);
    g_assert_cmpuint(count_alarms(s, "dark drift"), ==, 2);
    clear(s);
}

/* Both have a shot missing: the first is given up for the second, which is given up when the first
 * is shot again. */
static void test_lost_watches(void)
{
    struct stage *s = new_stage();
    s->watches = true;
    s->options.faults[SECOND_HALF - 2] = FAKE_LOST;
    s->options.faults[SECOND_HALF + N_EXPOSURES * N_LIGHTS / 2 + 1] = FAKE_VANISHED;
    g_assert_cmpint(shoot(s), ==, LS_OK);
    expect_complete(s);
    g_assert_nonnull(strstr(s->report.repaired, "watch-0 (1 shot), watch-1 (1 shot)"));
    g_assert_cmpuint(fake_rig_pulses(s->rig), ==, s->plan.n_steps + 2 * WATCH_FRAMES);
    clear(s);
}

static void test_missing_watch(void)
{
    struct stage *s = new_stage();
    s->watches = true;
    s->options.faults[SECOND_HALF - 2] = FAKE_VANISHED;
    set_up(s);
    s->config.retries = 0;
    g_assert_cmpint(ls_capture_run(s->capture, &s->report, &s->diag), ==, LS_OK);
    g_assert_cmpuint(s->report.missing_conditions, ==, 1);
    g_assert_cmpuint(s->report.final.conditions_stored, ==, s->plan.n_conditions - 1);
    g_assert_cmpuint(count_alarms(s, "missing: cam0/watch-0"), ==, 1);
    clear(s);
}

static void test_resumed_watches(void)
{
    struct stage *s = new_stage();
    s->watches = true;
    s->options.interlock_at = SECOND_HALF + 4;
    g_assert_cmpint(shoot(s), ==, LS_ERR_REFUSED);
    s->options.interlock_at = 0;
    s->options.drift_at = 1;
    resume(s);
    g_assert_cmpuint(s->report.missing_conditions, ==, 0);
    g_assert_cmpuint(count_alarms(s, "dark drift: camera front: watch-1 is +1.0"), ==, 1);
    g_assert_cmpuint(count_alarms(s, "dark drift"), ==, 1);
    clear(s);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/capture/watches-are-stored-and-silent-when-nothing-drifts", test_watches);
    g_test_add_func("/capture/a-black-level-that-drifts-is-an-alarm", test_drift);
    g_test_add_func("/capture/a-watch-given-up-is-shot-again-whole", test_lost_watches);
    g_test_add_func("/capture/a-missing-watch-does-not-stop-the-take", test_missing_watch);
    g_test_add_func("/capture/a-resumed-take-watches-against-its-first-darks",
                    test_resumed_watches);
    return g_test_run();
}
