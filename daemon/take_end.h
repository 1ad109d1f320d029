/*
 * take_end: the last entries of a take: what is missing, what was found, the state it ended in.
 * Layer: daemon. Threads: the take's own. Ownership: all (transfer none).
 */
#ifndef LS_DAEMON_TAKE_END_H
#define LS_DAEMON_TAKE_END_H

#include "core/error.h"
#include "daemon/capture.h"
#include "daemon/checks.h"
#include "daemon/config.h"
#include "daemon/engine.h"
#include "daemon/events.h"
#include "daemon/plan.h"
#include "daemon/store.h"

struct ls_take_end {
    const struct ls_config *config;
    const struct ls_plan *plan;
    const struct ls_capture *capture; /* ran */
    struct ls_store *store;
    struct ls_checks *checks;
    struct ls_events *events; /* told what a sweep found */
    enum ls_err ran;          /* how the capture ended */
};

/** What came of it, for people. */
struct ls_take_ending {
    enum ls_take_state state; /* LS_TAKE_FAILED until it is known */
    char missing[128];        /* "3 of them, first cam0/W-0137" */
    char said[384];           /* by the checks of a sweep; else "" */
};

/**
 * Flush the store and say in take.json and the journal how the take ended; a complete sweep becomes
 * the rig's record. The store stays open. That itself can fail (disk gone): errors as
 * ls_store_flush, ls_takedir_open, ls_findings_put, ls_checks_put, ls_store_set_state.
 */
LS_MUST_CHECK enum ls_err ls_take_end(const struct ls_take_end *in, struct ls_take_ending *out,
                                      struct ls_diag *diag);

#endif
