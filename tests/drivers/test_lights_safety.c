/* What lights drivers refuse before the controller is asked, each by how much; temperature, power
 * and work light on the controller's side, over every wire. */
#include "tests/drivers/lights_fixture.h"

#include <glib.h>
#include <inttypes.h>
#include <string.h>

/* ---- the host's own check ---- */

static struct ls_lights_info info_of(void)
{
    return (struct ls_lights_info){.n_lights = 10,
                                   .n_channels = 2,
                                   .pwm_period_us = 50,
                                   .pwm_levels = 1000,
                                   .min_pulse_us = 50,
                                   .max_pulse_us = 600000,
                                   .min_period_us = 10000,
                                   .max_duty_permille = 500,
                                   .max_current_ma = 5000,
                                   .led_current_ma = 700,
                                   .max_conditions = 4,
                                   .max_steps = 8,
                                   .max_program_bytes = 4096,
                                   .max_hold_us = 1000000,
                                   .heartbeat_ms = 1000,
                                   .max_power_mw = 3000,
                                   .led_power_mw = 2500,
                                   .hot_c = 70,
                                   .max_c = 85};
}

/* Two steps of one condition. */
struct asked {
    enum ls_condition_kind kind;
    uint16_t level;
    uint32_t pulse_us, period_us, n_steps;
    const char *sentence; /* NULL: accepted */
};

static void judge(const struct asked *a)
{
    const struct ls_lights_info info = info_of();
    const struct ls_led led = {0, 0, a->level};
    const struct ls_condition condition = {a->kind, 1, &led};
    struct ls_step steps[9];
    struct ls_diag diag = {0};
    for (uint32_t i = 0; i < 9; i++)
        steps[i] = (struct ls_step){0, a->pulse_us, 0, 0};
    const struct ls_program program = {&condition, 1, steps, a->n_steps, a->period_us};
    enum ls_err err = ls_lights_test(&info, &program, &diag);
    if (!a->sentence) {
        must(err, &diag);
        return;
    }
    if (err != LS_ERR_LIMIT || !strstr(diag.text, a->sentence))
        g_test_message("%s: %s; expected: %s", ls_err_name(err), diag.text, a->sentence);
    g_assert_cmpint(err, ==, LS_ERR_LIMIT);
    g_assert_nonnull(strstr(diag.text, a->sentence));
}

static void test_limits_of_the_host(void)
{
    /* A sphere of 10 lights takes 5000.0 mA at level 46810, and at half of the full level 12.5 W,
     * 3 W if it is on for 0.24 s of a second. */
    static const struct asked asked[] = {
        {LS_CONDITION_ONE, 65535, 50, 10000, 8, NULL},
        {LS_CONDITION_ONE, 65535, 49, 10000, 1,
         "pulse 49 us: 1 us shorter than the controller's 50"},
        {LS_CONDITION_ONE, 65535, 600001, 10000, 1, "1 us longer than the controller's 600000 us"},
        {LS_CONDITION_ONE, 65535, 75, 10000, 1, NULL},
        {LS_CONDITION_ONE, 65534, 75, 10000, 1,
         "75 us is 25 us over a whole number of the controller's PWM periods of 50 us: use 50 us"},
        {LS_CONDITION_ONE, 65534, 101, 10000, 1, "101 us is 1 us over a whole number"},
        {LS_CONDITION_ONE, 65535, 50, 9999, 1,
         "period 9999 us: 1 us shorter than the controller's"},
        {LS_CONDITION_ONE, 65535, 50, 10000, 9, "9 steps: 1 more than the controller's 8"},
        {LS_CONDITION_SPHERE, 46810, 50, 10000, 1, NULL},
        {LS_CONDITION_SPHERE, 46811, 50, 10000, 1,
         "current 5001 mA: 1 mA over the controller's 5000 mA"},
        {LS_CONDITION_ONE, 65535, 250000, 250000, 2, NULL},
        {LS_CONDITION_ONE, 65535, 250001, 250001, 2,
         "on for 500.002 ms of a second, 0.002 ms over the controller's 500.000 ms"},
        {LS_CONDITION_SPHERE, 32767, 120000, 200000, 2, NULL},
        {LS_CONDITION_SPHERE, 32767, 121000, 200000, 2,
         "would draw 3.02 W, mean over a second, 0.02 W over the controller's 3.00 W"},
        {LS_CONDITION_SPHERE, 32767, 150000, 200000, 2,
         "would draw 3.75 W, mean over a second, 0.75 W over the controller's 3.00 W"},
    };
    for (size_t i = 0; i < G_N_ELEMENTS(asked); i++)
        judge(&asked[i]);
}

static void judge_duty(uint16_t sphere_level, const struct ls_step *steps, uint32_t n_steps,
                       const char *sentence)
{
    const struct ls_lights_info info = info_of();
    const struct ls_led one = {0, 0, 65535}, all = {0, 0, sphere_level};
    const struct ls_condition pair[2] = {{LS_CONDITION_ONE, 1, &one},
                                         {LS_CONDITION_SPHERE, 1, &all}};
    const struct ls_program program = {pair, 2, steps, n_steps, 10000};
    struct ls_diag diag = {0};
    enum ls_err err = ls_lights_test(&info, &program, &diag);
    g_test_message("%s", diag.text);
    g_assert_cmpint(err, ==, sentence ? LS_ERR_LIMIT : LS_OK);
    g_assert_true(!sentence || strstr(diag.text, sentence));
}

/* Duty is an LED's over any second: alone and in spheres, in whatever steps. */
static void test_duty_of_the_host(void)
{
    /* 495 ms alone, and 100 ms at 3276 / 65535 (5.0 ms) or at 6553 / 65535 (10.0 ms) */
    const struct ls_step mixed[] = {{0, 247500, 0, 0}, {1, 100000, 0, 0}, {0, 247500, 0, 0}};
    judge_duty(3276, mixed, 3, NULL);
    judge_duty(6553, mixed, 3,
               "step 2: light address 0 channel 0 would be on for 504.999 ms of a second, 4.999 ms "
               "over");
    /* 300 ms, and 300 ms again a second after the first began, or 1 us before that */
    const struct ls_step apart[] = {{0, 300000, 0, 0}, {0, 300000, 700000, 0}};
    judge_duty(1, apart, 2, NULL);
    const struct ls_step near[] = {{0, 300000, 0, 0}, {0, 300000, 699999, 0}};
    judge_duty(1, near, 2, "step 1: light address 0 channel 0 would be on for 600.000 ms");
}

static void test_memory_of_the_host(void)
{
    struct ls_lights_info info = info_of();
    static const struct ls_condition dark[5] = {{LS_CONDITION_DARK, 0, NULL}};
    const struct ls_step step = {0, 50, 0, 0};
    struct ls_program program = {dark, 5, &step, 1, 10000};
    struct ls_diag diag = {0};
    g_assert_cmpint(ls_lights_test(&info, &program, &diag), ==, LS_ERR_LIMIT);
    g_assert_nonnull(strstr(diag.text, "5 conditions: 1 more than the controller's 4"));
    program.n_conditions = 4;
    info.max_program_bytes = 2 * (8 + 4 + 6) - 2; /* header, four darks, a step; less a register */
    g_assert_cmpint(ls_lights_test(&info, &program, &diag), ==, LS_ERR_LIMIT);
    g_assert_nonnull(strstr(diag.text, "program of 36 bytes: 2 more than the controller's memory"));
    info.max_program_bytes += 2;
    must(ls_lights_test(&info, &program, &diag), &diag);
}

static void refuses_work(uint16_t channel, uint16_t level, const char *sentence)
{
    const struct ls_lights_info info = info_of();
    struct ls_diag diag = {0};
    enum ls_err err = ls_lights_test_work(&info, channel, level, &diag);
    g_assert_cmpint(err, ==, channel < info.n_channels ? LS_ERR_LIMIT : LS_ERR_INVALID);
    g_test_message("%s", diag.text);
    g_assert_nonnull(strstr(diag.text, sentence));
}

static void test_work_of_the_host(void)
{
    struct ls_lights_info info = info_of();
    struct ls_diag diag = {0};
    refuses_work(2, 1, "channel 2: expected 0..1");
    refuses_work(0, 40000, "level 40000: 7233 over 32767, the controller's duty of 500 permille");
    refuses_work(0, 8000,
                 "would draw 3.05 W, mean over a second, 0.05 W over the controller's 3.00");
    must(ls_lights_test_work(&info, 1, 7800, &diag), &diag);
    info.max_current_ma = 800;
    g_assert_cmpint(ls_lights_test_work(&info, 1, 7800, &diag), ==, LS_ERR_LIMIT);
    g_assert_nonnull(strstr(diag.text, "work light: current 834 mA: 34 mA over"));
}

/* ---- the controller's check, over its wire ---- */

static void test_identified(gconstpointer driver)
{
    struct sim_controller_config config = small(driver);
    struct stand s = stand_up(driver, &config);
    const struct ls_lights_info *info = ls_lights_info(s.lights);
    g_assert_cmpuint(info->max_power_mw, ==, config.max_power_mw);
    g_assert_cmpuint(info->led_power_mw, ==, config.led_power_mw);
    g_assert_cmpuint(info->hot_c, ==, config.hot_c);
    g_assert_cmpuint(info->max_c, ==, config.max_c);
    stand_down(&s);
}

/* Hot is said and nothing more: what is granted fires. */
static void test_hot(gconstpointer driver)
{
    struct sim_controller_config config = small(driver);
    config.n_faults = 1;
    config.faults[0] = (struct sim_controller_fault){SIM_CONTROLLER_HEAT, 2, 1, 600};
    struct stand s = stand_up(driver, &config);
    struct ls_step steps[4];
    struct ls_step_event events[4];
    struct ls_program program = small_program(steps, 4);
    load(s.lights, &program);
    arm(s.lights);
    g_assert_false(status_of(s.lights).hot);
    grant(s.lights, 4);
    struct ls_lights_status status = collect(s.lights, events, 4);
    while (status.state == LS_LIGHTS_ARMED)
        status = status_of(s.lights);
    g_assert_cmpint(status.state, ==, LS_LIGHTS_DONE);
    g_assert_true(status.hot);
    g_assert_cmpint(status.temperature_c, ==, config.hot_c);
    do
        status = status_of(s.lights);
    while (status.hot);
    g_assert_cmpint(status.temperature_c, ==, config.temperature_c);
    stand_down(&s);
}

static void test_overheated(gconstpointer driver)
{
    struct sim_controller_config config = small(driver);
    config.n_faults = 1;
    config.faults[0] = (struct sim_controller_fault){SIM_CONTROLLER_OVERHEAT, 2, 1, 600};
    struct stand s = stand_up(driver, &config);
    struct ls_step steps[4];
    struct ls_step_event events[4];
    struct ls_program program = small_program(steps, 4);
    struct ls_diag diag = {0};
    load(s.lights, &program);
    arm(s.lights);
    grant(s.lights, 4);
    struct ls_lights_status status = collect(s.lights, events, 2);
    while (status.state == LS_LIGHTS_ARMED)
        status = status_of(s.lights);
    g_assert_cmpuint(status.faults, ==, LS_FAULT_OVERTEMP);
    g_assert_cmpint(status.temperature_c, ==, config.max_c);
    g_assert_cmpint(ls_lights_work(s.lights, &diag), ==, LS_ERR_REFUSED);
    g_assert_nonnull(strstr(diag.text, "too hot"));
    g_assert_cmpint(ls_lights_load(s.lights, &program, NULL, &diag), ==, LS_ERR_REFUSED);
    g_assert_nonnull(strstr(diag.text, "too hot"));
    while (status_of(s.lights).hot)
        ;
    load(s.lights, &program);
    g_assert_cmpuint(s.dome.log->n_pulses, ==, 2);
    stand_down(&s);
}

static void test_held_power(gconstpointer driver)
{
    struct sim_controller_config config = small(driver);
    config.max_duty_permille = 1000; /* asks for no dark at all */
    config.max_power_mw = 5000;      /* 12 LEDs of 2.5 W at 40000 / 65535 are 18.3 W */
    struct stand s = stand_up(driver, &config);
    struct ls_step steps[2] = {{3, 100, 0, LS_STEP_HOLD}, {3, 100, 0, LS_STEP_HOLD}};
    struct ls_program program = {conditions, N_CONDITIONS, steps, 2, 2000};
    struct ls_step_event events[2];
    load(s.lights, &program);
    arm(s.lights);
    grant(s.lights, 1);
    uint64_t lit_us;
    do
        lit_us = status_of(s.lights).now_us;
    while (!status_of(s.lights).holding);
    while (status_of(s.lights).now_us < lit_us + 20000)
        ;
    grant(s.lights, 2);
    grant(s.lights, 2);
    collect(s.lights, events, 1);
    while (status_of(s.lights).fired < 2)
        ;
    grant(s.lights, 2);
    collect(s.lights, events + 1, 1);
    g_assert_cmpuint(events[0].width_us, >=, 20000);
    /* 18.3 W : 5 W = 3.66, and whole microseconds */
    g_assert_cmpuint(events[1].us - events[0].us + 1, >=, (uint64_t)(3.66 * events[0].width_us));
    stand_down(&s);
}

/* The program of one pulse from arm to done; when it began, on the controller's clock. */
static uint64_t fire_again(struct ls_lights *lights)
{
    struct ls_step_event event;
    arm(lights);
    grant(lights, 1);
    struct ls_lights_status status = collect(lights, &event, 1);
    while (status.state == LS_LIGHTS_ARMED)
        status = status_of(lights);
    return event.us;
}

static void load_pulse(struct ls_lights *lights, uint32_t pulse_us)
{
    const struct ls_step step = {.condition = 1, .pulse_us = pulse_us};
    const struct ls_program program = {conditions, N_CONDITIONS, &step, 1, 2000};
    load(lights, &program);
}

/* Each program is within the limits of its own; what they would come to together is not. */
static void test_rearmed_duty(gconstpointer driver)
{
    struct sim_controller_config config = small(driver);
    config.max_duty_permille = 40;
    struct stand s = stand_up(driver, &config);
    uint64_t us[5];
    load_pulse(s.lights, 10000);
    for (int i = 0; i < 5; i++)
        us[i] = fire_again(s.lights);
    /* four pulses of 10 ms are 40 ms of a second; the fifth waits for the first to be over */
    g_test_message("after %" PRIu64 ", %" PRIu64 " us", us[3] - us[0], us[4] - us[0]);
    g_assert_cmpuint(us[4] - us[0], >=, 1000000);
    stand_down(&s);
}

/* The same of power, which is of all LEDs together; and of a program that was loaded anew. */
static void test_rearmed_power(gconstpointer driver)
{
    struct sim_controller_config config = small(driver);
    config.max_power_mw = 50; /* an LED of 2.5 W for 20 ms of a second */
    struct stand s = stand_up(driver, &config);
    uint64_t us[3];
    for (int i = 0; i < 3; i++) {
        load_pulse(s.lights, 10000 - 1000 * (i == 2)); /* 10 + 10 + 9 ms */
        us[i] = fire_again(s.lights);
    }
    g_assert_cmpuint(us[2] - us[0], >=, 1000000);
    stand_down(&s);
}

static void test_rearmed_work(gconstpointer driver)
{
    struct sim_controller_config config = small(driver);
    config.max_duty_permille = 100;
    struct stand s = stand_up(driver, &config);
    struct ls_diag diag = {0};
    load_pulse(s.lights, 90000);
    must(ls_lights_set_work(s.lights, conditions[1].leds->channel, 6000, &diag), &diag);
    must(ls_lights_work(s.lights, &diag), &diag);
    uint64_t on_us = status_of(s.lights).now_us;
    while (status_of(s.lights).now_us < on_us + 200000)
        ; /* at 92 permille of a second, 18 ms by then; 100 are allowed */
    g_assert_cmpuint(fire_again(s.lights), >=, on_us + 1200000);
    stand_down(&s);
}

static void test_work(gconstpointer driver)
{
    struct stand s = stand_up(driver, NULL);
    struct ls_step steps[4];
    struct ls_step_event events[4];
    struct ls_program program = small_program(steps, 4);
    struct ls_diag diag = {0};
    struct dome_log *log = s.dome.log;
    must(ls_lights_work(s.lights, &diag), &diag); /* none is named: dark */
    g_assert_false(status_of(s.lights).work_light);
    must(ls_lights_set_work(s.lights, 2, 3000, &diag), &diag);
    g_assert_false(status_of(s.lights).work_light);
    must(ls_lights_work(s.lights, &diag), &diag);
    g_assert_true(status_of(s.lights).work_light);
    g_assert_cmpuint(log->work_channel, ==, 2);
    g_assert_cmpfloat(log->work_duty, ==, 3000 / 65535.0);
    load(s.lights, &program); /* it stays on while the controller gets ready */
    g_assert_true(status_of(s.lights).work_light);
    arm(s.lights);
    g_assert_false(status_of(s.lights).work_light);
    g_assert_cmpfloat(log->work_duty, ==, 0);
    g_assert_cmpint(ls_lights_work(s.lights, &diag), ==, LS_ERR_REFUSED);
    g_assert_nonnull(strstr(diag.text, "armed"));
    grant(s.lights, 4);
    collect(s.lights, events, 4);
    must(ls_lights_blank(s.lights, &diag), &diag); /* dark, and dark it stays */
    g_assert_false(status_of(s.lights).work_light);
    must(ls_lights_work(s.lights, &diag), &diag);
    g_assert_true(status_of(s.lights).work_light);
    must(ls_lights_blank(s.lights, &diag), &diag);
    g_assert_false(status_of(s.lights).work_light);
    must(ls_lights_set_work(s.lights, 0, 0, &diag), &diag);
    must(ls_lights_work(s.lights, &diag), &diag);
    g_assert_false(status_of(s.lights).work_light);
    stand_down(&s);
}

/* The host dies in the middle of a run: nobody is there to ask for it. */
static void test_work_alone(gconstpointer driver)
{
    struct sim_controller_config config = small(driver);
    config.heartbeat_ms = 150;
    struct stand s = stand_up(driver, &config);
    struct ls_step steps[4];
    struct ls_program program = small_program(steps, 4);
    struct ls_diag diag = {0};
    must(ls_lights_set_work(s.lights, 1, 2000, &diag), &diag);
    load(s.lights, &program);
    arm(s.lights);
    struct ls_lights_status status;
    gint64 until = g_get_monotonic_time() + 5 * G_USEC_PER_SEC;
    while (s.dome.log->work_duty == 0 && g_get_monotonic_time() < until)
        ; /* says nothing to the controller */
    status = status_of(s.lights);
    g_assert_cmpuint(status.faults, ==, LS_FAULT_HEARTBEAT);
    g_assert_true(status.work_light);
    g_assert_cmpuint(s.dome.log->work_channel, ==, 1);
    stand_down(&s);
}

/* A host that only looks on dies. */
static void test_steady(gconstpointer driver)
{
    struct sim_controller_config config = small(driver);
    config.heartbeat_ms = 250;
    struct stand s = stand_up(driver, &config);
    struct ls_diag diag = {0};
    must(ls_lights_set_work(s.lights, 1, 2000, &diag), &diag);
    must(ls_lights_steady(s.lights, &diag), &diag);
    gint64 now, until = g_get_monotonic_time() + 600000; /* more than two heartbeats */
    while ((now = g_get_monotonic_time()) < until)
        g_assert_true(status_of(s.lights).work_light);
    until = now + 5 * G_USEC_PER_SEC;
    while (s.dome.log->work_duty != 0 && g_get_monotonic_time() < until)
        ; /* says nothing to the controller */
    g_assert_cmpfloat(s.dome.log->work_duty, ==, 0);
    struct ls_lights_status status = status_of(s.lights);
    g_assert_false(status.work_light);
    g_assert_cmpuint(status.faults, ==, 0);
    must(ls_lights_steady(s.lights, &diag), &diag);
    must(ls_lights_work(s.lights, &diag), &diag); /* that one stays */
    until = g_get_monotonic_time() + 400000;
    while (g_get_monotonic_time() < until)
        g_assert_cmpfloat(s.dome.log->work_duty, >, 0);
    must(ls_lights_blank(s.lights, &diag), &diag);
    g_assert_false(status_of(s.lights).work_light);
    stand_down(&s);
}

/* With the interlock open nothing shines, not even that. */
static void test_work_interlock(gconstpointer driver)
{
    struct sim_controller_config config = small(driver);
    config.n_faults = 1;
    config.faults[0] = (struct sim_controller_fault){SIM_CONTROLLER_ESTOP, 1, 1, 0};
    struct stand s = stand_up(driver, &config);
    struct ls_step steps[4];
    struct ls_program program = small_program(steps, 4);
    struct ls_diag diag = {0};
    must(ls_lights_set_work(s.lights, 1, 2000, &diag), &diag);
    load(s.lights, &program);
    arm(s.lights);
    grant(s.lights, 4);
    while (status_of(s.lights).state == LS_LIGHTS_ARMED)
        ;
    g_assert_true(status_of(s.lights).estop_pressed);
    g_assert_false(status_of(s.lights).work_light);
    g_assert_cmpint(ls_lights_work(s.lights, &diag), ==, LS_ERR_REFUSED);
    g_assert_nonnull(strstr(diag.text, "E-stop"));
    g_assert_false(status_of(s.lights).work_light);
    stand_down(&s);
}

int main(int argc, char **argv)
{
    static const struct lights_test tests[] = {
        {"power-and-temperature-limits-arrive", test_identified},
        {"a-hot-dome-says-so-and-goes-on", test_hot},
        {"an-overheated-dome-is-dark-until-it-has-cooled", test_overheated},
        {"a-held-step-is-followed-by-the-dark-that-power-asks-for", test_held_power, TCP | USB},
        {"programs-one-after-another-keep-the-limit-of-duty", test_rearmed_duty},
        {"programs-one-after-another-keep-the-limit-of-power", test_rearmed_power},
        {"a-work-light-counts-against-the-duty-of-what-follows", test_rearmed_work},
        {"the-work-light-is-on-when-asked-and-off-when-armed-or-blanked", test_work},
        {"a-silent-host-means-the-work-light-where-there-is-one", test_work_alone},
        {"a-steady-light-goes-out-with-its-host", test_steady},
        {"an-emergency-stop-puts-out-the-work-light-too", test_work_interlock},
    };
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/lights/every-limit-is-named-with-how-much-it-is-exceeded",
                    test_limits_of_the_host);
    g_test_add_func("/lights/duty-is-an-leds-over-any-second", test_duty_of_the_host);
    g_test_add_func("/lights/what-does-not-fit-the-controller-is-refused-with-how-much",
                    test_memory_of_the_host);
    g_test_add_func("/lights/a-work-light-over-a-limit-is-refused-with-how-much",
                    test_work_of_the_host);
    return run_lights_tests(tests, G_N_ELEMENTS(tests));
}
