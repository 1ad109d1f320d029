/*
 * errand: what is done with the devices while no take holds them, one after another on a thread of
 * its own, ls-rig, so that a device that is slow or dead keeps nobody else waiting.
 * Layer: daemon. Threads: every call on ls-main, except where said. Ownership: an errand is part of
 * something of its maker's, and the queue's from put to done.
 */
#ifndef LS_DAEMON_ERRAND_H
#define LS_DAEMON_ERRAND_H

#include <stdbool.h>
#include <stdint.h>

struct ls_errand {
    /** ls-main, when its turn comes. False: there is nothing to do on ls-rig. NULL: there is. */
    bool (*begin)(struct ls_errand *errand);
    /** ls-rig. May block on devices; looks at stop between them. */
    void (*work)(struct ls_errand *errand);
    /** ls-main, once, perhaps inside put; may free it. Nothing was begun where it was stopped
     * before its turn. */
    void (*done)(struct ls_errand *errand);
    bool yields;       /* stopped as soon as another is put behind it */
    _Atomic bool stop; /* any thread */
};

struct ls_errands;

/** NULL: out of memory. (transfer full). */
struct ls_errands *ls_errands_create(void);

/** At the end of the queue; begun at once if that is empty. */
void ls_errands_put(struct ls_errands *errands, struct ls_errand *errand);

/** Stop the one under way if it yields. */
void ls_errands_yield(struct ls_errands *errands);

/** Is one under way or queued, beside those that yield? */
bool ls_errands_busy(const struct ls_errands *errands);

/** How many were put. */
uint64_t ls_errands_count(const struct ls_errands *errands);

/** Any thread but ls-main and ls-rig: wait until @count of them are done with the devices. */
void ls_errands_wait(struct ls_errands *errands, uint64_t count);

/** Stop all, wait for the one under way, tell each that it is done. NULL is allowed. */
void ls_errands_end(struct ls_errands *errands);

/** Not before they have ended and nobody waits. NULL is allowed. */
void ls_errands_destroy(struct ls_errands *errands);

#endif
