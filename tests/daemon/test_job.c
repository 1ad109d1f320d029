/* jobs: who waits for what another makes holds no thread, is woken, and can be cancelled. */
#include "daemon/field_maps.h"
#include "daemon/job.h"
#include "tests/daemon/full_take.h"

#include <stdlib.h>
#include <sys/resource.h>
#include <unistd.h>

enum { THREADS = 2, WAITERS = 6, GIVE_UP_US = 20000000 };

/* One made thing, which nobody has before the maker is let go. */
struct hall {
    struct ls_job_pool *pool;
    GMutex lock;
    GCond changed;
    bool let_go, made, called;
    int64_t deadline_us;
};

struct guest {
    struct ls_job job;
    struct hall *hall;
    struct ls_field_source *source; /* of those who ask for maps */
    int steps;                      /* atomic */
    int niceness;                   /* of the thread that stepped it */
    bool done;                      /* ls-main */
    enum ls_err err;
};

static void enter(struct hall *hall, gconstpointer data)
{
    g_main_context_default(); /* as the daemon has it before its threads */
    g_mutex_init(&hall->lock);
    g_cond_init(&hall->changed);
    hall->pool = ls_job_pool_create(THREADS);
    hall->deadline_us = g_get_monotonic_time() + GIVE_UP_US;
}

static void leave(struct hall *hall, gconstpointer data)
{
    ls_job_pool_destroy(hall->pool);
    g_mutex_clear(&hall->lock);
    g_cond_clear(&hall->changed);
}

static void let_go(struct hall *hall)
{
    g_mutex_lock(&hall->lock);
    hall->let_go = true;
    g_cond_broadcast(&hall->changed);
    g_mutex_unlock(&hall->lock);
}

static enum ls_err make(struct ls_job *job, struct ls_chunk *chunk, bool *last,
                        struct ls_diag *diag)
{
    struct hall *hall = ((struct guest *)job)->hall;
    g_mutex_lock(&hall->lock);
    while (!hall->let_go)
        g_cond_wait(&hall->changed, &hall->lock);
    hall->made = true;
    g_mutex_unlock(&hall->lock);
    ls_job_wake_others(job);
    return LS_OK;
}

static enum ls_err need(struct ls_job *job, struct ls_chunk *chunk, bool *last,
                        struct ls_diag *diag)
{
    struct guest *guest = (struct guest *)job;
    g_mutex_lock(&guest->hall->lock);
    bool made = guest->hall->made;
    g_mutex_unlock(&guest->hall->lock);
    g_atomic_int_inc(&guest->steps);
    return made ? LS_OK : ls_fail(diag, LS_ERR_BUSY, "not yet");
}

static enum ls_err look_and_linger(struct ls_job *job, struct ls_chunk *chunk, bool *last,
                                   struct ls_diag *diag)
{
    struct guest *guest = (struct guest *)job;
    struct hall *hall = guest->hall;
    g_mutex_lock(&hall->lock);
    bool made = hall->made;
    g_atomic_int_inc(&guest->steps);
    while (!made && !hall->called)
        g_cond_wait(&hall->changed, &hall->lock);
    g_mutex_unlock(&hall->lock);
    return made ? LS_OK : ls_fail(diag, LS_ERR_BUSY, "not yet");
}

static enum ls_err need_nothing(struct ls_job *job, struct ls_chunk *chunk, bool *last,
                                struct ls_diag *diag)
{
    return LS_OK;
}

static enum ls_err need_maps(struct ls_job *job, struct ls_chunk *chunk, bool *last,
                             struct ls_diag *diag)
{
    struct guest *guest = (struct guest *)job;
    const struct ls_field_map *map;
    g_atomic_int_inc(&guest->steps);
    return ls_field_maps_get(guest->source, LS_MAP_LINEAR, 1, job, &map, diag);
}

static enum ls_err see_niceness(struct ls_job *job, struct ls_chunk *chunk, bool *last,
                                struct ls_diag *diag)
{
    ((struct guest *)job)->niceness = getpriority(PRIO_PROCESS, (id_t)gettid());
    return LS_OK;
}

static const struct ls_job_ops sees_niceness = {"niceness", see_niceness, NULL},
                               makes = {"make", make, NULL}, needs = {"need", need, NULL},
                               needs_nothing = {"nothing", need_nothing, NULL},
                               lingers = {"linger", look_and_linger, NULL},
                               needs_maps = {"maps", need_maps, NULL};

static void on_done(void *user, struct ls_job *job, struct ls_job_result *result)
{
    struct guest *guest = user;
    guest->done = true;
    guest->err = result->err;
}

static void send(struct hall *hall, struct guest *guest, const struct ls_job_ops *ops)
{
    guest->job.ops = ops;
    guest->hall = hall;
    ls_job_pool_step(hall->pool, &guest->job, NULL, on_done, guest);
}

/* Only the watchdog ends an endless wait. */
static gboolean on_watchdog(gpointer data)
{
    return G_SOURCE_CONTINUE;
}

static void await(struct hall *hall, struct guest *guest, enum ls_err err)
{
    guint watchdog = g_timeout_add(1000, on_watchdog, NULL);
    while (!guest->done) {
        g_assert_cmpint(g_get_monotonic_time(), <, hall->deadline_us);
        g_main_context_iteration(NULL, TRUE);
    }
    g_source_remove(watchdog);
    g_assert_cmpint(guest->err, ==, err);
}

/* Until it has been stepped and has nothing to go on with. */
static void await_step(struct hall *hall, struct guest *guest)
{
    while (g_atomic_int_get(&guest->steps) == 0) {
        g_assert_cmpint(g_get_monotonic_time(), <, hall->deadline_us);
        g_main_context_iteration(NULL, FALSE);
    }
}

static void who_waits_holds_no_thread(struct hall *hall, gconstpointer data)
{
    struct guest maker = {0}, waiter[WAITERS] = {{{0}}}, other = {0};
    send(hall, &maker, &makes);
    for (int i = 0; i < WAITERS; i++)
        send(hall, &waiter[i], &needs);
    send(hall, &other, &needs_nothing);
    await(hall, &other, LS_OK); /* behind six that wait, beside one that works */
    g_assert_false(maker.done);
    let_go(hall);
    await(hall, &maker, LS_OK);
    for (int i = 0; i < WAITERS; i++)
        await(hall, &waiter[i], LS_OK);
}

static void who_waits_is_not_stepped_for_nothing(struct hall *hall, gconstpointer data)
{
    struct guest maker = {0}, waiter = {0}, other[20] = {{{0}}};
    send(hall, &maker, &makes);
    send(hall, &waiter, &needs);
    await_step(hall, &waiter);
    for (int i = 0; i < 20; i++) {
        send(hall, &other[i], &needs_nothing);
        await(hall, &other[i], LS_OK);
    }
    g_assert_cmpint(g_atomic_int_get(&waiter.steps), ==, 1);
    let_go(hall);
    await(hall, &waiter, LS_OK);
    g_assert_cmpint(waiter.steps, ==, 2);
    await(hall, &maker, LS_OK);
}

static void who_waits_can_be_cancelled(struct hall *hall, gconstpointer data)
{
    struct guest maker = {0}, waiter[2] = {{{0}}};
    send(hall, &maker, &makes);
    send(hall, &waiter[0], &needs);
    send(hall, &waiter[1], &needs);
    await_step(hall, &waiter[1]);
    ls_job_cancel(&waiter[0].job);
    await(hall, &waiter[0], LS_ERR_ABORTED);
    g_assert_false(waiter[1].done || maker.done);
    let_go(hall);
    await(hall, &waiter[1], LS_OK);
    await(hall, &maker, LS_OK);
}

static void who_waits_when_the_pool_ends_is_told(struct hall *hall, gconstpointer data)
{
    struct guest waiter[WAITERS] = {{{0}}};
    for (int i = 0; i < WAITERS; i++)
        send(hall, &waiter[i], &needs);
    await_step(hall, &waiter[WAITERS - 1]);
    ls_job_pool_destroy(hall->pool);
    hall->pool = NULL;
    for (int i = 0; i < WAITERS; i++) {
        g_assert_true(waiter[i].done);
        g_assert_cmpint(waiter[i].err, ==, LS_ERR_ABORTED);
    }
}

/* The waiter has looked in vain; the maker is done and everybody called before it says so. */
static void no_call_is_lost(struct hall *hall, gconstpointer data)
{
    struct guest maker = {0}, waiter = {0};
    send(hall, &waiter, &lingers);
    await_step(hall, &waiter);
    let_go(hall);
    send(hall, &maker, &makes);
    await(hall, &maker, LS_OK);
    g_mutex_lock(&hall->lock);
    hall->called = true;
    g_cond_broadcast(&hall->changed);
    g_mutex_unlock(&hall->lock);
    await(hall, &waiter, LS_OK);
    g_assert_cmpint(waiter.steps, ==, 2);
}

/* Whoever is second waits for the first; whether there is a second in time is the scheduler's to
 * say, so it is tried until there was. */
static void requests_for_maps_of_one_take_wait_so(struct hall *hall, gconstpointer data)
{
    static const struct full_take_options plain;
    struct full_take *take = make_full_take(&plain);
    int waited = 0;
    for (int round = 0; waited == 0; round++) {
        struct guest guest[3] = {{{0}}};
        struct ls_field_source *source = NULL;
        g_assert_cmpint(ls_field_source_open(take->root, take->id, 0, &source, NULL), ==, LS_OK);
        for (int i = 0; i < 3; i++) {
            guest[i].source = source;
            send(hall, &guest[i], &needs_maps);
        }
        for (int i = 0; i < 3; i++) {
            await(hall, &guest[i], LS_OK);
            waited += guest[i].steps > 1;
        }
        ls_field_source_close(source);
        g_assert_cmpint(round, <, 100);
    }
    full_take_free(take);
}

/* At a tenth of the weight of who merges: 16 clients beside a take at rate cost it no frame. */
static void who_serves_gives_way(struct hall *hall, gconstpointer data)
{
    struct guest guest = {{0}};
    int before = getpriority(PRIO_PROCESS, (id_t)gettid());
    send(hall, &guest, &sees_niceness);
    await(hall, &guest, LS_OK);
    g_assert_cmpint(guest.niceness, ==, MAX(before, 10));
    g_assert_cmpint(getpriority(PRIO_PROCESS, (id_t)gettid()), ==, before);
}

#define TEST(name, function) g_test_add("/job/" name, struct hall, NULL, enter, function, leave)

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    TEST("who-waits-holds-no-thread", who_waits_holds_no_thread);
    TEST("who-waits-is-not-stepped-for-nothing", who_waits_is_not_stepped_for_nothing);
    TEST("who-waits-can-be-cancelled", who_waits_can_be_cancelled);
    TEST("who-waits-when-the-pool-ends-is-told", who_waits_when_the_pool_ends_is_told);
    TEST("who-serves-gives-way", who_serves_gives_way);
    TEST("no-call-is-lost", no_call_is_lost);
    TEST("requests-for-maps-of-one-take-wait-so", requests_for_maps_of_one_take_wait_so);
    return g_test_run();
}
