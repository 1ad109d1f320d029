/*
 * merge_stage: the scheduler of frames and merges alone, its threads stopped where it matters.
 *
 * Linked with --wrap=ls_merge_check: the one call between "its last frame is in" and "its merge has
 * begun" waits here until the test lets it go on.
 */
#include "core/merge.h"
#include "daemon/accumulator.h"
#include "daemon/merge_stage.h"
#include "tests/daemon/capture_fixture.h"

#include <glib.h>
#include <string.h>

/* ---- the gate before a merge ---- */

static struct {
    GMutex lock;
    GCond moved;
    bool closed, reached;
} gate;

enum ls_err __real_ls_merge_check(const struct ls_merge_params *params, struct ls_diag *diag);
enum ls_err __wrap_ls_merge_check(const struct ls_merge_params *params, struct ls_diag *diag);

enum ls_err __wrap_ls_merge_check(const struct ls_merge_params *params, struct ls_diag *diag)
{
    g_mutex_lock(&gate.lock);
    gate.reached = true;
    g_cond_broadcast(&gate.moved);
    while (gate.closed)
        g_cond_wait(&gate.moved, &gate.lock);
    g_mutex_unlock(&gate.lock);
    return __real_ls_merge_check(params, diag);
}

static void close_gate(void)
{
    g_mutex_lock(&gate.lock);
    gate.closed = true;
    gate.reached = false;
    g_mutex_unlock(&gate.lock);
}

static void wait_at_gate(void)
{
    g_mutex_lock(&gate.lock);
    while (!gate.reached)
        g_cond_wait(&gate.moved, &gate.lock);
    g_mutex_unlock(&gate.lock);
}

static void open_gate(void)
{
    g_mutex_lock(&gate.lock);
    gate.closed = false;
    g_cond_broadcast(&gate.moved);
    g_mutex_unlock(&gate.lock);
}

/* ---- frames, handed in as ls-cam-0 does ---- */

struct hall {
    struct stage *stage;
    struct ls_ring *ring;
    struct ls_merge_stage *merge;
    uint32_t plan_steps[MAX_STEPS], handed;
};

/* One camera, two threads, and the fewest accumulators there are: two. The darks are in. */
static struct hall *new_hall(void)
{
    struct hall *hall = g_new0(struct hall, 1);
    struct stage *s = hall->stage = new_stage();
    prepare(s);
    size_t bytes = ls_camera_info(s->setup.cameras[0])->payload_bytes;
    g_assert_cmpint(ls_ring_create(N_STEPS, bytes, &hall->ring, &s->diag), ==, LS_OK);
    ls_ring_queue(hall->ring);
    const struct ls_merge_stage_config config = {
        .setup = &s->setup, .rings = &hall->ring, .memory_bytes = 1};
    g_assert_cmpint(ls_merge_stage_create(&config, &hall->merge, &s->diag), ==, LS_OK);
    for (uint32_t i = 0; i < s->plan.n_steps; i++)
        hall->plan_steps[i] = i;
    ls_merge_stage_arm(hall->merge, hall->plan_steps, s->plan.n_steps);
    g_assert_cmpint(ls_merge_stage_start(hall->merge, &s->diag), ==, LS_OK);
    return hall;
}

static void close_hall(struct hall *hall)
{
    ls_merge_stage_destroy(hall->merge);
    ls_ring_destroy(hall->ring);
    clear(hall->stage);
    g_free(hall);
}

static void hand_in(struct hall *hall, uint32_t step)
{
    struct stage *s = hall->stage;
    const struct ls_plan_step *p = &s->plan.steps[step];
    struct ls_camera_slots slots = ls_ring_slots(hall->ring);
    uint32_t slot = hall->handed++, width_us = s->plan.pulse_us[p->exposure];
    struct ls_bound_frame bound = {.step = step,
                                   .frame = {.slot = slot,
                                             .status = LS_FRAME_OK,
                                             .payload_bytes = FAKE_WIDTH * FAKE_HEIGHT * 2},
                                   .event = {.step = step, .width_us = width_us},
                                   .exposure_us = width_us + FAKE_OFFSET_US};
    fake_rig_draw((char *)slots.base + slots.stride * slot, step, s->conditions[p->condition].light,
                  width_us, FAKE_BLACK, bound.exposure_us);
    g_assert_cmpint(ls_ring_take(hall->ring, slot), ==, LS_OK);
    g_assert_cmpint(ls_ring_hand(hall->ring, slot), ==, LS_OK);
    g_assert_true(ls_queue_push(ls_merge_stage_inlet(hall->merge, 0), &bound));
    sem_post(ls_merge_stage_work(hall->merge));
}

static uint32_t first_step(const struct hall *hall, int light)
{
    return hall->stage->conditions[N_EXPOSURES + light].first_step;
}

static bool is_published(const struct hall *hall, int light)
{
    return ls_merge_stage_has(hall->merge, N_EXPOSURES + (uint32_t)light, 0);
}

static void hand_in_light(struct hall *hall, int light, uint32_t from)
{
    for (uint32_t i = from; i < N_EXPOSURES; i++)
        hand_in(hall, first_step(hall, light) + i);
}

static void hand_in_darks(struct hall *hall)
{
    for (uint32_t step = 0; step < FIRST_LIGHT; step++)
        hand_in(hall, step);
    ls_merge_stage_drain(hall->merge);
}

/* ---- tests ---- */

/* Light 0 is full and not yet merging, light 1 has one frame, and light 2 needs an accumulator: it
 * is light 1 that must give way, although light 0's was used longer ago. */
static void test_full_is_kept(void)
{
    struct hall *hall = new_hall();
    struct stage *s = hall->stage;
    hand_in_darks(hall);
    close_gate();
    hand_in_light(hall, 0, 0);
    wait_at_gate();
    hand_in(hall, first_step(hall, 1));
    hand_in(hall, first_step(hall, 2));
    fake_rig_wait_released(s->rig, hall->handed); /* the other thread has placed and copied both */
    open_gate();
    hand_in_light(hall, 2, 1);
    ls_merge_stage_drain(hall->merge);
    g_assert_cmpint(atomic_load(ls_merge_stage_failure(hall->merge)), ==, LS_OK);
    g_assert_true(is_published(hall, 0));
    g_assert_false(is_published(hall, 1));
    g_assert_true(is_published(hall, 2));
    for (uint32_t i = 0; i < N_EXPOSURES; i++) {
        g_assert_false(ls_merge_stage_wants(hall->merge, first_step(hall, 0) + i));
        g_assert_true(ls_merge_stage_wants(hall->merge, first_step(hall, 1) + i));
    }
    hand_in_light(hall, 1, 0); /* shot again */
    ls_merge_stage_drain(hall->merge);
    g_assert_true(is_published(hall, 1));
    g_assert_cmpint(ls_store_flush(s->store, &s->diag), ==, LS_OK);
    struct ls_takedir *take;
    g_assert_cmpint(ls_takedir_open(s->folder, &take, NULL), ==, LS_OK);
    for (uint32_t light = 0; light < 3; light++)
        check_picture(s, take, N_EXPOSURES + light, 0);
    ls_takedir_close(take);
    close_hall(hall);
}

/* However often another is filled again, whoever waits longest is next. */
static void test_who_waits_longest_is_merged_first(void)
{
    struct ls_accumulators pool;
    g_assert_cmpint(ls_accumulators_init(&pool, 3, 1, 64, 64), ==, LS_OK);
    g_assert_null(ls_accumulators_waiting(&pool));
    for (uint32_t k = 0; k < 3; k++) {
        pool.items[k].state = LS_ACCUMULATOR_MERGING;
        pool.items[k].n_bands = 2;
        pool.items[k].arrived_ns = 30 - 10 * k;
    }
    g_assert_true(ls_accumulators_waiting(&pool) == &pool.items[2]);
    pool.items[2].bands_taken = 2; /* all of it is being merged */
    g_assert_true(ls_accumulators_waiting(&pool) == &pool.items[1]);
    pool.items[1].n_bands = 0; /* its merging has not begun */
    g_assert_true(ls_accumulators_waiting(&pool) == &pool.items[0]);
    pool.items[0].state = LS_ACCUMULATOR_FILLING;
    g_assert_null(ls_accumulators_waiting(&pool));
    ls_accumulators_finish(&pool);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/merge-stage/who-waits-longest-is-merged-first",
                    test_who_waits_longest_is_merged_first);
    g_test_add_func("/merge-stage/a-full-accumulator-is-not-given-away-before-its-merge-begins",
                    test_full_is_kept);
    return g_test_run();
}
