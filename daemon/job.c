#include "daemon/job.h"

#include <stdio.h>

struct ticket {
    struct ls_job_pool *pool;
    struct ls_job *job; /* NULL: the thread ends */
    ls_job_done *done;
    void *user;
    struct ls_job_result result;
};

struct ls_job_pool {
    GAsyncQueue *work;
    GThread **threads;
    unsigned n_threads;
    unsigned outstanding; /* ls-main only */
};

void ls_job_cancel(struct ls_job *job)
{
    g_atomic_int_set(&job->cancelled, 1);
}

bool ls_job_cancelled(const struct ls_job *job)
{
    return g_atomic_int_get(&job->cancelled) != 0;
}

static gboolean report(gpointer data)
{
    struct ticket *ticket = data;
    ticket->pool->outstanding--;
    ticket->done(ticket->user, ticket->job, &ticket->result);
    ls_chunk_finish(&ticket->result.chunk);
    g_free(ticket);
    return G_SOURCE_REMOVE;
}

static void step(struct ticket *ticket)
{
    struct ls_job_result *result = &ticket->result;
    if (ls_job_cancelled(ticket->job))
        result->err = ls_fail(&result->diag, LS_ERR_ABORTED, "cancelled by the client");
    else
        result->err =
            ticket->job->ops->step(ticket->job, &result->chunk, &result->last, &result->diag);
}

/* Not g_main_context_invoke: it would call report here whenever ls-main is between iterations. */
static void post(struct ticket *ticket)
{
    GSource *source = g_idle_source_new();
    g_source_set_priority(source, G_PRIORITY_DEFAULT);
    g_source_set_callback(source, report, ticket, NULL);
    g_source_attach(source, NULL);
    g_source_unref(source);
}

static gpointer serve(gpointer data)
{
    struct ls_job_pool *pool = data;
    for (;;) {
        struct ticket *ticket = g_async_queue_pop(pool->work);
        if (!ticket->job) {
            g_free(ticket);
            return NULL;
        }
        step(ticket);
        post(ticket);
    }
}

struct ls_job_pool *ls_job_pool_create(unsigned n_threads)
{
    struct ls_job_pool *pool = g_new0(struct ls_job_pool, 1);
    pool->work = g_async_queue_new();
    pool->n_threads = n_threads;
    pool->threads = g_new0(GThread *, n_threads);
    for (unsigned i = 0; i < n_threads; i++) {
        char name[24];
        snprintf(name, sizeof name, "ls-serve-%u", i);
        pool->threads[i] = g_thread_new(name, serve, pool);
    }
    return pool;
}

void ls_job_pool_step(struct ls_job_pool *pool, struct ls_job *job, ls_job_done *done, void *user)
{
    struct ticket *ticket = g_new0(struct ticket, 1);
    *ticket = (struct ticket){.pool = pool, .job = job, .done = done, .user = user};
    pool->outstanding++;
    g_async_queue_push(pool->work, ticket);
}

void ls_job_pool_destroy(struct ls_job_pool *pool)
{
    if (!pool)
        return;
    for (unsigned i = 0; i < pool->n_threads; i++)
        g_async_queue_push(pool->work, g_new0(struct ticket, 1));
    for (unsigned i = 0; i < pool->n_threads; i++)
        g_thread_join(pool->threads[i]);
    while (pool->outstanding > 0)
        g_main_context_iteration(NULL, TRUE);
    g_async_queue_unref(pool->work);
    g_free(pool->threads);
    g_free(pool);
}
