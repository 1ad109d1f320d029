/* Between arm and blank the sequencer's and the cameras' threads allocate nothing and take no lock,
 * whatever becomes of the frames. (Under a sanitizer, which has an allocator of its own, locks
 * alone are counted.) A program of its own, since it stands in front of the C library's allocator
 * and of both kinds of mutex. The drivers are fakes, so that every call is ours; the fakes' own
 * lock is known and left out. */
#include "tests/daemon/capture_fixture.h"

#include <glib.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>

#if defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer)
#define OWN_ALLOCATOR 1
#endif
#endif
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define OWN_ALLOCATOR 1
#endif

static _Atomic bool armed;
static _Atomic unsigned long allocations, locks, seen;
static GMutex *_Atomic fakes;

int __real_pthread_mutex_lock(pthread_mutex_t *mutex);
int __wrap_pthread_mutex_lock(pthread_mutex_t *mutex);
void __real_g_mutex_lock(GMutex *mutex);
void __wrap_g_mutex_lock(GMutex *mutex);

static bool is_real_time(void)
{
    char name[16] = "";
    if (!armed || pthread_getname_np(pthread_self(), name, sizeof name))
        return false;
    return !strcmp(name, "ls-seq") || !strncmp(name, "ls-cam-", 7);
}

int __wrap_pthread_mutex_lock(pthread_mutex_t *mutex)
{
    locks += is_real_time();
    return __real_pthread_mutex_lock(mutex);
}

void __wrap_g_mutex_lock(GMutex *mutex)
{
    bool counts = is_real_time();
    seen += counts && mutex == fakes; /* by both kinds of thread, at every call of a driver */
    locks += counts && mutex != fakes;
    __real_g_mutex_lock(mutex);
}

#ifndef OWN_ALLOCATOR
void *__libc_malloc(size_t size);
void *__libc_calloc(size_t n, size_t size);
void *__libc_realloc(void *old, size_t size);

void *malloc(size_t size)
{
    allocations += is_real_time();
    return __libc_malloc(size);
}

void *calloc(size_t n, size_t size)
{
    allocations += is_real_time();
    return __libc_calloc(n, size);
}

void *realloc(void *old, size_t size)
{
    allocations += is_real_time();
    return __libc_realloc(old, size);
}
#endif

static void on_armed(bool now)
{
    armed = now;
}

static void expect_nothing(unsigned n_cameras, enum fake_fault fault)
{
    struct stage *s = new_stage();
    s->options.n_cameras = n_cameras;
    s->options.armed = on_armed;
    s->options.faults[FIRST_LIGHT + 7] = (unsigned char)fault;
    set_up(s);
    fakes = fake_rig_lock(s->rig);
    allocations = locks = seen = 0;
    g_assert_cmpint(ls_capture_run(s->capture, &s->report, &s->diag), ==, LS_OK);
    g_assert_cmpuint(allocations, ==, 0);
    g_assert_cmpuint(locks, ==, 0);
    g_assert_cmpuint(seen, >, s->plan.n_steps); /* the window was open and the threads known */
    expect_complete(s);
    clear(s);
}

static void test_clean(void)
{
    expect_nothing(2, FAKE_FINE);
}

static void test_lost(void)
{
    expect_nothing(1, FAKE_LOST);
    expect_nothing(1, FAKE_VANISHED);
    expect_nothing(1, FAKE_DROPPED);
    expect_nothing(1, FAKE_DOUBLED);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/capture/real-time-threads-allocate-and-lock-nothing", test_clean);
    g_test_add_func("/capture/nor-do-they-when-frames-go-astray", test_lost);
    return g_test_run();
}
