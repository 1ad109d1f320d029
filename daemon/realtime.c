#include "daemon/realtime.h"

#include <errno.h>
#include <pthread.h>
#include <sched.h>
#include <sys/resource.h>
#include <time.h>
#include <unistd.h>

enum { WAY_NICE = 10 }; /* a tenth of the weight of nice 0 */

bool ls_realtime_enter(int priority)
{
    const struct sched_param param = {.sched_priority = priority};
    return priority == 0 || pthread_setschedparam(pthread_self(), SCHED_FIFO, &param) == 0;
}

void ls_give_way(void)
{
    id_t self = (id_t)gettid(); /* on Linux a thread has a niceness of its own */
    if (getpriority(PRIO_PROCESS, self) < WAY_NICE)
        setpriority(PRIO_PROCESS, self, WAY_NICE); /* anybody may */
}

uint64_t ls_host_ns(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC_RAW, &t);
    return (uint64_t)t.tv_sec * 1000000000u + (uint64_t)t.tv_nsec;
}

void ls_host_rest(uint64_t us)
{
    const struct timespec t = {.tv_sec = (time_t)(us / 1000000),
                               .tv_nsec = (long)(us % 1000000) * 1000};
    nanosleep(&t, NULL);
}

void ls_host_wait(sem_t *sem, uint64_t us)
{
    struct timespec until;
    clock_gettime(CLOCK_MONOTONIC, &until);
    uint64_t ns = (uint64_t)until.tv_nsec + us % 1000000 * 1000;
    until.tv_sec += (time_t)(us / 1000000 + ns / 1000000000);
    until.tv_nsec = (long)(ns % 1000000000);
    while (sem_clockwait(sem, CLOCK_MONOTONIC, &until) && errno == EINTR)
        ;
}
