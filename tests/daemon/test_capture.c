/*
 * capture: whole takes against a rig of fakes behind the drivers' interfaces: all there, repaired,
 * and every ticket true.
 */
#include "daemon/findings.h"
#include "daemon/flashing.h"
#include "daemon/realtime.h"
#include "tests/daemon/capture_fixture.h"

#include <glib.h>
#include <math.h>
#include <string.h>

static void test_whole(void)
{
    struct stage *s = new_stage();
    s->options.n_cameras = 2;
    g_assert_cmpint(shoot(s), ==, LS_OK);
    expect_complete(s);
    g_assert_cmpuint(s->report.final.shots_lost, ==, 0);
    g_assert_cmpuint(fake_rig_pulses(s->rig), ==, s->plan.n_steps);
    /* both clocks are exact to 1 us of the controller */
    g_assert_cmpfloat(s->report.residual_max_us, <, 5);
    g_assert_cmpstr(s->report.repaired, ==, "");
    clear(s);
}

static void expect_repaired(enum fake_fault fault, uint32_t pulse, const char *repaired)
{
    struct stage *s = new_stage();
    s->options.faults[pulse] = (unsigned char)fault;
    g_assert_cmpint(shoot(s), ==, LS_OK);
    expect_complete(s);
    g_assert_cmpuint(s->report.final.shots_lost, >=, 1);
    g_assert_cmpuint(s->report.final.shots_lost, ==, s->report.final.shots_repaired);
    g_assert_nonnull(strstr(s->report.repaired, repaired));
    clear(s);
}

static void test_dropped(void)
{
    expect_repaired(FAKE_DROPPED, FIRST_LIGHT + 3 * 5 + 1, "W-0005 (1 shot)");
    expect_repaired(FAKE_DROPPED, 4, "dark-1 (1 shot)");
}

static void test_lost(void)
{
    expect_repaired(FAKE_LOST, FIRST_LIGHT + 3 * 2, "W-0002 (1 shot)");
    expect_repaired(FAKE_VANISHED, FIRST_LIGHT + 3 * 2, "W-0002 (1 shot)");
}

static void test_lost_last(void)
{
    expect_repaired(FAKE_VANISHED, N_STEPS - 1, "W-0015 (1 shot)");
}

static void test_doubled(void)
{
    expect_repaired(FAKE_DOUBLED, FIRST_LIGHT + 3 * 7, "W-0007");
}

static void test_warm_up_faults(void)
{
    struct stage *s = new_stage();
    s->options.warm_up_faults[1] = FAKE_DROPPED;
    s->options.warm_up_faults[3] = FAKE_VANISHED;
    s->options.warm_up_faults[4] = FAKE_LOST;
    g_assert_cmpint(shoot(s), ==, LS_OK);
    expect_complete(s);
    clear(s);
}

static void test_many_faults(void)
{
    struct stage *s = new_stage();
    guint32 seed = g_test_rand_int();
    GRand *rand = g_rand_new_with_seed(seed);
    g_test_message("seed %u", seed);
    s->options.n_cameras = 2;
    s->config.retries = 8;
    for (int i = FIRST_LIGHT; i < 400; i++)
        if (g_rand_double(rand) < 0.05)
            s->options.faults[i] = (unsigned char)g_rand_int_range(rand, 1, FAKE_DOUBLED + 1);
    g_assert_cmpint(shoot(s), ==, LS_OK);
    expect_complete(s);
    g_rand_free(rand);
    clear(s);
}

static void test_missing(void)
{
    struct stage *s = new_stage();
    struct ls_takedir *take;
    s->options.lose_light = 3;
    g_assert_cmpint(shoot(s), ==, LS_OK);
    g_assert_cmpuint(s->report.missing_conditions, ==, 1);
    g_assert_cmpuint(s->report.final.conditions_stored, ==, s->plan.n_conditions - 1);
    g_assert_cmpint(ls_takedir_open(s->folder, &take, NULL), ==, LS_OK);
    bool named = false;
    for (size_t i = 0; i < take->n_alarms; i++)
        named |= strstr(take->alarms[i], "cam0/W-0003") != NULL;
    g_assert_true(named);
    g_assert_cmpuint(count_mislabeled(s, take), ==, 0);
    ls_takedir_close(take);
    clear(s);
}

static void test_corrupted_ticket(void)
{
    struct stage *s = new_stage();
    struct ls_takedir *take;
    g_assert_cmpint(shoot(s), ==, LS_OK);
    g_assert_cmpint(ls_takedir_open(s->folder, &take, NULL), ==, LS_OK);
    g_assert_cmpuint(count_mislabeled(s, take), ==, 0);
    take->tickets[20].step += 3; /* the same exposure of the next light */
    take->tickets[20].condition += 1;
    g_assert_cmpuint(count_mislabeled(s, take), ==, 1);
    ls_takedir_close(take);
    clear(s);
}

static void check_clock(const struct ls_clock_finding *c, double ppm)
{
    g_test_message("%.2f ppm, residual %.2f us rms, %.2f us max", c->drift_ppm, c->residual_rms_us,
                   c->residual_max_us);
    g_assert_cmpuint(c->pairs, >=, 5);
    /* the controller counts whole us over a baseline of 0.2 s and more: 5 ppm, twice over */
    g_assert_cmpfloat(fabs(c->drift_ppm - ppm), <, 10);
    g_assert_cmpfloat(c->residual_max_us, <, 5);
}

static void test_findings(void)
{
    struct stage *s = new_stage();
    struct ls_findings found;
    s->options.n_cameras = 2;
    uint64_t began_ns = ls_host_ns();
    g_assert_cmpint(shoot(s), ==, LS_OK);
    ls_capture_findings(s->capture, &found);
    check_clock(&found.controller, -80);
    for (uint32_t i = 0; i < 2; i++) {
        check_clock(&found.cameras[i], 60);
        g_assert_cmpfloat(found.cameras[i].host_ns, >, began_ns);
        g_assert_cmpfloat(found.cameras[i].host_ns, <, ls_host_ns());
        for (uint32_t e = 0; e < N_EXPOSURES; e++) {
            const struct ls_dark_finding *d = &found.darks[i][e];
            g_assert_true(d->known);
            /* three pixels hold marks */
            g_assert_cmpfloat(fabs(d->mean_dn - FAKE_BLACK), <, 0.5);
            g_assert_cmpfloat(d->clipped, <=, 1.0 / (FAKE_WIDTH * FAKE_HEIGHT));
            g_assert_cmpfloat(d->read_noise_dn, <, 0.1);
        }
    }
    clear(s);
}

/* In the order they were fired no exposure comes after a longer one, darks and lights apart. */
static void check_rounds(struct stage *s)
{
    struct ls_takedir *take;
    uint64_t last_us[2][N_EXPOSURES] = {{0}}, first_us[2][N_EXPOSURES] = {{0}};
    g_assert_cmpint(ls_takedir_open(s->folder, &take, NULL), ==, LS_OK);
    for (size_t i = 0; i < take->n_tickets; i++) {
        const struct ls_ticket *t = &take->tickets[i];
        const struct ls_plan_condition *c = &s->plan.conditions[t->condition];
        bool light = !c->dark || c->watch;
        uint64_t *first = &first_us[light][t->exposure], *last = &last_us[light][t->exposure];
        *first = *first && *first < t->controller_us ? *first : t->controller_us;
        *last = *last > t->controller_us ? *last : t->controller_us;
    }
    for (int i = 1; i < 2 * N_EXPOSURES; i++)
        g_assert_cmpuint((&first_us[0][0])[i], >, (&last_us[0][0])[i - 1]);
    ls_takedir_close(take);
}

static void test_timed(void)
{
    struct stage *s = new_stage();
    s->options.timed = true;
    s->watches = true;
    g_assert_cmpint(shoot(s), ==, LS_OK);
    expect_complete(s);
    check_rounds(s);
    /* before every round but the first, one that did its work */
    g_assert_cmpuint(s->metrics.cameras[0].settling_pulses, ==, 2 * N_EXPOSURES - 1);
    g_assert_cmpuint(fake_rig_pulses(s->rig), ==, s->plan.n_steps + 2 * N_EXPOSURES - 1);
    clear(s);
}

/* One shot of the first round and one of the last, whose frames do not come, of two cameras. */
static void test_timed_lost(void)
{
    struct stage *s = new_stage();
    s->options.timed = true;
    s->options.n_cameras = 2;
    s->options.faults[timed_pulse(3, 0, 0)] = FAKE_LOST;
    s->options.faults[timed_pulse(N_LIGHTS - 1, 2, 1)] = FAKE_VANISHED;
    g_assert_cmpint(shoot(s), ==, LS_OK);
    expect_complete(s);
    check_rounds(s); /* each was shot again within its round */
    g_assert_cmpuint(s->report.final.shots_repaired, >=, 2);
    clear(s);
}

/* The pulse after the register was written: dropped, and its frame lost. */
static void test_timed_settling(void)
{
    struct stage *s = new_stage();
    s->options.timed = true;
    s->options.faults[N_DARKS] = FAKE_DROPPED;
    s->options.faults[N_DARKS + 1] = FAKE_LOST;
    g_assert_cmpint(shoot(s), ==, LS_OK);
    expect_complete(s);
    g_assert_cmpuint(s->metrics.cameras[0].settling_pulses, ==, 2 * N_EXPOSURES - 1 + 2);
    g_assert_cmpuint(s->report.final.shots_lost, ==, 0);
    clear(s);
}

static void expect_published(struct stage *s)
{
    struct ls_takedir *take;
    struct ls_take_report report;
    g_assert_cmpint(ls_takedir_open(s->folder, &take, NULL), ==, LS_OK);
    g_assert_cmpint(ls_takedir_verify(take, &report, NULL), ==, LS_OK);
    g_assert_cmpstr(report.text, ==, "");
    for (uint32_t i = 0; i < s->plan.n_conditions; i++)
        check_picture(s, take, i, 0);
    ls_take_report_finish(&report);
    ls_takedir_close(take);
}

static void test_timed_resumed(void)
{
    struct stage *s = new_stage();
    s->options.timed = true;
    s->options.interlock_at = (uint32_t)timed_pulse(N_LIGHTS / 2, 2, 0);
    g_assert_cmpint(shoot(s), ==, LS_ERR_REFUSED);
    s->options.interlock_at = 0;
    resume(s);
    expect_published(s);
    clear(s);
}

/* A frame that waited on disk and is not what it was is shot again. */
static void test_timed_damaged(void)
{
    struct stage *s = new_stage();
    s->options.timed = true;
    s->options.interlock_at = (uint32_t)timed_pulse(1, 1, 0);
    g_assert_cmpint(shoot(s), ==, LS_ERR_REFUSED);
    s->options.interlock_at = 0;
    uint32_t shot = FIRST_LIGHT + 5 * N_EXPOSURES; /* light 5, first exposure */
    char *path = g_strdup_printf("%s/cam0/raw/%u-0.raw", s->folder, shot);
    g_assert_true(g_file_set_contents(path, "damaged", 7, NULL));
    g_free(path);
    resume(s);
    struct ls_takedir *take;
    g_assert_cmpint(ls_takedir_open(s->folder, &take, NULL), ==, LS_OK);
    g_assert_cmpuint(ls_takedir_ticket(take, shot)->attempt, ==, 1);
    g_assert_cmpuint(ls_takedir_ticket(take, shot + N_EXPOSURES)->attempt, ==, 0);
    ls_takedir_close(take);
    expect_published(s);
    clear(s);
}

static int slow_disk(void *user, enum ls_disk_op op, const char *name, size_t *n_bytes)
{
    if (op == LS_DISK_SYNC)
        g_usleep(60000); /* what makes the disk slow */
    return 0;
}

static int by_time(const void *a, const void *b)
{
    const struct ls_ticket *const *x = a, *const *y = b;
    return (*x)->controller_us < (*y)->controller_us ? -1 : 1;
}

/* Of the pulses really fired: how many bursts, none sooner than a third of a second after another.
 */
static uint32_t count_bursts(struct stage *s)
{
    struct ls_takedir *take;
    uint64_t last_us = 0, burst_us = 0;
    uint32_t bursts = 0, n = 0;
    g_assert_cmpint(ls_takedir_open(s->folder, &take, NULL), ==, LS_OK);
    const struct ls_ticket **sorted = g_new(const struct ls_ticket *, take->n_tickets);
    for (size_t i = 0; i < take->n_tickets; i++)
        if (!s->plan.conditions[take->tickets[i].condition].dark)
            sorted[n++] = &take->tickets[i];
    qsort(sorted, n, sizeof *sorted, by_time);
    for (uint32_t i = 0; i < n; i++) {
        uint64_t us = sorted[i]->controller_us;
        if (!last_us || us - last_us >= LS_FLASH_FUSED_US) {
            g_assert_true(!bursts || us - burst_us >= 333333);
            burst_us = us;
            bursts++;
        }
        last_us = us;
    }
    g_free(sorted);
    ls_takedir_close(take);
    return bursts;
}

static void test_live(void)
{
    struct stage *s = new_stage();
    s->live = true;
    s->shim = (struct ls_disk_shim){.before = slow_disk};
    g_assert_cmpint(shoot(s), ==, LS_OK);
    expect_complete(s);
    uint32_t bursts = count_bursts(s);
    g_test_message("%u bursts", bursts);
    g_assert_cmpuint(bursts, >=, 2);
    clear(s);
}

static void test_live_late(void)
{
    struct stage *s = new_stage();
    s->live = true;
    /* 3 ms four times, then 43; the first light is alone before a pause: three in 153 ms */
    s->options.stall_every = 5;
    g_assert_cmpint(shoot(s), ==, LS_ERR_REFUSED);
    g_assert_nonnull(strstr(s->diag.text, "the live subject saw pulses at 19.6 Hz"));
    g_assert_nonnull(strstr(s->diag.text, "LEDs are dark"));
    s->options.stall_every = 0;
    resume(s);
    clear(s);
    s = new_stage(); /* whoever asked for it, or is not alive, is shown it */
    s->options.stall_every = 5;
    g_assert_cmpint(shoot(s), ==, LS_OK);
    expect_complete(s);
    clear(s);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/capture/a-take-is-whole-and-every-ticket-is-true", test_whole);
    g_test_add_func("/capture/a-dropped-pulse-is-repaired", test_dropped);
    g_test_add_func("/capture/a-lost-frame-is-repaired", test_lost);
    g_test_add_func("/capture/a-lost-last-frame-is-repaired", test_lost_last);
    g_test_add_func("/capture/an-unasked-exposure-is-repaired", test_doubled);
    g_test_add_func("/capture/warm-up-survives-faults", test_warm_up_faults);
    g_test_add_func("/capture/a-mixture-of-faults-ends-complete", test_many_faults);
    g_test_add_func("/capture/what-cannot-be-had-is-named", test_missing);
    g_test_add_func("/capture/a-corrupted-ticket-is-counted", test_corrupted_ticket);
    g_test_add_func("/capture/darks-and-clocks-are-found-as-they-are", test_findings);
    g_test_add_func("/capture/timed-exposures-are-shot-one-after-the-other", test_timed);
    g_test_add_func("/capture/what-is-lost-of-a-timed-exposure-is-repaired-before-the-next",
                    test_timed_lost);
    g_test_add_func("/capture/a-timed-exposure-is-settled-before-it-is-used", test_timed_settling);
    g_test_add_func("/capture/a-resumed-take-uses-exposures-that-waited-on-disk",
                    test_timed_resumed);
    g_test_add_func("/capture/a-damaged-exposure-that-waited-on-disk-is-shot-again",
                    test_timed_damaged);
    g_test_add_func("/capture/a-starved-live-subject-is-shot-in-bursts", test_live);
    g_test_add_func("/capture/a-live-subject-that-sees-flashes-is-spared-the-rest", test_live_late);
    return g_test_run();
}
