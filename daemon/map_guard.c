#include "daemon/map_guard.h"

#include <errno.h>
#include <glib.h>
#include <signal.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

/* A signal handler has no argument to find this by. The lock is a spinlock: the handler takes it
 * too, and nobody touches a guarded page while holding it. */
static struct {
    atomic_flag lock;
    struct ls_map_guard *first;
    struct sigaction before;
    uintptr_t page;
} guards = {.lock = ATOMIC_FLAG_INIT};

static void lock(void)
{
    while (atomic_flag_test_and_set_explicit(&guards.lock, memory_order_acquire))
        ;
}

static void unlock(void)
{
    atomic_flag_clear_explicit(&guards.lock, memory_order_release);
}

static bool put_zeros(uintptr_t at)
{
    bool put = false;
    lock();
    for (struct ls_map_guard *g = guards.first; g && !put; g = g->next) {
        if (at < g->begin || at >= g->end)
            continue;
        uintptr_t page = at & ~(guards.page - 1);
        atomic_store(&g->lost, true);
        put = mmap((void *)page, g->end - page, PROT_READ, MAP_PRIVATE | MAP_ANONYMOUS | MAP_FIXED,
                   -1, 0) != MAP_FAILED;
    }
    unlock();
    return put;
}

/* The lock is only taken for a fault of this thread's own, which cannot be holding it. */
static void on_bus_error(int number, siginfo_t *info, void *context)
{
    int error = errno;
    (void)context;
    if (info->si_code != BUS_ADRERR || !put_zeros((uintptr_t)info->si_addr)) {
        sigaction(number, &guards.before, NULL);
        if (info->si_code <= 0) /* sent, not met: it would not come again by itself */
            raise(number);
    }
    errno = error;
}

static void install(void)
{
    struct sigaction action = {.sa_sigaction = on_bus_error, .sa_flags = SA_SIGINFO | SA_RESTART};
    sigemptyset(&action.sa_mask);
    guards.page = (uintptr_t)sysconf(_SC_PAGESIZE);
    sigaction(SIGBUS, &action, &guards.before);
}

void ls_map_guard_add(struct ls_map_guard *guard, void *base, size_t n)
{
    static gsize installed;
    if (g_once_init_enter(&installed)) {
        install();
        g_once_init_leave(&installed, 1);
    }
    memset(guard, 0, sizeof *guard);
    guard->begin = (uintptr_t)base;
    guard->end = (guard->begin + n + guards.page - 1) & ~(guards.page - 1);
    lock();
    guard->next = guards.first;
    if (guard->next)
        guard->next->previous = guard;
    guards.first = guard;
    unlock();
}

bool ls_map_guard_lost(const struct ls_map_guard *guard)
{
    return atomic_load(&guard->lost);
}

void ls_map_guard_remove(struct ls_map_guard *guard)
{
    if (!guard->begin)
        return;
    lock();
    if (guard->previous)
        guard->previous->next = guard->next;
    else
        guards.first = guard->next;
    if (guard->next)
        guard->next->previous = guard->previous;
    unlock();
    memset(guard, 0, sizeof *guard);
}
