/* credit: room counted right, and a live subject spared the flashing band. */
#include "daemon/credit.h"

#include <glib.h>

static void test_least_room(void)
{
    const struct ls_credit_camera cameras[] = {{.queued = 20, .settled = 7, .window = 99},
                                               {.queued = 10, .settled = 8, .window = 99},
                                               {.queued = 30, .settled = 2, .window = 99},
                                               {.queued = 30, .settled = 4, .window = 3}};
    g_assert_cmpuint(ls_credit_limit(cameras, 1, 100), ==, 23);
    g_assert_cmpuint(ls_credit_limit(cameras, 2, 100), ==, 14);
    g_assert_cmpuint(ls_credit_limit(cameras, 3, 10), ==, 10);
    g_assert_cmpuint(ls_credit_limit(cameras, 4, 100), ==, 7);
}

static void test_ring_full(void)
{
    for (uint32_t queued = 0; queued <= LS_CREDIT_SPARE; queued++) {
        const struct ls_credit_camera camera = {.queued = queued, .settled = 7, .window = 99};
        g_assert_cmpuint(ls_credit_limit(&camera, 1, 100), ==, 7);
    }
}

enum { PERIOD_US = 13889, SLOTS = 32, ROOM = SLOTS - LS_CREDIT_SPARE };

static void test_first_window(void)
{
    g_assert_cmpuint(ls_credit_first_window(536000, PERIOD_US), ==, 19);
    g_assert_cmpuint(ls_credit_first_window(1500000, 500000), ==, LS_CREDIT_LEAST);
}

static void test_window(void)
{
    g_assert_cmpuint(ls_credit_window(536000, 10, 268000), ==, 10); /* as it should be */
    g_assert_cmpuint(ls_credit_window(536000, 10, 536000), ==, 5);
    g_assert_cmpuint(ls_credit_window(536000, 1, 20000), ==, 13);
    g_assert_cmpuint(ls_credit_window(536000, 1, 5000000), ==, 1); /* never none */
    g_assert_cmpuint(ls_credit_window(536000, 5, 0), >, 1000);
    g_assert_cmpuint(ls_credit_window(UINT32_MAX * 100ull, UINT32_MAX, 1), ==, UINT32_MAX);
}

/* A camera that is @away_us far and gives its frames one after the other, each after between half
 * and one and a half @serve_us. */
struct served {
    double away_us, serve_us;
    /* results */
    double latency_us; /* the longest, once the first window is over */
    double period_us;  /* mean, from then on */
};

static void serve(struct served *how, double patience_us, GRand *rand)
{
    enum { STEPS = 600, SKIP = 60 };
    double fired_us[STEPS], here_us[STEPS], busy_us = 0, us = 0;
    uint32_t under_way[STEPS], fired = 0, settled = 0, granted = 0;
    struct ls_credit_camera camera = {
        .queued = SLOTS, .window = ls_credit_first_window((uint64_t)patience_us, PERIOD_US)};
    struct ls_credit credit = {0};
    for (; settled < STEPS; us += 500) {
        while (settled < fired && here_us[settled] <= us) {
            double latency_us = here_us[settled] - fired_us[settled];
            how->latency_us = MAX(how->latency_us, settled < SKIP ? 0 : latency_us);
            camera.window =
                ls_credit_window((uint64_t)patience_us, under_way[settled], (uint64_t)latency_us);
            camera.settled = ++settled;
        }
        uint32_t limit = ls_credit_limit(&camera, 1, STEPS);
        granted = ls_credit_grant(&credit, granted, fired, limit, camera.window, (uint64_t)us);
        if (fired == granted || (fired && us - fired_us[fired - 1] < PERIOD_US))
            continue;
        fired_us[fired] = us;
        busy_us = MAX(busy_us, us) + how->serve_us * g_rand_double_range(rand, 0.5, 1.5);
        here_us[fired] = busy_us + how->away_us;
        under_way[fired] = fired + 1 - settled;
        fired++;
    }
    how->period_us = (fired_us[STEPS - 1] - fired_us[SKIP]) / (STEPS - 1 - SKIP);
}

/* However slow, frames come before they pile up, and at nearly the rate they can come at. */
static void test_served(void)
{
    const double patience_us = 540000;
    guint32 seed = g_test_rand_int();
    GRand *rand = g_rand_new_with_seed(seed);
    g_test_message("seed %u", seed);
    for (int i = 0; i < 200; i++) {
        struct served how = {.away_us = g_rand_double_range(rand, 2000, 40000),
                             .serve_us = g_rand_double_range(rand, 1000, 80000)};
        serve(&how, patience_us, rand);
        g_test_message("%.0f ms away, %.0f ms a frame: at most %.0f ms late, one in %.0f ms",
                       how.away_us / 1e3, how.serve_us / 1e3, how.latency_us / 1e3,
                       how.period_us / 1e3);
        /* a window measured at frames twice as quick as the mean, then all half as slow again:
         * three times half of the patience, and the way */
        g_assert_cmpfloat(how.latency_us, <, 1.5 * patience_us + how.away_us);
        /* a tick of 0.5 ms a period; windows of two or three run dry now and then */
        g_assert_cmpfloat(how.period_us, <, 1.25 * MAX(how.serve_us, PERIOD_US + 500));
    }
    g_rand_free(rand);
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
    g_assert_cmpuint(ls_credit_grant(&credit, 0, 0, 3, 3, 0), ==, 3);
    g_assert_cmpuint(ls_credit_grant(&credit, 3, 3, 4, 1, 1000), ==, 4);
    g_assert_cmpuint(ls_credit_grant(&credit, 4, 4, 2, 9, 2000), ==, 4);
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
 * @late_us after its step, and no more than @window steps may be under way. */
static void play(const struct ls_program *program, uint64_t slot_us, uint64_t late_us,
                 uint32_t window, struct sight *sight, struct ls_credit *credit)
{
    uint64_t *fired_us = g_new0(uint64_t, program->n_steps + 1), free_us = 0, us;
    uint32_t granted = 0, fired = 0, settled = 0;
    for (us = sight->end_us + 1000; fired < program->n_steps; us += 500) {
        g_assert_cmpuint(us, <, sight->end_us + 120000000);
        if (settled < fired && us >= free_us && us >= fired_us[settled] + late_us) {
            settled++;
            free_us = us + slot_us;
        }
        uint32_t limit = MIN(settled + MIN(ROOM, window), program->n_steps);
        granted = ls_credit_grant(credit, granted, fired, limit, window, us * 1000);
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
        play(&program, 80000, 20000, SLOTS, &sight, &credit);
        g_assert_cmpuint(sight.flashes, >, 1);
        g_assert_cmpuint(sight.flashes, <, 20);
        g_free(steps);
    }
}

/* A network that lets few steps be under way makes short bursts, not none and not a flicker. */
static void test_narrow(void)
{
    for (uint32_t window = 1; window < 12; window += 3) {
        struct ls_step *steps;
        const struct ls_program program = sequence(60, 3, 8, &steps);
        struct ls_credit credit;
        struct sight sight = {.end_us = 1000000};
        ls_credit_init(&credit, &program, SLOTS, true, 0);
        play(&program, 90000, 20000, window, &sight, &credit);
        g_assert_cmpuint(sight.flashes, >=, 60 / window);
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
    play(&program, 0, 20000, SLOTS, &sight, &credit);
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
        play(&program, 0, 20000, SLOTS, &sight, &credit);
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
    g_assert_cmpuint(ls_credit_grant(&credit, 0, 0, 1, 9, 0), ==, 1);
    g_free(steps);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/credit/the-camera-with-the-least-room-counts", test_least_room);
    g_test_add_func("/credit/ring-full-stops-credit", test_ring_full);
    g_test_add_func("/credit/before-any-frame-they-are-expected-as-planned", test_first_window);
    g_test_add_func("/credit/the-window-is-what-is-served-in-half-of-a-patience", test_window);
    g_test_add_func("/credit/slow-or-far-cameras-are-not-overrun-and-not-starved", test_served);
    g_test_add_func("/credit/a-still-subject-gets-every-slot-at-once", test_still);
    g_test_add_func("/credit/a-starved-live-take-pauses-instead-of-flashing", test_starved);
    g_test_add_func("/credit/a-narrow-window-makes-short-bursts-of-a-live-take", test_narrow);
    g_test_add_func("/credit/a-live-take-that-is-fed-keeps-its-rate-between-watches", test_fed);
    g_test_add_func("/credit/a-program-after-another-waits-its-pause", test_programs);
    g_test_add_func("/credit/an-allowed-slow-plan-is-not-held-back", test_slow_plan);
    return g_test_run();
}
