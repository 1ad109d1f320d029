#include "daemon/errand.h"

#include <glib.h>
#include <stdatomic.h>
#include <stdlib.h>

struct ls_errands {
    GMainContext *main;
    GQueue queue;
    struct ls_errand *current; /* NULL: none is under way */
    GThread *thread;           /* its own; NULL: it has not come to work */
    bool ended;
    uint64_t n_put;
    GMutex lock; /* of what follows */
    GCond done;
    uint64_t n_done;
};

struct ls_errands *ls_errands_create(void)
{
    struct ls_errands *q = calloc(1, sizeof *q);
    if (!q)
        return NULL;
    q->main = g_main_context_ref_thread_default();
    g_queue_init(&q->queue);
    g_mutex_init(&q->lock);
    g_cond_init(&q->done);
    return q;
}

static void finish(struct ls_errands *q)
{
    struct ls_errand *errand = q->current;
    g_clear_pointer(&q->thread, g_thread_join);
    q->current = NULL;
    g_mutex_lock(&q->lock);
    q->n_done++;
    g_cond_broadcast(&q->done);
    g_mutex_unlock(&q->lock);
    errand->done(errand);
}

static void go_on(struct ls_errands *q);

static gboolean on_worked(gpointer data)
{
    struct ls_errands *q = data;
    finish(q);
    go_on(q);
    return G_SOURCE_REMOVE;
}

static gpointer work(gpointer data)
{
    struct ls_errands *q = data;
    q->current->work(q->current);
    GSource *source = g_idle_source_new();
    g_source_set_priority(source, G_PRIORITY_DEFAULT);
    g_source_set_callback(source, on_worked, q, NULL);
    g_source_attach(source, q->main);
    g_source_unref(source);
    return NULL;
}

static void go_on(struct ls_errands *q)
{
    while (!q->current && !q->ended && (q->current = g_queue_pop_head(&q->queue))) {
        struct ls_errand *errand = q->current;
        if (!atomic_load(&errand->stop) && (!errand->begin || errand->begin(errand)))
            q->thread = g_thread_new("ls-rig", work, q);
        else
            finish(q);
    }
}

void ls_errands_yield(struct ls_errands *q)
{
    if (q->current && q->current->yields)
        atomic_store(&q->current->stop, true);
}

void ls_errands_put(struct ls_errands *q, struct ls_errand *errand)
{
    ls_errands_yield(q);
    q->n_put++;
    g_queue_push_tail(&q->queue, errand);
    go_on(q);
}

bool ls_errands_busy(const struct ls_errands *q)
{
    return (q->current && !q->current->yields) || q->queue.length > 0;
}

uint64_t ls_errands_count(const struct ls_errands *q)
{
    return q->n_put;
}

void ls_errands_wait(struct ls_errands *q, uint64_t count)
{
    g_mutex_lock(&q->lock);
    while (q->n_done < count)
        g_cond_wait(&q->done, &q->lock);
    g_mutex_unlock(&q->lock);
}

void ls_errands_end(struct ls_errands *q)
{
    if (!q)
        return;
    q->ended = true;
    if (q->current) {
        atomic_store(&q->current->stop, true);
        g_clear_pointer(&q->thread, g_thread_join);
        g_source_destroy(g_main_context_find_source_by_user_data(q->main, q));
        finish(q);
    }
    while ((q->current = g_queue_pop_head(&q->queue)))
        finish(q);
}

void ls_errands_destroy(struct ls_errands *q)
{
    if (!q)
        return;
    g_main_context_unref(q->main);
    g_mutex_clear(&q->lock);
    g_cond_clear(&q->done);
    free(q);
}
