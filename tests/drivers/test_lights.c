/* Conformance of lights drivers: what a program asks for happens, at its time and not before. */
#include "tests/drivers/lights_fixture.h"

#include <glib.h>
#include <math.h>

static void test_identify(gconstpointer driver)
{
    struct sim_controller_config config = small(driver);
    struct stand s = stand_up(driver, &config);
    const struct ls_lights_info *info = ls_lights_info(s.lights);
    g_assert_cmpstr(info->serial, ==, config.serial);
    g_assert_cmpuint(info->contract, ==, 1);
    g_assert_cmpuint(info->firmware, ==, config.firmware);
    g_assert_cmpuint(info->n_lights, ==, 12);
    g_assert_cmpuint(info->n_channels, ==, 3);
    g_assert_cmpuint(info->pwm_period_us, ==, config.pwm_period_us);
    g_assert_cmpuint(info->pwm_levels, ==, config.pwm_levels);
    g_assert_cmpuint(info->min_pulse_us, ==, config.min_pulse_us);
    g_assert_cmpuint(info->max_pulse_us, ==, config.max_pulse_us);
    g_assert_cmpuint(info->min_period_us, ==, config.min_period_us);
    g_assert_cmpuint(info->max_duty_permille, ==, config.max_duty_permille);
    g_assert_cmpuint(info->max_current_ma, ==, config.max_current_ma);
    g_assert_cmpuint(info->led_current_ma, ==, config.led_current_ma);
    g_assert_cmpuint(info->max_conditions, ==, config.max_conditions);
    g_assert_cmpuint(info->max_steps, ==, config.max_steps);
    g_assert_cmpuint(info->max_program_bytes, ==, config.max_program_bytes);
    g_assert_cmpuint(info->max_hold_us, ==, config.max_hold_us);
    g_assert_cmpuint(info->heartbeat_ms, ==, config.heartbeat_ms);
    struct ls_lights_status status = status_of(s.lights);
    g_assert_cmpint(status.state, ==, LS_LIGHTS_IDLE);
    g_assert_cmpint(status.temperature_c, ==, config.temperature_c);
    g_assert_cmpuint(status.now_us, >, config.clock.epoch_ticks);
    g_assert_cmpuint(status.host_before_ns, <, status.host_after_ns);
    stand_down(&s);
}

static void test_times(gconstpointer driver)
{
    struct stand s = stand_up(driver, NULL);
    struct ls_step steps[60];
    struct ls_step_event events[60];
    struct ls_program program = small_program(steps, 60);
    steps[20].settle_us = 5000; /* longer than the period */
    steps[30].pulse_us = 4000;
    load(s.lights, &program);
    g_assert_cmpint(status_of(s.lights).state, ==, LS_LIGHTS_LOADED);
    arm(s.lights);
    g_assert_cmpint(status_of(s.lights).state, ==, LS_LIGHTS_ARMED);
    g_assert_cmpuint(s.dome.log->n_pulses, ==, 0);
    grant(s.lights, 60);
    collect(s.lights, events, 60);
    struct ls_lights_status status = status_of(s.lights);
    g_assert_cmpint(status.state, ==, LS_LIGHTS_DONE);
    g_assert_cmpuint(status.fired, ==, 60);
    g_assert_cmpuint(status.events_lost, ==, 0);
    for (uint32_t i = 0; i < 60; i++) {
        const struct sim_pulse *pulse = &s.dome.log->pulses[i];
        g_assert_cmpuint(events[i].step, ==, i);
        g_assert_cmpuint(events[i].width_us, ==, steps[i].pulse_us);
        g_assert_cmpuint(events[i].flags, ==, 0);
        g_assert_cmpuint(pulse->step, ==, i);
        g_assert_cmpuint(pulse->condition, ==, steps[i].condition);
        /* the driven width is the asked one in a clock 80 ppm slow, within the clock's 1 us */
        g_assert_cmpfloat(fabs(pulse->pulse_us - steps[i].pulse_us), <, 1.4);
        if (!i)
            continue;
        uint64_t gap = steps[i - 1].pulse_us + steps[i].settle_us;
        g_assert_cmpuint(events[i].us - events[i - 1].us, ==, MAX(gap, 2000));
        double true_us = (double)(pulse->true_ns - s.dome.log->pulses[i - 1].true_ns) / 1e3;
        g_assert_cmpfloat(fabs(true_us - (double)MAX(gap, 2000)), <, 2.0);
    }
    stand_down(&s);
}

static void test_clock(gconstpointer driver)
{
    struct stand s = stand_up(driver, NULL);
    struct ls_step steps[40];
    struct ls_step_event events[40];
    struct ls_program program = small_program(steps, 40);
    struct ls_lights_status status;
    load(s.lights, &program);
    arm(s.lights);
    uint64_t before_us = status_of(s.lights).now_us;
    grant(s.lights, 40);
    collect(s.lights, events, 40);
    status = status_of(s.lights);
    g_assert_cmpuint(events[0].us, >=, before_us);
    g_assert_cmpuint(events[39].us, <, status.now_us);
    /* true time of the last pulse, by the status' latch and the drift, lies within the latch */
    uint64_t fired_ns = s.dome.log->pulses[39].true_ns;
    double ago_ns = (double)(status.now_us - events[39].us) * 1e3 / (1 - 80e-6);
    g_assert_cmpfloat((double)fired_ns + ago_ns, >=, (double)status.host_before_ns - 2000);
    g_assert_cmpfloat((double)fired_ns + ago_ns, <=, (double)status.host_after_ns + 2000);
    stand_down(&s);
}

static void test_many(gconstpointer driver)
{
    static struct ls_step steps[2000];
    static struct ls_step_event events[2000];
    struct sim_controller_config config = small(driver);
    struct stand s = stand_up(driver, &config);
    struct ls_program program = small_program(steps, 2000);
    program.period_us = config.min_period_us;
    load(s.lights, &program);
    arm(s.lights);
    uint32_t granted = 0, have = 0;
    while (have < 2000) {
        struct ls_lights_status status;
        struct ls_diag diag = {0};
        size_t got;
        if (granted < have + 24 && granted < 2000)
            grant(s.lights, granted = MIN(have + 24, 2000));
        uint32_t fired = s.dome.log->n_pulses;
        g_assert_cmpuint(fired, <=, granted);
        must(ls_lights_poll(s.lights, &status, events + have, 2000 - have, &got, &diag), &diag);
        g_assert_cmpuint(status.fired, <=, status.granted);
        have += (uint32_t)got;
    }
    for (uint32_t i = 0; i < 2000; i++) {
        g_assert_cmpuint(events[i].step, ==, i);
        g_assert_cmpuint(events[i].width_us, ==, steps[i].pulse_us);
        if (i)
            g_assert_cmpuint(events[i].us - events[i - 1].us, >=, config.min_period_us);
    }
    g_assert_cmpuint(status_of(s.lights).events_lost, ==, 0);
    g_assert_cmpuint(s.dome.log->n_pulses, ==, 2000);
    stand_down(&s);
}

static void test_credit(gconstpointer driver)
{
    struct stand s = stand_up(driver, NULL);
    struct ls_step steps[20];
    struct ls_step_event events[20];
    struct ls_program program = small_program(steps, 20);
    load(s.lights, &program);
    arm(s.lights);
    grant(s.lights, 5);
    collect(s.lights, events, 5);
    for (uint64_t from = status_of(s.lights).now_us; status_of(s.lights).now_us < from + 20000;)
        g_assert_cmpuint(s.dome.log->n_pulses, ==, 5);
    grant(s.lights, 3); /* never decreases */
    g_assert_cmpuint(status_of(s.lights).granted, ==, 5);
    uint64_t before_us = status_of(s.lights).now_us;
    grant(s.lights, 20);
    collect(s.lights, events + 5, 15);
    g_assert_cmpuint(events[5].us, >=, before_us);
    g_assert_cmpuint(events[5].flags, ==, LS_EVENT_LATE);
    g_assert_cmpuint(events[6].flags, ==, 0);
    struct ls_diag diag = {0};
    g_assert_cmpint(ls_lights_grant(s.lights, 21, &diag), ==, LS_ERR_REFUSED);
    arm(s.lights); /* again: the program is still there */
    g_assert_cmpuint(status_of(s.lights).fired, ==, 0);
    grant(s.lights, 2);
    collect(s.lights, events, 2);
    g_assert_cmpuint(events[0].step, ==, 0);
    stand_down(&s);
}

static struct ls_lights_status until_holding(struct ls_lights *lights, uint32_t fired)
{
    gint64 limit = g_get_monotonic_time() + 5 * G_USEC_PER_SEC;
    struct ls_lights_status status;
    do {
        status = status_of(lights);
        g_assert_cmpint(g_get_monotonic_time(), <, limit);
    } while (!status.holding || status.fired != fired);
    return status;
}

static void test_hold(gconstpointer driver)
{
    struct sim_controller_config config = small(driver);
    config.max_hold_us = 400000; /* a busy machine may take a while to release */
    struct stand s = stand_up(driver, &config);
    struct ls_step steps[3] = {
        {1, 100, 0, LS_STEP_HOLD}, {1, 100, 0, LS_STEP_HOLD}, {1, 100, 0, LS_STEP_HOLD}};
    struct ls_program program = {conditions, N_CONDITIONS, steps, 3, 2000};
    struct ls_step_event events[3];
    load(s.lights, &program);
    arm(s.lights);
    grant(s.lights, 1);
    struct ls_lights_status first = until_holding(s.lights, 1);
    while (status_of(s.lights).now_us < first.now_us + 10000)
        g_assert_cmpuint(s.dome.log->n_releases, ==, 0);
    grant(s.lights, 2); /* releases 0, s.lights 1 */
    struct ls_lights_status second = until_holding(s.lights, 2);
    collect(s.lights, events, 1);
    g_assert_cmpuint(events[0].width_us, >=, 10000);
    g_assert_cmpuint(events[0].width_us, <, config.max_hold_us);
    collect(s.lights, events + 1, 1); /* nobody releases 1: its limit does */
    g_assert_cmpuint(events[1].width_us, ==, config.max_hold_us);
    g_assert_cmpuint(events[1].us, <=, second.now_us);
    /* 500 permille: as much dark as light */
    g_assert_cmpuint(events[1].us - events[0].us, >=, 2 * events[0].width_us);
    grant(s.lights, 3);
    until_holding(s.lights, 3);
    grant(s.lights, 3); /* the same number releases the last one */
    struct ls_lights_status done = collect(s.lights, events + 2, 1);
    g_assert_cmpuint(events[2].width_us, <, config.max_hold_us);
    g_assert_cmpint(done.state, ==, LS_LIGHTS_DONE);
    g_assert_false(done.holding);
    g_assert_cmpuint(s.dome.log->n_releases, ==, 3);
    stand_down(&s);
}

static void test_blank(gconstpointer driver)
{
    struct stand s = stand_up(driver, NULL);
    struct ls_step steps[10];
    struct ls_step_event events[10];
    struct ls_program program = small_program(steps, 10);
    struct ls_diag diag = {0};
    steps[4].pulse_us = 400000;
    load(s.lights, &program);
    arm(s.lights);
    grant(s.lights, 10);
    while (status_of(s.lights).fired < 5)
        ;
    must(ls_lights_blank(s.lights, &diag), &diag);
    uint64_t dark_by = sim_now_ns();
    g_assert_cmpuint(s.dome.log->n_darks, ==, 1);
    g_assert_cmpuint(s.dome.log->dark_ns[0], <=, dark_by);
    must(ls_lights_blank(s.lights, &diag), &diag);
    struct ls_lights_status status = collect(s.lights, events, 5);
    g_assert_cmpint(status.state, ==, LS_LIGHTS_LOADED);
    g_assert_cmpuint(events[4].flags, ==, LS_EVENT_CLIPPED);
    g_assert_cmpuint(events[4].width_us, <, 400000);
    arm(s.lights);
    g_assert_cmpuint(s.dome.log->n_pulses, ==, 5); /* nothing fired in between */
    stand_down(&s);
}

static void test_close_blanks(gconstpointer driver)
{
    struct sim_controller_config config = small(driver);
    struct dome dome = dome_start(&config);
    struct ls_lights *lights = open_dome(driver, &dome);
    struct ls_step steps[2];
    struct ls_program program = small_program(steps, 2);
    steps[0].pulse_us = 400000;
    load(lights, &program);
    arm(lights);
    grant(lights, 2);
    while (status_of(lights).fired < 1)
        ;
    ls_lights_close(lights);
    g_assert_cmpuint(dome.log->n_darks, ==, 1);
    dome_stop(&dome);
}

static void test_large(gconstpointer driver)
{
    enum { N = 346, STEPS = 3 * N };
    static struct ls_led leds[N];
    static struct ls_condition ones[N];
    static struct ls_step steps[STEPS];
    struct sim_controller_config config;
    sim_controller_defaults(&config);
    config.wire = ((const struct driver *)driver)->wire;
    for (uint16_t i = 0; i < N; i++) {
        leds[i] = (struct ls_led){i, 0, 65535};
        ones[i] = (struct ls_condition){LS_CONDITION_ONE, 1, &leds[i]};
    }
    for (uint32_t i = 0; i < STEPS; i++)
        steps[i] = (struct ls_step){i / 3, 1000u << (i % 3), 0, 0};
    struct ls_program program = {ones, N, steps, STEPS, 13888};
    struct stand s = stand_up(driver, &config);
    gint64 start = g_get_monotonic_time();
    load(s.lights, &program);
    g_test_message("346 conditions, %d steps in %.1f ms", STEPS,
                   (double)(g_get_monotonic_time() - start) / 1e3);
    /* 64 round trips of ~0.1 ms, checks and one 5 ms wait; ample room for a busy machine */
    g_assert_cmpint(g_get_monotonic_time() - start, <, 500000);
    g_assert_cmpuint(s.dome.log->n_conditions, ==, N);
    stand_down(&s);
}

int main(int argc, char **argv)
{
    static const struct lights_test tests[] = {
        {"identity-and-limits-arrive-whole", test_identify},
        {"pulses-come-at-the-asked-times-and-widths", test_times},
        {"the-clock-is-latched-between-its-host-times", test_clock},
        {"two-thousand-steps-at-the-shortest-period-lose-no-event", test_many},
        {"nothing-fires-beyond-the-grant", test_credit},
        {"a-held-step-ends-with-the-next-grant-or-its-limit", test_hold},
        {"blank-stops-at-once", test_blank},
        {"close-leaves-the-dome-dark", test_close_blanks},
        {"a-take-of-346-lights-uploads-in-half-a-second", test_large, TCP | USB},
    };
    g_test_init(&argc, &argv, NULL);
    return run_lights_tests(tests, G_N_ELEMENTS(tests));
}
