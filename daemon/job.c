#include "daemon/job.h"

#include "daemon/realtime.h"

#include <stdio.h>

enum { TURN_FRAMES = 8 }; /* then others have theirs */

struct ticket {
    struct ls_job_pool *pool;
    struct ls_job *job; /* NULL: the thread ends */
    ls_job_send *send;
    ls_job_done *done;
    void *user;
    int calls; /* of the pool, when the step began */
    struct ls_job_result result;
};

struct ls_job_pool {
    GAsyncQueue *work;
    GThread **threads;
    unsigned n_threads;
    unsigned outstanding; /* ls-main only */
    GQueue waiting;       /* struct ticket; ls-main only */
    bool ending;          /* ls-main only */
    int calls;            /* atomic: how often somebody was woken */
    int calls_posted;     /* atomic: those ls-main has not seen yet */
};

bool ls_job_cancelled(const struct ls_job *job)
{
    return g_atomic_int_get(&job->cancelled) != 0;
}

/* Not g_main_context_invoke: it would call @function here whenever ls-main is between iterations.
 */
static void post(GSourceFunc function, gpointer data)
{
    GSource *source = g_idle_source_new();
    g_source_set_priority(source, G_PRIORITY_DEFAULT);
    g_source_set_callback(source, function, data, NULL);
    g_source_attach(source, NULL);
    g_source_unref(source);
}

/* ---- credit ---- */

bool ls_job_may_send(const struct ls_job *job)
{
    return !job->counts_credit || __atomic_load_n(&job->credit, __ATOMIC_RELAXED) > 0;
}

bool ls_job_use_credit(struct ls_job *job, uint64_t bytes)
{
    uint64_t had = __atomic_load_n(&job->credit, __ATOMIC_RELAXED);
    if (!job->counts_credit || bytes == 0)
        return false;
    while (!__atomic_compare_exchange_n(&job->credit, &had, bytes < had ? had - bytes : 0, false,
                                        __ATOMIC_RELAXED, __ATOMIC_RELAXED))
        ;
    return bytes >= had;
}

void ls_job_give_credit(struct ls_job *job, uint64_t bytes)
{
    uint64_t had = __atomic_load_n(&job->credit, __ATOMIC_RELAXED);
    while (!__atomic_compare_exchange_n(&job->credit, &had,
                                        bytes > UINT64_MAX - had ? UINT64_MAX : had + bytes, false,
                                        __ATOMIC_RELAXED, __ATOMIC_RELAXED))
        ;
}

/* ---- waiting ---- */

static gboolean wake(gpointer data)
{
    struct ls_job_pool *pool = data;
    for (struct ticket *ticket; (ticket = g_queue_pop_head(&pool->waiting));)
        g_async_queue_push(pool->work, ticket);
    g_atomic_int_add(&pool->calls_posted, -1);
    return G_SOURCE_REMOVE;
}

/* A step that began before this and found nothing has not reported yet, and sees `calls` then; or
 * it has, and waits for the source. */
static void call(struct ls_job_pool *pool)
{
    g_atomic_int_inc(&pool->calls_posted);
    g_atomic_int_inc(&pool->calls);
    post(wake, pool);
}

void ls_job_wake_others(const struct ls_job *job)
{
    if (job && job->pool)
        call(job->pool);
}

void ls_job_cancel(struct ls_job *job)
{
    g_atomic_int_set(&job->cancelled, 1);
    ls_job_wake_others(job);
}

/* False: it ends here. */
static bool park(struct ticket *ticket)
{
    struct ls_job_pool *pool = ticket->pool;
    struct ls_job_result *result = &ticket->result;
    if (pool->ending || ls_job_cancelled(ticket->job)) {
        result->err = ls_fail(&result->diag, LS_ERR_ABORTED, "cancelled by the client");
        return false;
    }
    result->err = LS_OK;
    if (ticket->calls != g_atomic_int_get(&pool->calls))
        g_async_queue_push(pool->work, ticket);
    else
        g_queue_push_tail(&pool->waiting, ticket);
    return true;
}

/* ---- steps ---- */

static gboolean report(gpointer data)
{
    struct ticket *ticket = data;
    if (ticket->result.err == LS_ERR_BUSY && park(ticket))
        return G_SOURCE_REMOVE;
    ticket->pool->outstanding--;
    ticket->done(ticket->user, ticket->job, &ticket->result);
    ls_chunk_finish(&ticket->result.chunk);
    g_free(ticket);
    return G_SOURCE_REMOVE;
}

static void step(struct ticket *ticket)
{
    struct ls_job_result *result = &ticket->result;
    ticket->calls = g_atomic_int_get(&ticket->pool->calls);
    if (ls_job_cancelled(ticket->job))
        result->err = ls_fail(&result->diag, LS_ERR_ABORTED, "cancelled by the client");
    else
        result->err =
            ticket->job->ops->step(ticket->job, &result->chunk, &result->last, &result->diag);
}

static bool send_frame(struct ticket *ticket)
{
    struct ls_job_result *result = &ticket->result;
    return ticket->send && !result->err && result->chunk.head &&
           ticket->send(ticket->user, ticket->job, &result->chunk) && !result->last;
}

static void take_turn(struct ticket *ticket)
{
    unsigned frames = 0;
    do
        step(ticket);
    while (send_frame(ticket) && ++frames < TURN_FRAMES);
}

static gpointer serve(gpointer data)
{
    struct ls_job_pool *pool = data;
    ls_give_way();
    for (;;) {
        struct ticket *ticket = g_async_queue_pop(pool->work);
        if (!ticket->job) {
            g_free(ticket);
            return NULL;
        }
        take_turn(ticket);
        post(report, ticket);
    }
}

struct ls_job_pool *ls_job_pool_create(unsigned n_threads)
{
    struct ls_job_pool *pool = g_new0(struct ls_job_pool, 1);
    pool->work = g_async_queue_new();
    g_queue_init(&pool->waiting);
    pool->n_threads = n_threads;
    pool->threads = g_new0(GThread *, n_threads);
    for (unsigned i = 0; i < n_threads; i++) {
        char name[24];
        snprintf(name, sizeof name, "ls-serve-%u", i);
        pool->threads[i] = g_thread_new(name, serve, pool);
    }
    return pool;
}

void ls_job_pool_step(struct ls_job_pool *pool, struct ls_job *job, ls_job_send *send,
                      ls_job_done *done, void *user)
{
    struct ticket *ticket = g_new0(struct ticket, 1);
    *ticket = (struct ticket){pool, job, send, done, user};
    job->pool = pool;
    pool->outstanding++;
    g_async_queue_push(pool->work, ticket);
}

void ls_job_pool_destroy(struct ls_job_pool *pool)
{
    if (!pool)
        return;
    pool->ending = true;
    for (struct ticket *ticket; (ticket = g_queue_pop_head(&pool->waiting));) {
        ticket->result.err = LS_ERR_BUSY;
        post(report, ticket);
    }
    for (unsigned i = 0; i < pool->n_threads; i++)
        g_async_queue_push(pool->work, g_new0(struct ticket, 1));
    for (unsigned i = 0; i < pool->n_threads; i++)
        g_thread_join(pool->threads[i]);
    while (pool->outstanding > 0 || g_atomic_int_get(&pool->calls_posted) > 0)
        g_main_context_iteration(NULL, TRUE);
    g_async_queue_unref(pool->work);
    g_free(pool->threads);
    g_free(pool);
}
