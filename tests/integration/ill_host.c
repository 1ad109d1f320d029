/*
 * ill_host: a library that, preloaded, makes the machine under a program ill.
 * Layer: tests. Threads: any. Ownership: none.
 *
 * LS_ILL_DISK_BYTES=n          after n bytes written to files, the disk is full
 * LS_ILL_WALL_S=s              the wall clock jumps by s seconds (s may be negative) ...
 * LS_ILL_WALL_AFTER_MS=ms      ... so long after the program began; default 0
 *
 * Standard output and error, sockets and pipes are spared. Waits that end at a wall time are the
 * kernel's, which knows nothing of the jump: a program that computes such an end waits wrongly by
 * the whole jump, as it would if the clock jumped in between.
 */
#include <dlfcn.h>
#include <errno.h>
#include <stdatomic.h>
#include <stdint.h>
#include <stdlib.h>
#include <sys/stat.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

static _Atomic int64_t written;
static int64_t room = -1;
static long jump_s, after_ms;
static struct timespec began;

static int64_t number(const char *name, int64_t absent)
{
    const char *text = getenv(name);
    return text ? strtoll(text, NULL, 10) : absent;
}

__attribute__((constructor)) static void begin(void)
{
    room = number("LS_ILL_DISK_BYTES", -1);
    jump_s = (long)number("LS_ILL_WALL_S", 0);
    after_ms = (long)number("LS_ILL_WALL_AFTER_MS", 0);
    clock_gettime(CLOCK_MONOTONIC, &began);
}

static int is_file(int fd)
{
    struct stat status;
    return fd > 2 && !fstat(fd, &status) && S_ISREG(status.st_mode) && status.st_nlink > 0;
}

ssize_t write(int fd, const void *bytes, size_t n)
{
    static ssize_t (*next)(int, const void *, size_t);
    if (!next)
        *(void **)&next = dlsym(RTLD_NEXT, "write");
    if (room >= 0 && is_file(fd) && atomic_fetch_add(&written, (int64_t)n) + (int64_t)n > room) {
        errno = ENOSPC;
        return -1;
    }
    return next(fd, bytes, n);
}

/* Seconds that the wall clock is ahead by now. */
static long jumped(void)
{
    struct timespec now;
    if (!jump_s)
        return 0;
    clock_gettime(CLOCK_MONOTONIC, &now);
    long ms = (now.tv_sec - began.tv_sec) * 1000 + (now.tv_nsec - began.tv_nsec) / 1000000;
    return ms >= after_ms ? jump_s : 0;
}

int clock_gettime(clockid_t clock, struct timespec *out)
{
    static int (*next)(clockid_t, struct timespec *);
    if (!next)
        *(void **)&next = dlsym(RTLD_NEXT, "clock_gettime");
    int rc = next(clock, out);
    if (!rc && clock == CLOCK_REALTIME)
        out->tv_sec += jumped();
    return rc;
}

int gettimeofday(struct timeval *restrict out, void *restrict zone)
{
    struct timespec now;
    clock_gettime(CLOCK_REALTIME, &now);
    *out = (struct timeval){now.tv_sec, now.tv_nsec / 1000};
    return 0;
}

time_t time(time_t *out)
{
    struct timespec now;
    clock_gettime(CLOCK_REALTIME, &now);
    if (out)
        *out = now.tv_sec;
    return now.tv_sec;
}
