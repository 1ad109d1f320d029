/* credit: room counted right, and a live subject spared the flashing band. */
#include "daemon/credit.h"

#include <glib.h>

static void test_least_room(void)
{
    const struct ls_credit_camera cameras[] = {
        {.queued = 20, .settled = 7}, {.queued = 10, .settled = 8}, {.queued = 30, .settled = 2}};
    g_assert_cmpuint(ls_credit_limit(cameras, 1, 100), ==, 23);
    g_assert_cmpuint(ls_credit_limit(cameras, 2, 100), ==, 14);
    g_assert_cmpuint(ls_credit_limit(cameras, 3, 10), ==, 10);
}

static void test_ring_full(void)
{
    for (uint32_t queued = 0; queued <= LS_CREDIT_SPARE; queued++) {
        const struct ls_credit_camera camera = {.queued = queued, .settled = 7};
        g_assert_cmpuint(ls_credit_limit(&camera, 1, 100), ==, 7);
    }
}

enum { PERIOD_US = 13889, SLOTS = 32, ROOM = SLOTS - LS_CREDIT_SPARE };

static void test_slow_camera(void)
{
    g_assert_cmpuint(ls_credit_slots(32, 536000, 13889), ==, 19 + LS_CREDIT_SPARE);
    g_assert_cmpuint(ls_credit_slots(16, 536000, 13889), ==, 16);
    g_assert_cmpuint(ls_credit_slots(32, 1500000, 500000), ==, LS_CREDIT_LEAST + LS_CREDIT_SPARE);
    /* frames that come one every 27 ms, half as fast as the pulses, none too late: the first of a
     * full pipe is had before the patience of the last is over */
    g_assert_cmpuint(19 * 27000, <, 536000);
}

static const struct ls_condition kinds[] = {{.kind = LS_CONDITION_DARK},
                                            {.kind = LS_CONDITION_ONE}};

/* Lights, with @darks before them and @watch dark steps after every 50. */
static struct ls_program sequence(uint32_t lights, uint32_t darks, uint32_t watch,
                                  struct ls_step **steps)
{
    uint32_t n = 0;
    *steps = g_new0(struct ls_step, darks + lights + lights / 50 * watch + 1);
    n += darks;
    for (uint32_t i = 0; i < lights; i++) {
        (*steps)[n++].condition = 1;
        if (i % 50 == 49)
            n += watch;
    }
    return (struct ls_program){.conditions = kinds,
                               .n_conditions = 2,
                               .steps = *steps,
                               .n_steps = n,
                               .period_us = PERIOD_US};
}

static void test_still(void)
{
    struct ls_step *steps;
    const struct ls_program program = sequence(100, 0, 0, &steps);
    struct ls_credit credit;
    ls_credit_init(&credit, &program, 32, false, 0);
    g_assert_cmpuint(ls_credit_grant(&credit, 0, 0, 3, 0), ==, 3);
    g_assert_cmpuint(ls_credit_grant(&credit, 3, 3, 4, 1000), ==, 4);
    g_assert_cmpuint(ls_credit_grant(&credit, 4, 4, 2, 2000), ==, 4);
    g_free(steps);
}

struct sight {
    uint64_t first_us, last_us, begun_us, end_us; /* lit; of the flash under way; of all */
    uint32_t flashes;
};

/* Light that comes back within a period of 30 Hz is the same flash. */
static void see(struct sight *sight, uint64_t us)
{
    if (!sight->flashes || us - sight->last_us > 33334) {
        g_assert_true(!sight->flashes || us - sight->begun_us >= 333334);
        sight->begun_us = us;
        sight->flashes++;
    }
    sight->first_us = sight->first_us ? sight->first_us : us;
    sight->last_us = us;
}

/* Run a program where a slot is free again @slot_us after the one before at the earliest, and
 * @late_us after its step. */
static void play(const struct ls_program *program, uint64_t slot_us, uint64_t late_us,
                 struct sight *sight, struct ls_credit *credit)
{
    uint64_t *fired_us = g_new0(uint64_t, program->n_steps + 1), free_us = 0, us;
    uint32_t granted = 0, fired = 0, settled = 0;
    for (us = sight->end_us + 1000; fired < program->n_steps; us += 500) {
        g_assert_cmpuint(us, <, sight->end_us + 120000000);
        if (settled < fired && us >= free_us && us >= fired_us[settled] + late_us) {
            settled++;
            free_us = us + slot_us;
        }
        uint32_t limit = MIN(settled + ROOM, program->n_steps);
        granted = ls_credit_grant(credit, granted, fired, limit, us * 1000);
        g_assert_cmpuint(granted, <=, MAX(limit, granted));
        if (fired == granted || (fired && us - fired_us[fired - 1] < PERIOD_US))
            continue;
        if (program->steps[fired].condition)
            see(sight, us);
        fired_us[fired++] = us;
    }
    sight->end_us = us;
    g_free(fired_us);
}

/* A merge stage that frees a slot every 80 ms (12.5 Hz, in the middle of the band): pulses must
 * come at the planned period or after a pause, and bursts below 3 Hz. */
static void test_starved(void)
{
    static const struct {
        uint32_t darks, watch;
    } cases[] = {{0, 0}, {24, 4}, {3, 8}, {30, 2}};
    for (size_t i = 0; i < G_N_ELEMENTS(cases); i++) {
        struct ls_step *steps;
        const struct ls_program program = sequence(200, cases[i].darks, cases[i].watch, &steps);
        struct ls_credit credit;
        struct sight sight = {.end_us = 1000000};
        ls_credit_init(&credit, &program, SLOTS, true, 0);
        play(&program, 80000, 20000, &sight, &credit);
        g_assert_cmpuint(sight.flashes, >, 1);
        g_assert_cmpuint(sight.flashes, <, 20);
        g_free(steps);
    }
}

/* Frames come 20 ms after their pulse: the pauses that watches are anyway get little longer. */
static void test_fed(void)
{
    enum { LIGHTS = 400, WATCH = 4 };
    struct ls_step *steps;
    const struct ls_program program = sequence(LIGHTS, 24, WATCH, &steps);
    struct ls_credit credit;
    struct sight sight = {.end_us = 1000000};
    ls_credit_init(&credit, &program, SLOTS, true, 0);
    play(&program, 0, 20000, &sight, &credit);
    double ideal_us = (LIGHTS + (LIGHTS / 50 - 1) * WATCH) * (double)PERIOD_US;
    g_assert_cmpuint(sight.flashes, ==, LIGHTS / 50);
    g_assert_cmpfloat((double)(sight.last_us - sight.first_us), <, 1.06 * ideal_us);
    g_free(steps);
}

/* A repair is a program of its own. */
static void test_programs(void)
{
    struct ls_step *steps;
    const struct ls_program program = sequence(5, 0, 0, &steps);
    struct ls_credit credit = {0};
    struct sight sight = {.end_us = 1000000};
    for (int pass = 0; pass < 4; pass++) {
        ls_credit_init(&credit, &program, SLOTS, true, credit.started_ns);
        play(&program, 0, 20000, &sight, &credit);
    }
    g_assert_cmpuint(sight.flashes, ==, 4);
    g_free(steps);
}

static void test_slow_plan(void)
{
    struct ls_step *steps;
    struct ls_program program = sequence(100, 0, 0, &steps);
    struct ls_credit credit;
    program.period_us = 100000; /* 10 Hz, allowed by the operator */
    ls_credit_init(&credit, &program, 32, true, 0);
    g_assert_cmpuint(ls_credit_grant(&credit, 0, 0, 1, 0), ==, 1);
    g_free(steps);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/credit/the-camera-with-the-least-room-counts", test_least_room);
    g_test_add_func("/credit/ring-full-stops-credit", test_ring_full);
    g_test_add_func("/credit/a-camera-half-as-fast-as-planned-is-not-overrun", test_slow_camera);
    g_test_add_func("/credit/a-still-subject-gets-every-slot-at-once", test_still);
    g_test_add_func("/credit/a-starved-live-take-pauses-instead-of-flashing", test_starved);
    g_test_add_func("/credit/a-live-take-that-is-fed-keeps-its-rate-between-watches", test_fed);
    g_test_add_func("/credit/a-program-after-another-waits-its-pause", test_programs);
    g_test_add_func("/credit/an-allowed-slow-plan-is-not-held-back", test_slow_plan);
    return g_test_run();
}
