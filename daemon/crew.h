/*
 * crew: like pieces of one long piece of work, done by a few threads at once.
 * Layer: daemon. Threads: any; the caller's works along. Ownership: nothing is kept.
 *
 * Pieces are taken in ascending order, each by whichever thread is free: what a piece does must not
 * depend on that.
 */
#ifndef LS_DAEMON_CREW_H
#define LS_DAEMON_CREW_H

#include "core/error.h"
#include "daemon/job.h"

#include <stdint.h>

/** Do piece @item; @thread, in [0, n_threads), is nobody else's meanwhile. */
typedef enum ls_err ls_crew_work(void *user, uint32_t item, unsigned thread, struct ls_diag *diag);

struct ls_crew {
    unsigned n_threads;         /* 1: the caller's alone */
    const struct ls_job *asker; /* no more pieces once it is cancelled; or NULL */
};

enum { LS_CREW_MAX_THREADS = 8 };

/** As many threads as there are processors, 1 to 4. */
unsigned ls_crew_threads(void);

/** Do pieces [0, n_items) and wait for them, with fewer threads where the system has no more. An
 * error stops the rest; that of the lowest failing piece is returned, LS_ERR_ABORTED where the
 * asker was cancelled. */
LS_MUST_CHECK enum ls_err ls_crew_run(const struct ls_crew *crew, uint32_t n_items,
                                      ls_crew_work *work, void *user, struct ls_diag *diag);

#endif
