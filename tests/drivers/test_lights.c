/* Conformance of lights drivers: every test runs against every driver of the table. */
#include "drivers/lights.h"
#include "tests/drivers/dome_fixture.h"

#include <glib.h>
#include <math.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

struct driver {
    const char *name;
    enum sim_controller_wire wire;
};

static const struct driver drivers[] = {
    {"modbus", SIM_WIRE_MODBUS},
    {"modbus-rtu", SIM_WIRE_MODBUS_RTU},
    {"usb", SIM_WIRE_USB},
};

static const struct ls_led led_full[] = {{3, 1, 65535}};
static const struct ls_led led_dim[] = {{7, 2, 32768}};
static const struct ls_led led_sphere[] = {{0, 0, 40000}};
static const struct ls_led led_segment[] = {{1, 2, 65535}, {5, 2, 65535}};
static const struct ls_led led_list[] = {{0, 0, 65535}, {11, 1, 20000}, {2, 2, 1}};
static const struct ls_condition conditions[] = {
    {LS_CONDITION_DARK, 0, NULL},           {LS_CONDITION_ONE, 1, led_full},
    {LS_CONDITION_ONE, 1, led_dim},         {LS_CONDITION_SPHERE, 1, led_sphere},
    {LS_CONDITION_SEGMENT, 2, led_segment}, {LS_CONDITION_LIST, 3, led_list},
};
enum { N_CONDITIONS = G_N_ELEMENTS(conditions), MAX_STEPS = 4096 };

/** dome_small, on the wire of this driver. */
static struct sim_controller_config small(const struct driver *driver)
{
    struct sim_controller_config config = dome_small();
    config.wire = driver->wire;
    return config;
}

static struct ls_lights *open_dome(const struct driver *driver, const struct dome *dome)
{
    struct ls_lights_config config = dome_address(dome);
    struct ls_lights *lights = NULL;
    g_assert_cmpstr(config.driver, ==, driver->name);
    struct ls_diag diag = {0};
    enum ls_err err = ls_lights_open(&config, &lights, &diag);
    g_assert_cmpstr(diag.text, ==, "");
    g_assert_cmpint(err, ==, LS_OK);
    return lights;
}

static void must(enum ls_err err, const struct ls_diag *diag)
{
    if (err)
        g_test_message("%s: %s", ls_err_name(err), diag->text);
    g_assert_cmpint(err, ==, LS_OK);
}

static void load(struct ls_lights *lights, const struct ls_program *program)
{
    struct ls_diag diag = {0};
    must(ls_lights_load(lights, program, NULL, &diag), &diag);
}

static void arm(struct ls_lights *lights)
{
    struct ls_diag diag = {0};
    must(ls_lights_arm(lights, &diag), &diag);
}

static void grant(struct ls_lights *lights, uint32_t n)
{
    struct ls_diag diag = {0};
    must(ls_lights_grant(lights, n, &diag), &diag);
}

static struct ls_lights_status status_of(struct ls_lights *lights)
{
    struct ls_lights_status status;
    struct ls_diag diag = {0};
    size_t n;
    must(ls_lights_poll(lights, &status, NULL, 0, &n, &diag), &diag);
    return status;
}

/** Poll until @n events have come; 10 s at most. */
static struct ls_lights_status collect(struct ls_lights *lights, struct ls_step_event *events,
                                       size_t n)
{
    struct ls_lights_status status = {0};
    gint64 limit = g_get_monotonic_time() + 10 * G_USEC_PER_SEC;
    for (size_t have = 0, got; have < n; have += got) {
        struct ls_diag diag = {0};
        must(ls_lights_poll(lights, &status, events + have, n - have, &got, &diag), &diag);
        g_assert_cmpuint(status.fired, <=, status.granted);
        g_assert_cmpint(g_get_monotonic_time(), <, limit);
    }
    return status;
}

static struct ls_program small_program(struct ls_step *steps, uint32_t n)
{
    for (uint32_t i = 0; i < n; i++)
        steps[i] = (struct ls_step){.condition = i % N_CONDITIONS, .pulse_us = 100 + 50 * (i % 4)};
    return (struct ls_program){conditions, N_CONDITIONS, steps, n, 2000};
}

static void test_identify(gconstpointer driver)
{
    struct sim_controller_config config = small(driver);
    struct dome dome = dome_start(&config);
    struct ls_lights *lights = open_dome(driver, &dome);
    const struct ls_lights_info *info = ls_lights_info(lights);
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
    struct ls_lights_status status = status_of(lights);
    g_assert_cmpint(status.state, ==, LS_LIGHTS_IDLE);
    g_assert_cmpint(status.temperature_c, ==, config.temperature_c);
    g_assert_cmpuint(status.now_us, >, config.clock.epoch_ticks);
    g_assert_cmpuint(status.host_before_ns, <, status.host_after_ns);
    ls_lights_close(lights);
    dome_stop(&dome);
}

static void test_nobody(gconstpointer data)
{
    const struct driver *driver = data;
    struct sim_controller_config config = small(driver);
    struct dome dome = dome_start(&config);
    struct ls_lights_config lc = dome_address(&dome);
    lc.unit = 9;
    struct ls_lights *lights;
    struct ls_diag diag = {0};
    g_assert_cmpint(ls_lights_open(&lc, &lights, &diag), ==, LS_ERR_UNSUPPORTED);
    g_assert_null(lights);
    dome_stop(&dome);
    lc.unit = 1;
    g_assert_cmpint(ls_lights_open(&lc, &lights, &diag), ==, LS_ERR_GONE);
    lc.driver = "dmx";
    g_assert_cmpint(ls_lights_open(&lc, &lights, &diag), ==, LS_ERR_NOT_FOUND);
    g_assert_nonnull(strstr(diag.text, "dmx"));
}

/** A peer that accepts and never answers. */
static void test_mute_peer(gconstpointer data)
{
    const struct driver *driver = data;
    int fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    struct sockaddr_storage sa = {.ss_family = AF_INET};
    socklen_t len = sizeof sa;
    g_assert_no_errno(listen(fd, 4));
    g_assert_no_errno(getsockname(fd, (struct sockaddr *)&sa, &len));
    unsigned port = g_ntohs(((uint16_t *)&sa)[1]);
    struct ls_lights_config lc = {
        .driver = driver->name, .address = "127.0.0.1", .port = port, .unit = 1, .timeout_ms = 100};
    struct ls_lights *lights;
    struct ls_diag diag = {0};
    gint64 start = g_get_monotonic_time();
    g_assert_cmpint(ls_lights_open(&lc, &lights, &diag), ==, LS_ERR_TIMEOUT);
    /* one answer is waited for; the rest is scheduling */
    g_assert_cmpint(g_get_monotonic_time() - start, <, 400000);
    close(fd);
}

static void test_times(gconstpointer driver)
{
    struct sim_controller_config config = small(driver);
    struct dome dome = dome_start(&config);
    struct ls_lights *lights = open_dome(driver, &dome);
    struct ls_step steps[60];
    struct ls_step_event events[60];
    struct ls_program program = small_program(steps, 60);
    steps[20].settle_us = 5000; /* longer than the period */
    steps[30].pulse_us = 4000;
    load(lights, &program);
    g_assert_cmpint(status_of(lights).state, ==, LS_LIGHTS_LOADED);
    arm(lights);
    g_assert_cmpint(status_of(lights).state, ==, LS_LIGHTS_ARMED);
    g_assert_cmpuint(dome.log->n_pulses, ==, 0);
    grant(lights, 60);
    collect(lights, events, 60);
    struct ls_lights_status status = status_of(lights);
    g_assert_cmpint(status.state, ==, LS_LIGHTS_DONE);
    g_assert_cmpuint(status.fired, ==, 60);
    g_assert_cmpuint(status.events_lost, ==, 0);
    for (uint32_t i = 0; i < 60; i++) {
        const struct sim_pulse *pulse = &dome.log->pulses[i];
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
        double true_us = (double)(pulse->true_ns - dome.log->pulses[i - 1].true_ns) / 1e3;
        g_assert_cmpfloat(fabs(true_us - (double)MAX(gap, 2000)), <, 2.0);
    }
    ls_lights_close(lights);
    dome_stop(&dome);
}

static void test_clock(gconstpointer driver)
{
    struct sim_controller_config config = small(driver);
    struct dome dome = dome_start(&config);
    struct ls_lights *lights = open_dome(driver, &dome);
    struct ls_step steps[40];
    struct ls_step_event events[40];
    struct ls_program program = small_program(steps, 40);
    struct ls_lights_status status;
    load(lights, &program);
    arm(lights);
    uint64_t before_us = status_of(lights).now_us;
    grant(lights, 40);
    collect(lights, events, 40);
    status = status_of(lights);
    g_assert_cmpuint(events[0].us, >=, before_us);
    g_assert_cmpuint(events[39].us, <, status.now_us);
    /* true time of the last pulse, by the status' latch and the drift, lies within the latch */
    uint64_t fired_ns = dome.log->pulses[39].true_ns;
    double ago_ns = (double)(status.now_us - events[39].us) * 1e3 / (1 - 80e-6);
    g_assert_cmpfloat((double)fired_ns + ago_ns, >=, (double)status.host_before_ns - 2000);
    g_assert_cmpfloat((double)fired_ns + ago_ns, <=, (double)status.host_after_ns + 2000);
    ls_lights_close(lights);
    dome_stop(&dome);
}

static void test_many(gconstpointer driver)
{
    static struct ls_step steps[2000];
    static struct ls_step_event events[2000];
    struct sim_controller_config config = small(driver);
    struct dome dome = dome_start(&config);
    struct ls_lights *lights = open_dome(driver, &dome);
    struct ls_program program = small_program(steps, 2000);
    program.period_us = config.min_period_us;
    load(lights, &program);
    arm(lights);
    uint32_t granted = 0, have = 0;
    while (have < 2000) {
        struct ls_lights_status status;
        struct ls_diag diag = {0};
        size_t got;
        if (granted < have + 24 && granted < 2000)
            grant(lights, granted = MIN(have + 24, 2000));
        uint32_t fired = dome.log->n_pulses;
        g_assert_cmpuint(fired, <=, granted);
        must(ls_lights_poll(lights, &status, events + have, 2000 - have, &got, &diag), &diag);
        g_assert_cmpuint(status.fired, <=, status.granted);
        have += (uint32_t)got;
    }
    for (uint32_t i = 0; i < 2000; i++) {
        g_assert_cmpuint(events[i].step, ==, i);
        g_assert_cmpuint(events[i].width_us, ==, steps[i].pulse_us);
        if (i)
            g_assert_cmpuint(events[i].us - events[i - 1].us, >=, config.min_period_us);
    }
    g_assert_cmpuint(status_of(lights).events_lost, ==, 0);
    g_assert_cmpuint(dome.log->n_pulses, ==, 2000);
    ls_lights_close(lights);
    dome_stop(&dome);
}

static void test_credit(gconstpointer driver)
{
    struct sim_controller_config config = small(driver);
    struct dome dome = dome_start(&config);
    struct ls_lights *lights = open_dome(driver, &dome);
    struct ls_step steps[20];
    struct ls_step_event events[20];
    struct ls_program program = small_program(steps, 20);
    load(lights, &program);
    arm(lights);
    grant(lights, 5);
    collect(lights, events, 5);
    for (uint64_t from = status_of(lights).now_us; status_of(lights).now_us < from + 20000;)
        g_assert_cmpuint(dome.log->n_pulses, ==, 5);
    grant(lights, 3); /* never decreases */
    g_assert_cmpuint(status_of(lights).granted, ==, 5);
    uint64_t before_us = status_of(lights).now_us;
    grant(lights, 20);
    collect(lights, events + 5, 15);
    g_assert_cmpuint(events[5].us, >=, before_us);
    g_assert_cmpuint(events[5].flags, ==, LS_EVENT_LATE);
    g_assert_cmpuint(events[6].flags, ==, 0);
    struct ls_diag diag = {0};
    g_assert_cmpint(ls_lights_grant(lights, 21, &diag), ==, LS_ERR_REFUSED);
    arm(lights); /* again: the program is still there */
    g_assert_cmpuint(status_of(lights).fired, ==, 0);
    grant(lights, 2);
    collect(lights, events, 2);
    g_assert_cmpuint(events[0].step, ==, 0);
    ls_lights_close(lights);
    dome_stop(&dome);
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
    struct dome dome = dome_start(&config);
    struct ls_lights *lights = open_dome(driver, &dome);
    struct ls_step steps[3] = {
        {1, 100, 0, LS_STEP_HOLD}, {1, 100, 0, LS_STEP_HOLD}, {1, 100, 0, LS_STEP_HOLD}};
    struct ls_program program = {conditions, N_CONDITIONS, steps, 3, 2000};
    struct ls_step_event events[3];
    load(lights, &program);
    arm(lights);
    grant(lights, 1);
    struct ls_lights_status first = until_holding(lights, 1);
    while (status_of(lights).now_us < first.now_us + 10000)
        g_assert_cmpuint(dome.log->n_releases, ==, 0);
    grant(lights, 2); /* releases 0, lights 1 */
    struct ls_lights_status second = until_holding(lights, 2);
    collect(lights, events, 1);
    g_assert_cmpuint(events[0].width_us, >=, 10000);
    g_assert_cmpuint(events[0].width_us, <, config.max_hold_us);
    collect(lights, events + 1, 1); /* nobody releases 1: its limit does */
    g_assert_cmpuint(events[1].width_us, ==, config.max_hold_us);
    g_assert_cmpuint(events[1].us, <=, second.now_us);
    /* 500 permille: as much dark as light */
    g_assert_cmpuint(events[1].us - events[0].us, >=, 2 * events[0].width_us);
    grant(lights, 3);
    until_holding(lights, 3);
    grant(lights, 3); /* the same number releases the last one */
    struct ls_lights_status done = collect(lights, events + 2, 1);
    g_assert_cmpuint(events[2].width_us, <, config.max_hold_us);
    g_assert_cmpint(done.state, ==, LS_LIGHTS_DONE);
    g_assert_false(done.holding);
    g_assert_cmpuint(dome.log->n_releases, ==, 3);
    ls_lights_close(lights);
    dome_stop(&dome);
}

static void test_blank(gconstpointer driver)
{
    struct sim_controller_config config = small(driver);
    struct dome dome = dome_start(&config);
    struct ls_lights *lights = open_dome(driver, &dome);
    struct ls_step steps[10];
    struct ls_step_event events[10];
    struct ls_program program = small_program(steps, 10);
    struct ls_diag diag = {0};
    steps[4].pulse_us = 400000;
    load(lights, &program);
    arm(lights);
    grant(lights, 10);
    while (status_of(lights).fired < 5)
        ;
    must(ls_lights_blank(lights, &diag), &diag);
    uint64_t dark_by = sim_now_ns();
    g_assert_cmpuint(dome.log->n_darks, ==, 1);
    g_assert_cmpuint(dome.log->dark_ns[0], <=, dark_by);
    must(ls_lights_blank(lights, &diag), &diag);
    struct ls_lights_status status = collect(lights, events, 5);
    g_assert_cmpint(status.state, ==, LS_LIGHTS_LOADED);
    g_assert_cmpuint(events[4].flags, ==, LS_EVENT_CLIPPED);
    g_assert_cmpuint(events[4].width_us, <, 400000);
    arm(lights);
    g_assert_cmpuint(dome.log->n_pulses, ==, 5); /* nothing fired in between */
    ls_lights_close(lights);
    dome_stop(&dome);
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

static void test_heartbeat(gconstpointer driver)
{
    struct sim_controller_config config = small(driver);
    config.heartbeat_ms = 150;
    struct dome dome = dome_start(&config);
    struct ls_lights *lights = open_dome(driver, &dome);
    struct ls_step steps[4];
    struct ls_program program = small_program(steps, 4);
    steps[1].pulse_us = 450000;
    struct ls_step_event events[4];
    load(lights, &program);
    arm(lights);
    grant(lights, 4);
    uint64_t silent_ns = sim_now_ns();
    dome_wait_dark(&dome);
    g_assert_cmpuint(dome.log->n_darks, ==, 1);
    double ms = (double)(dome.log->dark_ns[0] - silent_ns) / 1e6;
    /* from the grant, which may have arrived some ms before silent_ns, to a timer's lateness */
    g_assert_cmpfloat(ms, >, 130);
    g_assert_cmpfloat(ms, <, 350);
    struct ls_lights_status status = collect(lights, events, 2);
    g_assert_cmpint(status.state, ==, LS_LIGHTS_FAULT);
    g_assert_cmpuint(status.faults, ==, LS_FAULT_HEARTBEAT);
    struct ls_diag diag = {0};
    g_assert_cmpint(ls_lights_arm(lights, &diag), ==, LS_ERR_REFUSED);
    g_assert_nonnull(strstr(diag.text, "silent"));
    load(lights, &program); /* clears it */
    arm(lights);
    ls_lights_close(lights);
    dome_stop(&dome);
}

static void test_interlock(gconstpointer driver)
{
    struct sim_controller_config config = small(driver);
    config.n_faults = 1;
    config.faults[0] = (struct sim_controller_fault){SIM_CONTROLLER_INTERLOCK, 3, 1, 300};
    struct dome dome = dome_start(&config);
    struct ls_lights *lights = open_dome(driver, &dome);
    struct ls_step steps[10];
    struct ls_step_event events[10];
    struct ls_program program = small_program(steps, 10);
    struct ls_diag diag = {0};
    load(lights, &program);
    arm(lights);
    grant(lights, 10);
    struct ls_lights_status status = collect(lights, events, 3);
    while (status.state == LS_LIGHTS_ARMED)
        status = status_of(lights);
    g_assert_cmpint(status.state, ==, LS_LIGHTS_FAULT);
    g_assert_cmpuint(status.faults, ==, LS_FAULT_INTERLOCK);
    g_assert_cmpuint(status.fired, ==, 3);
    g_assert_cmpint(ls_lights_grant(lights, 10, &diag), ==, LS_ERR_REFUSED);
    g_assert_cmpint(ls_lights_arm(lights, &diag), ==, LS_ERR_REFUSED);
    g_assert_nonnull(strstr(diag.text, "interlock"));
    g_assert_cmpint(ls_lights_load(lights, &program, NULL, &diag), ==,
                    LS_ERR_REFUSED); /* still open */
    enum ls_err err;
    gint64 limit = g_get_monotonic_time() + 5 * G_USEC_PER_SEC;
    do
        err = ls_lights_load(lights, &program, NULL, &diag);
    while (err == LS_ERR_REFUSED && g_get_monotonic_time() < limit);
    must(err, &diag);
    g_assert_cmpuint(dome.log->n_pulses, ==, 3);
    ls_lights_close(lights);
    dome_stop(&dome);
}

static void test_stall(gconstpointer driver)
{
    struct sim_controller_config config = small(driver);
    config.n_faults = 1;
    config.faults[0] = (struct sim_controller_fault){SIM_CONTROLLER_STALL, 4, 1, 50};
    struct dome dome = dome_start(&config);
    struct ls_lights *lights = open_dome(driver, &dome);
    struct ls_step steps[8];
    struct ls_step_event events[8];
    struct ls_program program = small_program(steps, 8);
    load(lights, &program);
    arm(lights);
    grant(lights, 8);
    collect(lights, events, 8);
    g_assert_cmpuint(events[4].us - events[3].us, >=, 50000);
    for (int i = 0; i < 8; i++)
        g_assert_cmpuint(events[i].flags, ==, i == 4 ? LS_EVENT_LATE : 0);
    ls_lights_close(lights);
    dome_stop(&dome);
}

static void test_disconnect(gconstpointer driver)
{
    struct sim_controller_config config = small(driver);
    config.n_faults = 2;
    config.faults[0] = (struct sim_controller_fault){SIM_CONTROLLER_DISCONNECT, 3, 1, 10};
    config.faults[1] = (struct sim_controller_fault){SIM_CONTROLLER_DISCONNECT, 50, 1, 10};
    struct dome dome = dome_start(&config);
    struct ls_lights *lights = open_dome(driver, &dome);
    struct ls_step steps[60];
    struct ls_step_event events[60];
    struct ls_program program = small_program(steps, 60);
    load(lights, &program);
    arm(lights);
    grant(lights, 60);
    collect(lights, events, 60);
    for (uint32_t i = 0; i < 60; i++)
        g_assert_cmpuint(events[i].step, ==, i);
    ls_lights_close(lights);
    dome_stop(&dome);
}

static void test_restarted(gconstpointer driver)
{
    struct sim_controller_config config = small(driver);
    config.n_faults = 1;
    config.faults[0] = (struct sim_controller_fault){SIM_CONTROLLER_REBOOT, 1, 1, 10};
    struct dome dome = dome_start(&config);
    struct ls_lights *lights = open_dome(driver, &dome);
    struct ls_step steps[4];
    struct ls_program program = small_program(steps, 4);
    struct ls_lights_status status;
    struct ls_diag diag = {0};
    enum ls_err err;
    size_t n;
    load(lights, &program);
    arm(lights);
    grant(lights, 2);
    do
        err = ls_lights_poll(lights, &status, NULL, 0, &n, &diag);
    while (!err);
    g_assert_cmpint(err, ==, LS_ERR_MISMATCH);
    g_assert_nonnull(strstr(diag.text, "restarted"));
    g_assert_cmpint(ls_lights_grant(lights, 4, &diag), ==, LS_ERR_MISMATCH);
    load(lights, &program); /* begins anew */
    arm(lights);
    ls_lights_close(lights);
    dome_stop(&dome);
}

static void test_close_leaves_others_alone(gconstpointer driver)
{
    struct sim_controller_config config = small(driver);
    struct dome dome = dome_start(&config);
    struct ls_lights *mine = open_dome(driver, &dome), *other = open_dome(driver, &dome);
    struct ls_step steps[2];
    struct ls_program program = small_program(steps, 2);
    load(mine, &program);
    arm(mine);
    g_assert_cmpint(status_of(other).state, ==, LS_LIGHTS_ARMED);
    ls_lights_close(other);
    g_assert_cmpint(status_of(mine).state, ==, LS_LIGHTS_ARMED);
    ls_lights_close(mine);
    dome_stop(&dome);
}

static void test_stolen(gconstpointer driver)
{
    struct sim_controller_config config = small(driver);
    struct dome dome = dome_start(&config);
    struct ls_lights *mine = open_dome(driver, &dome), *other = open_dome(driver, &dome);
    struct ls_step steps[4];
    struct ls_program program = small_program(steps, 4);
    struct ls_lights_status status;
    struct ls_diag diag = {0};
    size_t n;
    load(mine, &program);
    arm(mine);
    g_assert_cmpint(ls_lights_load(other, &program, NULL, &diag), ==, LS_ERR_STATE);
    must(ls_lights_blank(other, &diag), &diag);
    arm(other);
    g_assert_cmpint(ls_lights_poll(mine, &status, NULL, 0, &n, &diag), ==, LS_ERR_MISMATCH);
    g_assert_nonnull(strstr(diag.text, "somebody else"));
    ls_lights_close(mine);
    ls_lights_close(other);
    dome_stop(&dome);
}

static void test_dead(gconstpointer data)
{
    const struct driver *driver = data;
    struct sim_controller_config config = small(driver);
    config.n_faults = 1;
    config.faults[0] = (struct sim_controller_fault){SIM_CONTROLLER_DEAD, 0, 1, 0};
    struct dome dome = dome_start(&config);
    struct ls_lights_config lc = dome_address(&dome);
    lc.timeout_ms = 100;
    struct ls_lights *lights;
    struct ls_lights_status status;
    struct ls_step_event events[4];
    struct ls_diag diag = {0};
    struct ls_step steps[4];
    struct ls_program program = small_program(steps, 4);
    size_t n;
    enum ls_err err;
    must(ls_lights_open(&lc, &lights, &diag), &diag);
    load(lights, &program);
    arm(lights);
    grant(lights, 1);
    gint64 start;
    do {
        start = g_get_monotonic_time();
        err = ls_lights_poll(lights, &status, events, 4, &n, &diag);
    } while (!err);
    g_assert_cmpint(err, ==, LS_ERR_TIMEOUT);
    /* five timeouts at most, by the contract of lights.h, and scheduling */
    g_assert_cmpint(g_get_monotonic_time() - start, <, 700000);
    err = ls_lights_blank(lights, &diag);
    g_assert_true(err == LS_ERR_TIMEOUT || err == LS_ERR_GONE);
    ls_lights_close(lights);
    dome_stop(&dome);
}

static void test_killed(gconstpointer driver)
{
    struct sim_controller_config config = small(driver);
    struct dome dome = dome_start(&config);
    struct ls_lights *lights = open_dome(driver, &dome);
    struct ls_lights_status status;
    struct ls_diag diag = {0};
    size_t n;
    dome_stop(&dome);
    g_assert_cmpint(ls_lights_poll(lights, &status, NULL, 0, &n, &diag), ==, LS_ERR_GONE);
    g_assert_cmpint(ls_lights_grant(lights, 1, &diag), ==, LS_ERR_GONE);
    g_assert_cmpint(ls_lights_blank(lights, &diag), ==, LS_ERR_GONE);
    ls_lights_close(lights);
}

static void test_corrupted(gconstpointer driver)
{
    struct sim_controller_config config = small(driver);
    config.n_faults = 1;
    config.faults[0] = (struct sim_controller_fault){SIM_CONTROLLER_CORRUPT, 0, 1, 0};
    struct dome dome = dome_start(&config);
    struct ls_lights *lights = open_dome(driver, &dome);
    struct ls_step steps[200];
    struct ls_program program = small_program(steps, 200);
    struct ls_diag diag = {0};
    g_assert_cmpint(ls_lights_load(lights, &program, NULL, &diag), ==, LS_ERR_MISMATCH);
    g_assert_nonnull(strstr(diag.text, "CRC"));
    g_assert_cmpint(ls_lights_arm(lights, &diag), ==, LS_ERR_STATE);
    load(lights, &program);
    ls_lights_close(lights);
    dome_stop(&dome);
}

static void test_unprepared(gconstpointer driver)
{
    struct sim_controller_config config = small(driver);
    config.n_faults = 1;
    config.faults[0] = (struct sim_controller_fault){SIM_CONTROLLER_REFUSE, 0, 1, 0};
    struct dome dome = dome_start(&config);
    struct ls_lights *lights = open_dome(driver, &dome);
    struct ls_step steps[4];
    struct ls_program program = small_program(steps, 4);
    struct ls_diag diag = {0};
    g_assert_cmpint(ls_lights_load(lights, &program, NULL, &diag), ==, LS_ERR_REFUSED);
    g_assert_nonnull(strstr(diag.text, "ready"));
    load(lights, &program);
    ls_lights_close(lights);
    dome_stop(&dome);
}

static void test_stopped_load(gconstpointer driver)
{
    struct sim_controller_config config = small(driver);
    struct dome dome = dome_start(&config);
    struct ls_lights *lights = open_dome(driver, &dome);
    struct ls_step steps[4];
    struct ls_program program = small_program(steps, 4);
    struct ls_diag diag = {0};
    _Atomic bool stop = true;
    dome.log->hold_commit = true;
    g_assert_cmpint(ls_lights_load(lights, &program, &stop, &diag), ==, LS_ERR_ABORTED);
    must(ls_lights_blank(lights, &diag), &diag);
    dome.log->hold_commit = false;
    sem_post(&dome.log->let_commit);
    load(lights, &program); /* waits for the one given up, then loads */
    g_assert_cmpuint(dome.log->n_commits, ==, 2);
    ls_lights_close(lights);
    dome_stop(&dome);
}

static void test_overflow(gconstpointer driver)
{
    struct sim_controller_config config = small(driver);
    config.event_queue = 16;
    struct dome dome = dome_start(&config);
    struct ls_lights *lights = open_dome(driver, &dome);
    struct ls_step steps[40];
    struct ls_step_event events[16];
    struct ls_program program = small_program(steps, 40);
    load(lights, &program);
    arm(lights);
    grant(lights, 40);
    while (status_of(lights).state != LS_LIGHTS_DONE) /* reads no events */
        ;
    struct ls_lights_status status = collect(lights, events, 16);
    g_assert_cmpuint(status.events_lost, ==, 24);
    for (uint32_t i = 0; i < 16; i++)
        g_assert_cmpuint(events[i].step, ==, 24 + i);
    ls_lights_close(lights);
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
    struct dome dome = dome_start(&config);
    struct ls_lights *lights = open_dome(driver, &dome);
    gint64 start = g_get_monotonic_time();
    load(lights, &program);
    g_test_message("346 conditions, %d steps in %.1f ms", STEPS,
                   (double)(g_get_monotonic_time() - start) / 1e3);
    /* 64 round trips of ~0.1 ms, checks and one 5 ms wait; ample room for a busy machine */
    g_assert_cmpint(g_get_monotonic_time() - start, <, 500000);
    g_assert_cmpuint(dome.log->n_conditions, ==, N);
    ls_lights_close(lights);
    dome_stop(&dome);
}

/** Did the LEDs of the log do what @program asks, at PWM resolution? */
static bool shows(const struct dome_log *log, const struct ls_program *program, uint32_t n_lights,
                  uint32_t pwm_levels)
{
    if (log->n_pulses != program->n_steps)
        return false;
    for (uint32_t i = 0; i < program->n_steps; i++) {
        const struct ls_condition *c = &program->conditions[program->steps[i].condition];
        uint32_t lit = log->pulses[i].condition;
        uint32_t n = c->kind == LS_CONDITION_SPHERE ? n_lights : c->n_leds;
        if (log->conditions[lit].n_leds != n)
            return false;
        for (uint32_t k = 0; k < n && k < DOME_LEDS; k++) {
            const struct sim_led *got = &log->conditions[lit].leds[k];
            const struct ls_led *asked = &c->leds[c->kind == LS_CONDITION_SPHERE ? 0 : k];
            uint32_t light = c->kind == LS_CONDITION_SPHERE ? k : asked->light;
            if (got->light != light || got->channel != asked->channel ||
                fabs(got->duty - asked->level / 65535.0) > 0.5 / (pwm_levels - 1) + 1e-6)
                return false;
        }
    }
    return true;
}

enum mutation { AS_ASKED, SWAPPED_LIGHTS, SWAPPED_VH, ONE_BASED, HALF_LEVEL, SHIFTED_STEPS };

/** Fire @program as a driver or controller with the given mistake would; what do the LEDs say? */
static bool fire_mutated(const struct driver *driver, enum mutation mutation)
{
    struct ls_led leds[8] = {{0, 0, 65535}, {1, 0, 65535}, {2, 1, 30000}, {3, 2, 65535},
                             {4, 0, 65535}, {5, 1, 65535}, {6, 2, 12345}, {7, 0, 65535}};
    struct ls_led wrong[8];
    struct ls_condition asked[9] = {{0}}, loaded[9] = {{0}};
    struct ls_step asked_steps[9], loaded_steps[9];
    memcpy(wrong, leds, sizeof wrong);
    for (int i = 0; i < 8; i++) {
        if (mutation == SWAPPED_LIGHTS && (i == 4 || i == 5))
            wrong[i].light = (uint16_t)(9 - i);
        if (mutation == SWAPPED_VH && leds[i].channel)
            wrong[i].channel = 3 - leds[i].channel;
        if (mutation == ONE_BASED)
            wrong[i].light++;
        if (mutation == HALF_LEVEL && i == 6)
            wrong[i].level /= 2;
        asked[i + 1] = (struct ls_condition){LS_CONDITION_ONE, 1, &leds[i]};
        loaded[i + 1] = (struct ls_condition){LS_CONDITION_ONE, 1, &wrong[i]};
    }
    for (uint32_t i = 0; i < 9; i++) {
        asked_steps[i] = loaded_steps[i] = (struct ls_step){i, 100, 0, 0};
        if (mutation == SHIFTED_STEPS)
            loaded_steps[i].condition = (i + 1) % 9;
    }
    struct ls_program program = {asked, 9, asked_steps, 9, 2000};
    struct ls_program mutated = {loaded, 9, loaded_steps, 9, 2000};
    struct sim_controller_config config = small(driver);
    struct dome dome = dome_start(&config);
    struct ls_lights *lights = open_dome(driver, &dome);
    struct ls_step_event events[9];
    load(lights, &mutated);
    arm(lights);
    grant(lights, 9);
    collect(lights, events, 9);
    bool same = shows(dome.log, &program, config.n_lights, config.pwm_levels);
    ls_lights_close(lights);
    dome_stop(&dome);
    return same;
}

static void test_shown(gconstpointer driver)
{
    g_assert_true(fire_mutated(driver, AS_ASKED));
}

static void test_swapped_lights(gconstpointer driver)
{
    g_assert_false(fire_mutated(driver, SWAPPED_LIGHTS));
}

static void test_swapped_vh(gconstpointer driver)
{
    g_assert_false(fire_mutated(driver, SWAPPED_VH));
}

static void test_one_based(gconstpointer driver)
{
    g_assert_false(fire_mutated(driver, ONE_BASED));
}

static void test_other_mutations(gconstpointer driver)
{
    g_assert_false(fire_mutated(driver, HALF_LEVEL));
    g_assert_false(fire_mutated(driver, SHIFTED_STEPS));
}

static void test_kinds_shown(gconstpointer driver)
{
    struct sim_controller_config config = small(driver);
    struct dome dome = dome_start(&config);
    struct ls_lights *lights = open_dome(driver, &dome);
    struct ls_step steps[12];
    struct ls_step_event events[12];
    struct ls_program program = small_program(steps, 12);
    load(lights, &program);
    arm(lights);
    grant(lights, 12);
    collect(lights, events, 12);
    g_assert_true(shows(dome.log, &program, config.n_lights, config.pwm_levels));
    ls_lights_close(lights);
    dome_stop(&dome);
}

int main(int argc, char **argv)
{
    /* several hosts, ports and units are Modbus TCP's; a serial line takes its time */
    enum { TCP = 1 << SIM_WIRE_MODBUS, USB = 1 << SIM_WIRE_USB };
    static const struct {
        const char *name;
        GTestDataFunc run;
        unsigned wires; /* 0: all */
    } tests[] = {
        {"identity-and-limits-arrive-whole", test_identify},
        {"wrong-unit-nobody-and-unknown-driver-are-told-apart", test_nobody, TCP},
        {"a-mute-peer-costs-one-timeout", test_mute_peer, TCP},
        {"pulses-come-at-the-asked-times-and-widths", test_times},
        {"the-clock-is-latched-between-its-host-times", test_clock},
        {"two-thousand-steps-at-the-shortest-period-lose-no-event", test_many},
        {"nothing-fires-beyond-the-grant", test_credit},
        {"a-held-step-ends-with-the-next-grant-or-its-limit", test_hold},
        {"blank-stops-at-once", test_blank},
        {"close-leaves-the-dome-dark", test_close_blanks},
        {"a-silent-host-means-dark-lights", test_heartbeat},
        {"an-open-interlock-latches-until-closed-and-loaded", test_interlock},
        {"a-stall-is-flagged-late", test_stall},
        {"a-closed-connection-loses-no-event", test_disconnect},
        {"a-restarted-controller-is-noticed", test_restarted},
        {"a-second-host-is-noticed", test_stolen, TCP},
        {"close-leaves-another-host's-program-alone", test_close_leaves_others_alone, TCP},
        {"a-dead-controller-times-out-in-bounds", test_dead},
        {"a-controller-that-left-is-gone", test_killed, TCP},
        {"a-damaged-upload-is-caught", test_corrupted},
        {"a-controller-that-cannot-get-ready-refuses", test_unprepared},
        {"a-load-can-be-given-up", test_stopped_load},
        {"overwritten-events-are-counted", test_overflow},
        {"a-take-of-346-lights-uploads-in-half-a-second", test_large, TCP | USB},
        {"the-leds-show-what-was-asked", test_shown},
        {"every-kind-of-condition-is-shown", test_kinds_shown},
        {"mutation-swapped-lights-is-caught", test_swapped_lights},
        {"mutation-v-h-swap-is-caught", test_swapped_vh},
        {"mutation-one-based-lights-is-caught", test_one_based},
        {"mutation-level-and-step-shift-are-caught", test_other_mutations},
    };
    g_test_init(&argc, &argv, NULL);
    for (size_t d = 0; d < G_N_ELEMENTS(drivers); d++)
        for (size_t i = 0; i < G_N_ELEMENTS(tests); i++) {
            if (tests[i].wires && !(tests[i].wires >> drivers[d].wire & 1))
                continue;
            char *path = g_strdup_printf("/lights/%s/%s", drivers[d].name, tests[i].name);
            g_test_add_data_func(path, &drivers[d], tests[i].run);
            g_free(path);
        }
    return g_test_run();
}
