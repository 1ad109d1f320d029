/*
 * bind: synthetic programs with clocks, jitter and faults; the truth is known for every frame.
 *
 * A world fires steps on a controller clock and lets a camera answer on its own. Each frame's slot
 * is its index in the world, so its true step can be looked up whatever bind says of it.
 */
#include "daemon/clock.h"
#include "tests/daemon/bind_camera.h"

#include <glib.h>
#include <math.h>
#include <string.h>

enum {
    MAX_STEPS = 400,
    MAX_FRAMES = 2 * MAX_STEPS,
    POLL_US = 4000,
};

enum fault {
    NONE,
    DROPPED,    /* the pulse never reached the camera */
    LOST,       /* exposed and numbered; incomplete on arrival */
    VANISHED,   /* exposed and numbered; nothing arrived */
    DOUBLED,    /* a second, unasked exposure after the step's */
    EARLY,      /* an unasked exposure before the step's */
    EARLY_BUSY, /* as EARLY, and the camera was not ready for the step's own pulse */
    LATE,       /* arrives after its patience */
    DUPLICATE,  /* arrives twice */
    N_FAULTS
};

struct frame {
    struct ls_camera_frame frame;
    double arrives_us; /* controller time */
    int truth;         /* step, -1: nobody's */
};

struct world {
    GRand *rand;
    double camera_ppm, jitter_us;
    uint64_t epoch_us, camera_epoch;
    uint64_t next_id;
    uint32_t counter;
    bool has_counter, has_exposure, by_time;
    uint32_t n_steps;
    struct ls_step_event events[MAX_STEPS];
    double exposure_us[MAX_STEPS];
    unsigned char faults[MAX_STEPS];
    uint32_t n_frames;
    struct frame frames[MAX_FRAMES];
    struct ls_clock clock;
    /* verdicts */
    unsigned char outcome[MAX_STEPS], told[MAX_STEPS], out[MAX_FRAMES];
    uint32_t bound, missing, ambiguous, mislabeled;
};

static double gaussian(GRand *rand)
{
    double sum = 0;
    for (int i = 0; i < 12; i++)
        sum += g_rand_double(rand);
    return sum - 6;
}

static uint64_t camera_ns(const struct world *world, double us)
{
    double ns = (us - (double)world->epoch_us) * 1e3 * (1 + world->camera_ppm * 1e-6);
    return world->camera_epoch + (uint64_t)llround(ns);
}

static struct world *make_world(uint32_t n_steps)
{
    guint32 seed = g_test_rand_int();
    g_test_message("seed %u", seed);
    struct world *world = g_new0(struct world, 1);
    world->rand = g_rand_new_with_seed(seed);
    world->camera_ppm = g_rand_double_range(world->rand, -200, 200);
    world->jitter_us = 10;
    world->epoch_us = 1000000 + g_rand_int(world->rand) % 1000000;
    world->camera_epoch = 4000000000000ull + g_rand_int(world->rand);
    world->next_id = 65500; /* the 16-bit counter of the wire wraps in every test */
    world->counter = 0xfffffff0u;
    world->has_counter = world->has_exposure = world->by_time = true;
    world->n_steps = n_steps;
    return world;
}

static void free_world(struct world *world)
{
    g_rand_free(world->rand);
    g_free(world);
}

static struct frame *expose(struct world *world, double us, double exposure_us, int truth)
{
    struct frame *frame = &world->frames[world->n_frames];
    double at = us + world->jitter_us * gaussian(world->rand);
    *frame = (struct frame){.frame = {.slot = world->n_frames,
                                      .status = LS_FRAME_OK,
                                      .frame_id = world->next_id++,
                                      .camera_ns = camera_ns(world, at),
                                      .trigger_counter = world->counter++,
                                      .chunk_exposure_us = exposure_us},
                            .arrives_us = us + 6000 + 2000 * g_rand_double(world->rand),
                            .truth = truth};
    world->n_frames++;
    return frame;
}

static void lose(struct frame *frame)
{
    frame->frame.status = LS_FRAME_LOST;
    frame->frame.frame_id = 7; /* stale */
    frame->frame.camera_ns = 12345;
    frame->arrives_us += RETENTION_US / 2;
}

static void expose_step(struct world *world, uint32_t i)
{
    double us = (double)world->events[i].us, exposure = world->exposure_us[i];
    /* Anywhere the camera may have been ready again; also inside the neighbours' windows. */
    double aside = g_rand_double_range(world->rand, 2500, PERIOD_US - 2500);
    int step = (int)i;
    switch ((enum fault)world->faults[i]) {
    case DROPPED:
        break;
    case LOST:
        lose(expose(world, us, exposure, step));
        break;
    case VANISHED:
        expose(world, us, exposure, step);
        world->n_frames--;
        break;
    case DOUBLED:
        expose(world, us, exposure, step);
        expose(world, us + aside, exposure, -1);
        break;
    case EARLY:
        expose(world, us - aside, exposure, -1);
        expose(world, us, exposure, step);
        break;
    case EARLY_BUSY:
        expose(world, us - aside, exposure, -1);
        break;
    case LATE:
        expose(world, us, exposure, step)->arrives_us += 3 * RETENTION_US;
        break;
    case DUPLICATE: {
        struct frame copy = *expose(world, us, exposure, step);
        copy.frame.slot = world->n_frames;
        copy.arrives_us += 100;
        world->frames[world->n_frames++] = copy;
        break;
    }
    default:
        expose(world, us, exposure, step);
    }
}

/* Steps at the period with pauses now and then; brackets of three exposures. */
static void run_world(struct world *world)
{
    static const double bracket[] = {500, 2000, 8000};
    double us = (double)world->epoch_us + 500000;
    for (uint32_t i = 0; i < world->n_steps; i++) {
        world->exposure_us[i] = bracket[i % 3] + 13.7;
        world->events[i] = (struct ls_step_event){
            .step = i, .width_us = (uint32_t)bracket[i % 3], .us = (uint64_t)us};
        us += PERIOD_US + (g_rand_int_range(world->rand, 0, 40) == 0 ? 200000 : 0);
    }
    for (uint32_t i = 0; i < world->n_steps; i++)
        expose_step(world, i);
}

static int by_arrival(const void *a, const void *b)
{
    const struct frame *fa = a, *fb = b;
    return (fa->arrives_us > fb->arrives_us) - (fa->arrives_us < fb->arrives_us);
}

/* Warm-up: pulses with known frames before step 0 give the clock and the anchor. */
static void warm_up(struct world *world, struct ls_bind *bind)
{
    ls_clock_init(&world->clock, 1e9, 2000);
    struct ls_camera_frame frame = {0};
    for (int i = 0; i < 5; i++) {
        double us = (double)world->epoch_us + 20000.0 * (i + 1) + 3000 * i * i;
        frame.camera_ns = camera_ns(world, us + world->jitter_us * gaussian(world->rand));
        uint64_t ns = (uint64_t)us * 1000;
        g_assert_cmpint(ls_clock_add(&world->clock, frame.camera_ns, ns, ns), ==, LS_OK);
    }
    frame.frame_id = 65499;
    frame.trigger_counter = 0xffffffefu;
    ls_bind_anchor(bind, &frame);
}

static void note(struct world *world, const struct ls_bind_verdict *verdict)
{
    if (verdict->slot != LS_BIND_NO_SLOT) {
        g_assert_cmpuint(world->out[verdict->frame.slot]++, ==, 0);
        g_assert_true((verdict->step == LS_BIND_NO_STEP) == (verdict->outcome == LS_BIND_OPEN));
    }
    if (verdict->step == LS_BIND_NO_STEP)
        return;
    g_assert_cmpuint(world->told[verdict->step]++, ==, 0);
    world->outcome[verdict->step] = (unsigned char)verdict->outcome;
    world->missing += verdict->outcome == LS_BIND_MISSING;
    world->ambiguous += verdict->outcome == LS_BIND_AMBIGUOUS;
    if (verdict->outcome != LS_BIND_BOUND)
        return;
    world->bound++;
    g_assert_cmpuint(verdict->slot, !=, LS_BIND_NO_SLOT);
    uint64_t ns = verdict->event.us * 1000;
    if (world->by_time)
        g_assert_cmpint(ls_clock_add(&world->clock, verdict->frame.camera_ns, ns, ns), ==, LS_OK);
}

/* Joins tickets with the truth: the number that must be 0. */
static uint32_t count_mislabeled(const struct world *world, const int *slot_of_step)
{
    uint32_t n = 0;
    for (uint32_t i = 0; i < world->n_steps; i++)
        for (uint32_t k = 0; slot_of_step[i] >= 0 && k < world->n_frames; k++)
            if (world->frames[k].frame.slot == (uint32_t)slot_of_step[i])
                n += world->frames[k].truth != (int)i;
    return n;
}

static void take_verdicts(struct world *world, struct ls_bind *bind, int *slot_of_step)
{
    struct ls_bind_verdict verdict;
    while (ls_bind_next(bind, &verdict)) {
        note(world, &verdict);
        if (verdict.outcome == LS_BIND_BOUND)
            slot_of_step[verdict.step] = (int)verdict.slot;
    }
}

/* Play the world in arrival order, polls between; check what every run must satisfy. */
static void play(struct world *world, int *slot_of_step)
{
    struct ls_bind *bind = NULL;
    struct ls_bind_config config =
        bind_camera(world->by_time, world->has_counter, world->has_exposure);
    g_assert_cmpint(ls_bind_create(&config, MAX_STEPS, MAX_FRAMES, &bind), ==, LS_OK);
    warm_up(world, bind);
    ls_bind_arm(bind, world->n_steps);
    run_world(world);
    qsort(world->frames, world->n_frames, sizeof *world->frames, by_arrival);
    for (uint32_t i = 0; i < world->n_steps; i++)
        slot_of_step[i] = -1;
    uint32_t event = 0, frame = 0;
    double end = (double)world->events[world->n_steps - 1].us + 10 * RETENTION_US;
    for (double us = (double)world->epoch_us; us < end; us += POLL_US) {
        while (frame < world->n_frames && world->frames[frame].arrives_us <= us) {
            const struct ls_camera_frame *f = &world->frames[frame++].frame;
            double mapped = ls_clock_map(&world->clock, f->camera_ns) / 1e3;
            g_assert_cmpint(ls_bind_frame(bind, f, mapped, 0), ==, LS_OK);
            if (g_rand_boolean(world->rand))
                take_verdicts(world, bind, slot_of_step);
        }
        /* every tenth poll the controller itself is late with what it reports */
        double known_us = g_rand_int_range(world->rand, 0, 10) ? us : us - 8000;
        for (; event < world->n_steps && (double)world->events[event].us <= known_us; event++)
            g_assert_cmpint(ls_bind_event(bind, &world->events[event], world->exposure_us[event]),
                            ==, LS_OK);
        ls_bind_until(bind, (uint64_t)us);
        take_verdicts(world, bind, slot_of_step);
    }
    g_assert_cmpuint(ls_bind_settled(bind), ==, world->n_steps);
    g_assert_cmpuint(ls_bind_pending(bind), ==, 0);
    for (uint32_t i = 0; i < world->n_steps; i++)
        g_assert_cmpuint(world->told[i], ==, 1);
    for (uint32_t i = 0; i < world->n_frames; i++)
        g_assert_cmpuint(world->out[world->frames[i].frame.slot], ==, 1);
    world->mislabeled = count_mislabeled(world, slot_of_step);
    g_assert_cmpuint(world->mislabeled, ==, 0);
    ls_bind_destroy(bind);
}

static struct world *play_fault(enum fault fault, uint32_t at, uint32_t n_steps)
{
    int slots[MAX_STEPS];
    struct world *world = make_world(n_steps);
    world->faults[at] = (unsigned char)fault;
    play(world, slots);
    return world;
}

static void test_clean(void)
{
    struct world *world = play_fault(NONE, 0, 300);
    g_assert_cmpuint(world->bound, ==, 300);
    free_world(world);
}

static void expect_one_missing(enum fault fault, uint32_t at)
{
    struct world *world = play_fault(fault, at, 60);
    g_assert_cmpuint(world->outcome[at], ==, LS_BIND_MISSING);
    g_assert_cmpuint(world->bound, ==, 59);
    free_world(world);
}

static void test_dropped(void)
{
    expect_one_missing(DROPPED, 0);
    expect_one_missing(DROPPED, 30);
    expect_one_missing(DROPPED, 59);
}

static void test_lost(void)
{
    expect_one_missing(LOST, 0);
    expect_one_missing(LOST, 30);
    expect_one_missing(VANISHED, 30);
}

static void test_lost_last(void)
{
    expect_one_missing(LOST, 59);
    expect_one_missing(VANISHED, 59);
}

static void test_late(void)
{
    expect_one_missing(LATE, 30);
    expect_one_missing(LATE, 59);
}

static void test_duplicate(void)
{
    struct world *world = play_fault(DUPLICATE, 30, 60);
    g_assert_cmpuint(world->bound, ==, 60);
    free_world(world);
}

/* An unasked exposure makes its neighbours ambiguous, never wrong, and only them. */
static void test_extra(void)
{
    for (int round = 0; round < 50; round++) {
        struct world *world = play_fault(round % 2 ? DOUBLED : EARLY, 30, 60);
        g_assert_cmpuint(world->ambiguous, >=, 1);
        g_assert_cmpuint(world->bound, >=, 57);
        free_world(world);
    }
}

static void test_early_busy(void)
{
    for (int round = 0; round < 50; round++) {
        struct world *world = play_fault(EARLY_BUSY, 30, 60);
        g_assert_cmpuint(world->outcome[30], !=, LS_BIND_BOUND);
        g_assert_cmpuint(world->bound, >=, 57);
        free_world(world);
    }
}

static void test_mixture(void)
{
    int slots[MAX_STEPS];
    int rounds = g_getenv("LS_TEST_FULL") ? 3000 : 150;
    for (int round = 0; round < rounds; round++) {
        struct world *world = make_world(MAX_STEPS / 2);
        world->has_counter = g_rand_boolean(world->rand);
        world->has_exposure = g_rand_boolean(world->rand);
        double share = round % 3 == 0 ? 0.3 : 0.03;
        for (uint32_t i = 0; i < world->n_steps; i++)
            if (g_rand_double(world->rand) < share)
                world->faults[i] = (unsigned char)g_rand_int_range(world->rand, 1, N_FAULTS);
        play(world, slots);
        /* it must not be safe by binding nothing */
        g_assert_cmpuint(world->bound, >, world->n_steps / (share > 0.1 ? 8 : 2));
        free_world(world);
    }
}

static void test_no_counter(void)
{
    int slots[MAX_STEPS];
    struct world *world = make_world(100);
    world->has_counter = world->has_exposure = false;
    world->faults[20] = DROPPED;
    world->faults[50] = LOST;
    world->faults[51] = DROPPED;
    play(world, slots);
    g_assert_cmpuint(world->bound, ==, 97);
    free_world(world);
}

/* The checker itself: a ticket given to the neighbour must be counted. */
static void test_corrupted_ticket(void)
{
    int slots[MAX_STEPS];
    struct world *world = make_world(60);
    play(world, slots);
    g_assert_cmpuint(count_mislabeled(world, slots), ==, 0);
    slots[17] = slots[18];
    g_assert_cmpuint(count_mislabeled(world, slots), ==, 1);
    free_world(world);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/bind/every-frame-finds-its-step", test_clean);
    g_test_add_func("/bind/a-dropped-pulse-is-missing-and-nothing-else", test_dropped);
    g_test_add_func("/bind/a-lost-frame-is-missing-and-nothing-else", test_lost);
    g_test_add_func("/bind/a-lost-last-frame-is-found-by-patience", test_lost_last);
    g_test_add_func("/bind/a-late-frame-is-discarded", test_late);
    g_test_add_func("/bind/a-duplicate-is-discarded", test_duplicate);
    g_test_add_func("/bind/an-unasked-exposure-makes-neighbours-ambiguous", test_extra);
    g_test_add_func("/bind/an-exposure-before-its-pulse-is-not-bound", test_early_busy);
    g_test_add_func("/bind/no-mixture-of-faults-mislabels", test_mixture);
    g_test_add_func("/bind/a-camera-without-counter-is-bound-by-time-and-ids", test_no_counter);
    g_test_add_func("/bind/a-corrupted-ticket-is-detected", test_corrupted_ticket);
    return g_test_run();
}
