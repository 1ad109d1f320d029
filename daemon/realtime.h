/*
 * realtime: who runs before whom: ls-seq and ls-cam first, ls-serve last; and the time they keep.
 * Layer: daemon. Threads: any. Ownership: none.
 */
#ifndef LS_DAEMON_REALTIME_H
#define LS_DAEMON_REALTIME_H

#include <semaphore.h>
#include <stdbool.h>
#include <stdint.h>

enum {
    LS_PRIORITY_SEQ = 10, /* below the cameras' threads: a frame not taken may be lost, a grant
                             that waits is only late */
};

/** Make the calling thread SCHED_FIFO at @priority; 0 leaves it. False: not permitted, the thread
 * stays as it was. */
bool ls_realtime_enter(int priority);

/** Make the calling thread, and those it starts, give way to all that photographs, merges and
 * stores: a tenth of a processor is theirs while others want all of it, so that nobody waits long
 * for a lock of theirs. There is no way back. */
void ls_give_way(void);

/** Host CLOCK_MONOTONIC_RAW, ns. RT-safe. */
uint64_t ls_host_ns(void);

/** Leave a light controller alone for @us: it speaks only when asked, and nothing else tells that a
 * step was fired. What does announce itself is waited for with ls_host_wait. RT-safe. */
void ls_host_rest(uint64_t us);

/** Wait until @sem is posted, @us at most. RT-safe. */
void ls_host_wait(sem_t *sem, uint64_t us);

#endif
