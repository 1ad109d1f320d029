#include "tests/drivers/lights_fixture.h"

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
const struct ls_condition conditions[N_CONDITIONS] = {
    {LS_CONDITION_DARK, 0, NULL},           {LS_CONDITION_ONE, 1, led_full},
    {LS_CONDITION_ONE, 1, led_dim},         {LS_CONDITION_SPHERE, 1, led_sphere},
    {LS_CONDITION_SEGMENT, 2, led_segment}, {LS_CONDITION_LIST, 3, led_list},
};

struct sim_controller_config small(const struct driver *driver)
{
    struct sim_controller_config config = dome_small();
    config.wire = driver->wire;
    return config;
}

struct ls_lights *open_dome(const struct driver *driver, const struct dome *dome)
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

void must(enum ls_err err, const struct ls_diag *diag)
{
    if (err)
        g_test_message("%s: %s", ls_err_name(err), diag->text);
    g_assert_cmpint(err, ==, LS_OK);
}

void load(struct ls_lights *lights, const struct ls_program *program)
{
    struct ls_diag diag = {0};
    must(ls_lights_load(lights, program, NULL, &diag), &diag);
}

void arm(struct ls_lights *lights)
{
    struct ls_diag diag = {0};
    must(ls_lights_arm(lights, &diag), &diag);
}

void grant(struct ls_lights *lights, uint32_t n)
{
    struct ls_diag diag = {0};
    must(ls_lights_grant(lights, n, &diag), &diag);
}

struct ls_lights_status status_of(struct ls_lights *lights)
{
    struct ls_lights_status status;
    struct ls_diag diag = {0};
    size_t n;
    must(ls_lights_poll(lights, &status, NULL, 0, &n, &diag), &diag);
    return status;
}

struct ls_lights_status collect(struct ls_lights *lights, struct ls_step_event *events, size_t n)
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

struct ls_program small_program(struct ls_step *steps, uint32_t n)
{
    for (uint32_t i = 0; i < n; i++)
        steps[i] = (struct ls_step){.condition = i % N_CONDITIONS, .pulse_us = 100 + 50 * (i % 4)};
    return (struct ls_program){conditions, N_CONDITIONS, steps, n, 2000};
}

struct stand stand_up(const struct driver *driver, const struct sim_controller_config *config)
{
    struct sim_controller_config usual = small(driver);
    struct stand stand = {.dome = dome_start(config ? config : &usual)};
    stand.lights = open_dome(driver, &stand.dome);
    return stand;
}

void stand_down(struct stand *stand)
{
    ls_lights_close(stand->lights);
    dome_stop(&stand->dome);
}

int run_lights_tests(const struct lights_test *tests, size_t n)
{
    for (size_t d = 0; d < G_N_ELEMENTS(drivers); d++)
        for (size_t i = 0; i < n; i++) {
            if (tests[i].wires && !(tests[i].wires >> drivers[d].wire & 1))
                continue;
            char *path = g_strdup_printf("/lights/%s/%s", drivers[d].name, tests[i].name);
            g_test_add_data_func(path, &drivers[d], tests[i].run);
            g_free(path);
        }
    return g_test_run();
}
