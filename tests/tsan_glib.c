/*
 * tsan_glib: what GLib's locks and queues order, told to ThreadSanitizer.
 *
 * GLib's mutexes are bare futexes inside a library that is not instrumented: without this every
 * access under one would be reported. Linked into the tests of such a build alone, it stands before
 * GLib's functions of the same names. What is posted to a main loop is ordered after everything
 * posted before: more than is promised, and no report too many.
 */
#include <dlfcn.h>
#include <glib.h>
#include <sanitizer/tsan_interface.h>

/* The library's own function of this name. */
#define REAL(name) ((__typeof__(&name))dlsym(RTLD_NEXT, #name))

static char posted;

/* Arrays that GLib grows under mutexes of its own. */
const char *__tsan_default_suppressions(void);

const char *__tsan_default_suppressions(void)
{
    return "race:^g_realloc$\n";
}

void g_mutex_lock(GMutex *mutex)
{
    REAL(g_mutex_lock)(mutex);
    __tsan_acquire(mutex);
}

gboolean g_mutex_trylock(GMutex *mutex)
{
    gboolean locked = REAL(g_mutex_trylock)(mutex);
    if (locked)
        __tsan_acquire(mutex);
    return locked;
}

void g_mutex_unlock(GMutex *mutex)
{
    __tsan_release(mutex);
    REAL(g_mutex_unlock)(mutex);
}

void g_cond_wait(GCond *cond, GMutex *mutex)
{
    __tsan_release(mutex);
    REAL(g_cond_wait)(cond, mutex);
    __tsan_acquire(mutex);
}

gboolean g_cond_wait_until(GCond *cond, GMutex *mutex, gint64 end_time)
{
    __tsan_release(mutex);
    gboolean signalled = REAL(g_cond_wait_until)(cond, mutex, end_time);
    __tsan_acquire(mutex);
    return signalled;
}

void g_async_queue_push(GAsyncQueue *queue, gpointer data)
{
    __tsan_release(queue);
    REAL(g_async_queue_push)(queue, data);
}

gpointer g_async_queue_pop(GAsyncQueue *queue)
{
    gpointer data = REAL(g_async_queue_pop)(queue);
    __tsan_acquire(queue);
    return data;
}

/* Aravis waits with these, and pushes frames with the above. */
gpointer g_async_queue_try_pop(GAsyncQueue *queue)
{
    gpointer data = REAL(g_async_queue_try_pop)(queue);
    __tsan_acquire(queue);
    return data;
}

gpointer g_async_queue_timeout_pop(GAsyncQueue *queue, guint64 timeout)
{
    gpointer data = REAL(g_async_queue_timeout_pop)(queue, timeout);
    __tsan_acquire(queue);
    return data;
}

/* ---- main loops ---- */

struct call {
    gint references;
    GSourceFunc function;
    gpointer data;
    GDestroyNotify notify;
};

/* What the loop's thread does first of all with a source that is due. */
static void ref_call(gpointer data)
{
    __tsan_acquire(&posted);
    g_atomic_int_inc(&((struct call *)data)->references);
}

static void unref_call(gpointer data)
{
    struct call *call = data;
    if (!g_atomic_int_dec_and_test(&call->references))
        return;
    if (call->notify)
        call->notify(call->data);
    g_free(call);
}

/* Who looks for a source by its data does not ref it first. */
static void get_call(gpointer data, GSource *source, GSourceFunc *function, gpointer *user)
{
    struct call *call = data;
    __tsan_acquire(&posted);
    *function = call->function;
    *user = call->data;
}

void g_source_set_callback(GSource *source, GSourceFunc function, gpointer data,
                           GDestroyNotify notify)
{
    static GSourceCallbackFuncs functions = {ref_call, unref_call, get_call};
    struct call *call = g_new(struct call, 1);
    *call = (struct call){1, function, data, notify};
    g_source_set_callback_indirect(source, call, &functions);
}

guint g_source_attach(GSource *source, GMainContext *context)
{
    __tsan_release(&posted);
    return REAL(g_source_attach)(source, context);
}

guint g_idle_add_full(gint priority, GSourceFunc function, gpointer data, GDestroyNotify notify)
{
    GSource *source = g_idle_source_new();
    g_source_set_priority(source, priority);
    g_source_set_callback(source, function, data, notify);
    guint id = g_source_attach(source, NULL);
    g_source_unref(source);
    return id;
}
