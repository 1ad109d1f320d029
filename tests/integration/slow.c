/*
 * slow: a preloaded library that makes a daemon's disk or its merge threads slow. What runs is the
 * real thing: it only gets there later.
 * Layer: tests. Threads: any. Ownership: none.
 *
 *   LS_SLOW_DISK_BYTES_PER_S   every write of ls-store takes at least bytes / this
 *   LS_SLOW_MERGE_TIMES        ls-merge-N sleep so much longer than they compute, less one: after
 *                              a millisecond on a processor at the latest, locks they hold kept,
 *                              as a scheduler would that gives them 1 / this of a processor
 */
#include <dlfcn.h>
#include <errno.h>
#include <poll.h>
#include <pthread.h>
#include <signal.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

enum { MAX_THREADS = 64, TICK_NS = 1000000 };

static struct {
    pthread_mutex_t lock;
    bool ticking;
    pthread_t ticker;
    pthread_t thread[MAX_THREADS];
    size_t n;
} merging = {.lock = PTHREAD_MUTEX_INITIALIZER};

/* Of this thread's processor time. The model: a handler must not be the first to allocate it. */
static _Thread_local double paid_s __attribute__((tls_model("initial-exec")));

static double setting(const char *name)
{
    const char *text = getenv(name);
    return text ? atof(text) : 0;
}

static double now_s(clockid_t clock)
{
    struct timespec t;
    clock_gettime(clock, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static void rest(double s)
{
    if (s <= 0)
        return;
    struct timespec t = {(time_t)s, (long)((s - (double)(time_t)s) * 1e9)};
    while (nanosleep(&t, &t) && errno == EINTR)
        continue;
}

/* ---- disk ---- */

ssize_t write(int fd, const void *bytes, size_t n)
{
    char name[16] = "";
    double rate = setting("LS_SLOW_DISK_BYTES_PER_S");
    prctl(PR_GET_NAME, name);
    bool slow = rate > 0 && !strcmp(name, "ls-store");
    double begun = slow ? now_s(CLOCK_MONOTONIC) : 0;
    ssize_t done = syscall(SYS_write, fd, bytes, n);
    int error = errno;
    if (slow && done > 0)
        rest(begun + (double)done / rate - now_s(CLOCK_MONOTONIC));
    errno = error;
    return done;
}

/* ---- merge ---- */

static void on_tick(int number)
{
    int error = errno;
    double used_s = now_s(CLOCK_THREAD_CPUTIME_ID) - paid_s;
    rest(used_s * (setting("LS_SLOW_MERGE_TIMES") - 1));
    paid_s = now_s(CLOCK_THREAD_CPUTIME_ID); /* what this took is not theirs */
    errno = error;
}

static void *tick(void *data)
{
    for (;;) {
        rest(TICK_NS * 1e-9);
        pthread_mutex_lock(&merging.lock);
        for (size_t i = 0; i < merging.n; i++)
            pthread_kill(merging.thread[i], SIGRTMIN + 3);
        pthread_mutex_unlock(&merging.lock);
    }
    return data;
}

static void start_ticking(void)
{
    struct sigaction action = {.sa_handler = on_tick, .sa_flags = SA_RESTART};
    sigaction(SIGRTMIN + 3, &action, NULL);
    merging.ticking = pthread_create(&merging.ticker, NULL, tick, NULL) == 0;
}

int pthread_setname_np(pthread_t thread, const char *name)
{
    int (*real)(pthread_t, const char *) = dlsym(RTLD_NEXT, "pthread_setname_np");
    if (!strncmp(name, "ls-merge-", 9) && setting("LS_SLOW_MERGE_TIMES") > 1) {
        pthread_mutex_lock(&merging.lock);
        if (!merging.ticking)
            start_ticking();
        if (merging.n < MAX_THREADS)
            merging.thread[merging.n++] = thread;
        pthread_mutex_unlock(&merging.lock);
    }
    return real(thread, name);
}

/* Whom somebody waits for is about to end: nobody must send it a signal any more. */
int pthread_join(pthread_t thread, void **result)
{
    int (*real)(pthread_t, void **) = dlsym(RTLD_NEXT, "pthread_join");
    pthread_mutex_lock(&merging.lock);
    for (size_t i = 0; i < merging.n; i++)
        if (pthread_equal(merging.thread[i], thread))
            merging.thread[i--] = merging.thread[--merging.n];
    pthread_mutex_unlock(&merging.lock);
    return real(thread, result);
}
