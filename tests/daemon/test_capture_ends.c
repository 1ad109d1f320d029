/*
 * capture: takes that are held up, that end before their time, and that are resumed.
 */
#include "daemon/realtime.h"
#include "tests/daemon/capture_fixture.h"

#include <errno.h>
#include <glib.h>
#include <string.h>

static void test_stall(void)
{
    struct stage *s = new_stage();
    s->options.stall_at = FIRST_LIGHT + 10;
    g_assert_cmpint(shoot(s), ==, LS_OK);
    expect_complete(s);
    g_assert_cmpuint(s->report.final.shots_lost, ==, 0);
    clear(s);
}

static void test_stuck(void)
{
    if (!g_getenv("LS_TEST_FULL")) {
        g_test_skip("ten seconds, for so long a controller may pause: set LS_TEST_FULL=1");
        return;
    }
    struct stage *s = new_stage();
    s->options.stuck_at = FIRST_LIGHT + 10;
    g_assert_cmpint(shoot(s), ==, LS_ERR_TIMEOUT);
    g_assert_nonnull(strstr(s->diag.text, "fired nothing for 10"));
    g_assert_nonnull(strstr(s->diag.text, "resume"));
    g_assert_cmpuint(s->report.final.conditions_stored, >=, N_EXPOSURES);
    clear(s);
}

static void test_interlock(void)
{
    struct stage *s = new_stage();
    s->options.interlock_at = FIRST_LIGHT + 20;
    g_assert_cmpint(shoot(s), ==, LS_ERR_REFUSED);
    g_assert_nonnull(strstr(s->diag.text, "interlock open"));
    g_assert_nonnull(strstr(s->diag.text, "resume"));
    g_assert_cmpuint(s->report.final.conditions_stored, >=, N_EXPOSURES);
    clear(s);
}

static void test_camera_gone(void)
{
    struct stage *s = new_stage();
    s->options.gone_at = FIRST_LIGHT + 20;
    g_assert_cmpint(shoot(s), ==, LS_ERR_GONE);
    g_assert_nonnull(strstr(s->diag.text, "front"));
    g_assert_nonnull(strstr(s->diag.text, "resume"));
    clear(s);
}

static void test_no_darks(void)
{
    struct stage *s = new_stage();
    memset(s->options.faults, FAKE_LOST, sizeof s->options.faults);
    g_assert_cmpint(shoot(s), ==, LS_ERR_TIMEOUT);
    g_assert_nonnull(strstr(s->diag.text, "dark frames could not be had"));
    g_assert_nonnull(strstr(s->diag.text, "resume"));
    g_assert_cmpuint(fake_rig_last_lit_ns(s->rig), ==, 0);
    clear(s);
}

static int fail_after(void *user, enum ls_disk_op op, const char *name, size_t *n_bytes)
{
    struct stage *s = user;
    return op == LS_DISK_WRITE && s->capture && fake_rig_pulses(s->rig) > FIRST_LIGHT + 9 ? ENOSPC
                                                                                          : 0;
}

static void test_store_error(void)
{
    struct stage *s = new_stage();
    s->shim = (struct ls_disk_shim){.before = fail_after, .user = s};
    g_assert_cmpint(shoot(s), ==, LS_ERR_FULL);
    g_assert_cmpuint(fake_rig_pulses(s->rig), <, s->plan.n_steps);
    clear(s);
}

static int slow_disk(void *user, enum ls_disk_op op, const char *name, size_t *n_bytes)
{
    if (op == LS_DISK_SYNC)
        g_usleep(10000); /* what makes the disk slow */
    return 0;
}

static void test_slow_disk(void)
{
    struct stage *s = new_stage();
    s->shim = (struct ls_disk_shim){.before = slow_disk};
    g_assert_cmpint(shoot(s), ==, LS_OK);
    expect_complete(s); /* shoot() has checked that no exposure found the ring full */
    clear(s);
}

/* Frames that come one in 40 ms where one in 3 is planned, and are waited for 330: of as many as
 * the ring has room for under way, the last would come after 760. */
static void test_crowded(void)
{
    struct stage *s = new_stage();
    s->options.crowded_us = 40000;
    g_assert_cmpint(shoot(s), ==, LS_OK);
    expect_complete(s);
    g_assert_cmpuint(s->report.final.shots_lost, ==, 0);
    clear(s);
}

static gpointer run_thread(gpointer data)
{
    struct stage *s = data;
    return GINT_TO_POINTER(ls_capture_run(s->capture, &s->report, &s->diag));
}

static void test_abort(void)
{
    struct stage *s = new_stage();
    set_up(s);
    GThread *thread = g_thread_new("run", run_thread, s);
    struct ls_capture_progress progress;
    do {
        g_thread_yield();
        ls_capture_progress(s->capture, &progress);
    } while (progress.steps_bound < FIRST_LIGHT + 6);
    uint64_t asked_ns = ls_host_ns();
    ls_capture_abort(s->capture);
    enum ls_err err = GPOINTER_TO_INT(g_thread_join(thread));
    g_assert_cmpint(err, ==, LS_ERR_ABORTED);
    g_assert_true(fake_rig_is_dark(s->rig));
    /* one poll of 1.5 ms, and a loaded machine's scheduling; a pulse already due may follow */
    g_assert_cmpint((int64_t)(fake_rig_last_lit_ns(s->rig) - asked_ns), <, 100000000);
    g_assert_cmpuint(s->report.final.conditions_stored, >=, N_EXPOSURES);
    clear(s);
}

static void test_resume(void)
{
    struct stage *s = new_stage();
    struct ls_takedir *take;
    struct ls_take_report report;
    s->options.interlock_at = FIRST_LIGHT + 20;
    g_assert_cmpint(shoot(s), ==, LS_ERR_REFUSED);
    s->options.interlock_at = 0;
    resume(s);
    g_assert_cmpuint(s->report.missing_conditions, ==, 0);
    g_assert_cmpint(ls_takedir_open(s->folder, &take, NULL), ==, LS_OK);
    g_assert_cmpint(ls_takedir_verify(take, &report, NULL), ==, LS_OK);
    g_assert_cmpstr(report.text, ==, "");
    g_assert_cmpuint(report.pictures_good, ==, s->plan.n_conditions);
    g_assert_cmpuint(count_mislabeled(s, take), ==, 0);
    for (uint32_t i = 0; i < s->plan.n_conditions; i++)
        check_picture(s, take, i, 0);
    ls_take_report_finish(&report);
    ls_takedir_close(take);
    clear(s);
}

static void test_blank_fails(void)
{
    struct stage *s = new_stage();
    s->options.blank_fails = true;
    s->options.interlock_at = FIRST_LIGHT + 20;
    set_up(s);
    g_assert_cmpint(ls_capture_run(s->capture, &s->report, &s->diag), ==, LS_ERR_GONE);
    g_test_message("%s", s->diag.text); /* the darks' program is over, but not its light */
    g_assert_nonnull(strstr(s->diag.text, "controller unplugged"));
    g_assert_nonnull(strstr(s->diag.text, "LEDs may be lit"));
    clear(s);
    s = new_stage();
    s->options.blank_fails = true;
    s->options.interlock_at = 2;
    set_up(s);
    g_assert_cmpint(ls_capture_run(s->capture, &s->report, &s->diag), ==, LS_ERR_REFUSED);
    g_assert_nonnull(strstr(s->diag.text, "interlock open"));
    g_assert_nonnull(strstr(s->diag.text, "controller unplugged"));
    g_assert_nonnull(strstr(s->diag.text, "LEDs may be lit"));
    clear(s);
}

static void test_warm_up_blank_fails(void)
{
    struct stage *s = new_stage();
    s->options.warm_up_blank_fails = true;
    set_up(s);
    g_assert_cmpint(ls_capture_run(s->capture, &s->report, &s->diag), ==, LS_ERR_GONE);
    g_assert_nonnull(strstr(s->diag.text, "controller unplugged: LEDs may be lit"));
    clear(s);
    s = new_stage();
    s->options.warm_up_blank_fails = true;
    memset(s->options.warm_up_faults, FAKE_VANISHED, sizeof s->options.warm_up_faults);
    set_up(s);
    g_assert_cmpint(ls_capture_run(s->capture, &s->report, &s->diag), ==, LS_ERR_TIMEOUT);
    g_test_message("%s", s->diag.text);
    g_assert_nonnull(strstr(s->diag.text, "; and blanking failed: controller unplugged: LEDs may"));
    clear(s);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/capture/a-stalling-controller-is-waited-for", test_stall);
    g_test_add_func("/capture/without-darks-no-light-is-lit", test_no_darks);
    g_test_add_func("/capture/a-controller-that-is-stuck-ends-the-take-dark", test_stuck);
    g_test_add_func("/capture/an-open-interlock-ends-the-take-with-its-name", test_interlock);
    g_test_add_func("/capture/a-camera-that-disappears-ends-the-take-dark", test_camera_gone);
    g_test_add_func("/capture/a-store-error-stops-the-take-dark", test_store_error);
    g_test_add_func("/capture/a-slow-disk-slows-the-take-and-loses-nothing", test_slow_disk);
    g_test_add_func("/capture/a-slow-camera-slows-the-take-and-loses-nothing", test_crowded);
    g_test_add_func("/capture/an-abort-is-dark-at-once", test_abort);
    g_test_add_func("/capture/a-resumed-take-shoots-only-what-is-missing", test_resume);
    g_test_add_func("/capture/a-failed-blank-is-told-whatever-went-wrong-before", test_blank_fails);
    g_test_add_func("/capture/a-failed-blank-after-the-warm-up-is-told", test_warm_up_blank_fails);
    return g_test_run();
}
