/* Conformance of lights drivers: silence, faults, other hosts, damage. */
#include "tests/drivers/lights_fixture.h"

#include <glib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

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

static void test_heartbeat(gconstpointer driver)
{
    struct sim_controller_config config = small(driver);
    config.heartbeat_ms = 150;
    struct stand s = stand_up(driver, &config);
    struct ls_step steps[4];
    struct ls_program program = small_program(steps, 4);
    steps[1].pulse_us = 450000;
    struct ls_step_event events[4];
    load(s.lights, &program);
    arm(s.lights);
    grant(s.lights, 4);
    uint64_t silent_ns = sim_now_ns();
    dome_wait_dark(&s.dome);
    g_assert_cmpuint(s.dome.log->n_darks, ==, 1);
    double ms = (double)(s.dome.log->dark_ns[0] - silent_ns) / 1e6;
    /* from the grant, which may have arrived some ms before silent_ns, to a timer's lateness */
    g_assert_cmpfloat(ms, >, 130);
    g_assert_cmpfloat(ms, <, 350);
    struct ls_lights_status status = collect(s.lights, events, 2);
    g_assert_cmpint(status.state, ==, LS_LIGHTS_FAULT);
    g_assert_cmpuint(status.faults, ==, LS_FAULT_HEARTBEAT);
    struct ls_diag diag = {0};
    g_assert_cmpint(ls_lights_arm(s.lights, &diag), ==, LS_ERR_REFUSED);
    g_assert_nonnull(strstr(diag.text, "silent"));
    load(s.lights, &program); /* clears it */
    arm(s.lights);
    stand_down(&s);
}

/* Opened before the fourth step, for @open_ms (0: for good), which ends the run. */
static void open_interlock(gconstpointer driver, double open_ms)
{
    struct sim_controller_config config = small(driver);
    config.n_faults = 1;
    config.faults[0] = (struct sim_controller_fault){SIM_CONTROLLER_INTERLOCK, 3, 1, open_ms};
    struct stand s = stand_up(driver, &config);
    struct ls_step steps[10];
    struct ls_step_event events[10];
    struct ls_program program = small_program(steps, 10);
    struct ls_diag diag = {0};
    load(s.lights, &program);
    arm(s.lights);
    grant(s.lights, 10);
    struct ls_lights_status status = collect(s.lights, events, 3);
    while (status.state == LS_LIGHTS_ARMED)
        status = status_of(s.lights);
    g_assert_cmpint(status.state, ==, LS_LIGHTS_FAULT);
    g_assert_cmpuint(status.faults, ==, LS_FAULT_INTERLOCK);
    g_assert_cmpuint(status.fired, ==, 3);
    g_assert_cmpint(ls_lights_grant(s.lights, 10, &diag), ==, LS_ERR_REFUSED);
    g_assert_cmpint(ls_lights_arm(s.lights, &diag), ==, LS_ERR_REFUSED);
    g_assert_nonnull(strstr(diag.text, "interlock"));
    if (open_ms == 0) {
        g_assert_true(status.interlock_open);
        g_assert_cmpint(ls_lights_load(s.lights, &program, NULL, &diag), ==, LS_ERR_REFUSED);
        g_assert_nonnull(strstr(diag.text, "interlock"));
    } else {
        while (status_of(s.lights).interlock_open)
            ;
        g_assert_cmpuint(status_of(s.lights).faults, ==, LS_FAULT_INTERLOCK); /* latched */
        load(s.lights, &program);
        g_assert_cmpuint(status_of(s.lights).faults, ==, 0);
    }
    g_assert_cmpuint(s.dome.log->n_pulses, ==, 3);
    stand_down(&s);
}

static void test_interlock(gconstpointer driver)
{
    open_interlock(driver, 0);
    open_interlock(driver, 100);
}

/* A controller on USB is one opener's, also within a process; the first goes on as if nothing was.
 */
static void test_second_opener(gconstpointer driver)
{
    struct stand s = stand_up(driver, NULL);
    struct ls_lights_config config = dome_address(&s.dome);
    struct ls_diag diag = {0};
    for (int i = 0; i < 3; i++) {
        struct ls_lights *second;
        g_assert_cmpint(ls_lights_open(&config, &second, &diag), ==, LS_ERR_BUSY);
        g_test_message("%s", diag.text);
        g_assert_nonnull(strstr(diag.text, "in use"));
        g_assert_cmpint(status_of(s.lights).state, ==, LS_LIGHTS_IDLE);
    }
    stand_down(&s);
}

static void test_stall(gconstpointer driver)
{
    struct sim_controller_config config = small(driver);
    config.n_faults = 1;
    config.faults[0] = (struct sim_controller_fault){SIM_CONTROLLER_STALL, 4, 1, 50};
    struct stand s = stand_up(driver, &config);
    struct ls_step steps[8];
    struct ls_step_event events[8];
    struct ls_program program = small_program(steps, 8);
    load(s.lights, &program);
    arm(s.lights);
    grant(s.lights, 8);
    collect(s.lights, events, 8);
    g_assert_cmpuint(events[4].us - events[3].us, >=, 50000);
    for (int i = 0; i < 8; i++)
        g_assert_cmpuint(events[i].flags, ==, i == 4 ? LS_EVENT_LATE : 0);
    stand_down(&s);
}

static void test_disconnect(gconstpointer driver)
{
    struct sim_controller_config config = small(driver);
    config.n_faults = 2;
    config.faults[0] = (struct sim_controller_fault){SIM_CONTROLLER_DISCONNECT, 3, 1, 10};
    config.faults[1] = (struct sim_controller_fault){SIM_CONTROLLER_DISCONNECT, 50, 1, 10};
    struct stand s = stand_up(driver, &config);
    struct ls_step steps[60];
    struct ls_step_event events[60];
    struct ls_program program = small_program(steps, 60);
    load(s.lights, &program);
    arm(s.lights);
    grant(s.lights, 60);
    collect(s.lights, events, 60);
    for (uint32_t i = 0; i < 60; i++)
        g_assert_cmpuint(events[i].step, ==, i);
    stand_down(&s);
}

static void test_restarted(gconstpointer driver)
{
    struct sim_controller_config config = small(driver);
    config.n_faults = 1;
    config.faults[0] = (struct sim_controller_fault){SIM_CONTROLLER_REBOOT, 3, 1, 10};
    struct stand s = stand_up(driver, &config);
    struct ls_step steps[4];
    struct ls_step_event events[4];
    struct ls_program program = small_program(steps, 4);
    struct ls_lights_status status;
    struct ls_diag diag = {0};
    enum ls_err err;
    size_t n;
    load(s.lights, &program);
    arm(s.lights);
    grant(s.lights, 4);
    do
        err = ls_lights_poll(s.lights, &status, NULL, 0, &n, &diag);
    while (!err);
    g_assert_cmpint(err, ==, LS_ERR_MISMATCH);
    g_assert_nonnull(strstr(diag.text, "restarted"));
    g_assert_cmpint(ls_lights_grant(s.lights, 4, &diag), ==, LS_ERR_MISMATCH);
    load(s.lights, &program); /* begins anew */
    arm(s.lights);
    /* the count of arms is as before, but what was sent then is not of now */
    must(ls_lights_poll(s.lights, &status, events, 4, &n, &diag), &diag);
    g_assert_cmpuint(n, ==, 0);
    grant(s.lights, 4);
    status = collect(s.lights, events, 4);
    g_assert_cmpuint(status.events_lost, ==, 0);
    for (uint32_t i = 0; i < 4; i++)
        g_assert_cmpuint(events[i].step, ==, i);
    stand_down(&s);
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
    struct stand s = stand_up(driver, &config);
    struct ls_step steps[200];
    struct ls_program program = small_program(steps, 200);
    struct ls_diag diag = {0};
    g_assert_cmpint(ls_lights_load(s.lights, &program, NULL, &diag), ==, LS_ERR_MISMATCH);
    g_assert_nonnull(strstr(diag.text, "CRC"));
    g_assert_cmpint(ls_lights_arm(s.lights, &diag), ==, LS_ERR_STATE);
    load(s.lights, &program);
    stand_down(&s);
}

static void test_unprepared(gconstpointer driver)
{
    struct sim_controller_config config = small(driver);
    config.n_faults = 1;
    config.faults[0] = (struct sim_controller_fault){SIM_CONTROLLER_REFUSE, 0, 1, 0};
    struct stand s = stand_up(driver, &config);
    struct ls_step steps[4];
    struct ls_program program = small_program(steps, 4);
    struct ls_diag diag = {0};
    g_assert_cmpint(ls_lights_load(s.lights, &program, NULL, &diag), ==, LS_ERR_REFUSED);
    g_assert_nonnull(strstr(diag.text, "ready"));
    load(s.lights, &program);
    stand_down(&s);
}

static void test_stopped_load(gconstpointer driver)
{
    struct stand s = stand_up(driver, NULL);
    struct ls_step steps[4];
    struct ls_program program = small_program(steps, 4);
    struct ls_diag diag = {0};
    _Atomic bool stop = true;
    s.dome.log->hold_commit = true;
    g_assert_cmpint(ls_lights_load(s.lights, &program, &stop, &diag), ==, LS_ERR_ABORTED);
    must(ls_lights_blank(s.lights, &diag), &diag);
    s.dome.log->hold_commit = false;
    sem_post(&s.dome.log->let_commit);
    load(s.lights, &program); /* waits for the one given up, then loads */
    g_assert_cmpuint(s.dome.log->n_commits, ==, 2);
    stand_down(&s);
}

static void test_overflow(gconstpointer driver)
{
    struct sim_controller_config config = small(driver);
    config.event_queue = 16;
    struct stand s = stand_up(driver, &config);
    struct ls_step steps[40];
    struct ls_step_event events[16];
    struct ls_program program = small_program(steps, 40);
    load(s.lights, &program);
    arm(s.lights);
    grant(s.lights, 40);
    while (status_of(s.lights).state != LS_LIGHTS_DONE) /* reads no events */
        ;
    struct ls_lights_status status = collect(s.lights, events, 16);
    g_assert_cmpuint(status.events_lost, ==, 24);
    for (uint32_t i = 0; i < 16; i++)
        g_assert_cmpuint(events[i].step, ==, 24 + i);
    stand_down(&s);
}

int main(int argc, char **argv)
{
    static const struct lights_test tests[] = {
        {"wrong-unit-nobody-and-unknown-driver-are-told-apart", test_nobody, TCP},
        {"a-mute-peer-costs-one-timeout", test_mute_peer, TCP},
        {"a-silent-host-means-dark-lights", test_heartbeat},
        {"an-open-interlock-latches-until-closed-and-loaded", test_interlock},
        {"a-second-opener-is-told-that-it-is-in-use", test_second_opener, USB},
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
    };
    g_test_init(&argc, &argv, NULL);
    return run_lights_tests(tests, G_N_ELEMENTS(tests));
}
