/* What the sequencer's thread calls between arm and stop allocates nothing. A program of its own,
 * since it puts counters in front of the C library's allocator. */
#include "drivers/lights.h"
#include "tests/drivers/dome_fixture.h"

#include <glib.h>
#include <stdlib.h>

#if defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer)
#define OWN_ALLOCATOR 1
#endif
#endif
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define OWN_ALLOCATOR 1
#endif

#ifndef OWN_ALLOCATOR
static _Atomic unsigned long allocations;

void *__libc_malloc(size_t size);
void *__libc_calloc(size_t n, size_t size);
void *__libc_realloc(void *old, size_t size);

void *malloc(size_t size)
{
    allocations++;
    return __libc_malloc(size);
}

void *calloc(size_t n, size_t size)
{
    allocations++;
    return __libc_calloc(n, size);
}

void *realloc(void *old, size_t size)
{
    allocations++;
    return __libc_realloc(old, size);
}
#endif

static void test_poll_and_grant(void)
{
#ifdef OWN_ALLOCATOR
    g_test_skip("the sanitizer has an allocator of its own");
#else
    struct sim_controller_config config = dome_small();
    struct dome dome = dome_start(&config);
    struct ls_lights_config lc = dome_address(&dome);
    struct ls_lights *lights;
    struct ls_condition dark = {LS_CONDITION_DARK, 0, NULL};
    struct ls_step steps[200];
    for (int i = 0; i < 200; i++)
        steps[i] = (struct ls_step){.pulse_us = 100};
    struct ls_program program = {&dark, 1, steps, 200, 1000};
    unsigned long before = allocations;
    enum ls_err err = ls_lights_open(&lc, &lights, NULL);
    g_assert_cmpint(err, ==, LS_OK);
    g_assert_cmpuint(allocations, >, before); /* the counter counts */
    g_assert_cmpint(ls_lights_load(lights, &program, NULL, NULL), ==, LS_OK);
    g_assert_cmpint(ls_lights_arm(lights, NULL), ==, LS_OK);
    before = allocations;
    uint32_t have = 0;
    while (!err && have < 200) {
        struct ls_lights_status status;
        struct ls_step_event events[16];
        size_t n;
        err = ls_lights_grant(lights, MIN(have + 8, 200), NULL);
        if (!err)
            err = ls_lights_poll(lights, &status, events, 16, &n, NULL);
        have += err ? 0 : (uint32_t)n;
    }
    g_assert_cmpuint(allocations, ==, before);
    g_assert_cmpint(err, ==, LS_OK);
    ls_lights_close(lights);
    dome_stop(&dome);
#endif
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/lights/modbus/poll-and-grant-allocate-nothing", test_poll_and_grant);
    return g_test_run();
}
