/*
 * take_reply: the engine's state of a take as the protocol says it.
 * Layer: daemon. Threads: any. Ownership: the message points into the status and into its own
 * members; it lives as long as both.
 */
#ifndef LS_DAEMON_TAKE_REPLY_H
#define LS_DAEMON_TAKE_REPLY_H

#include "daemon/engine.h"
#include "proto/lightstage.pb-c.h"

/** A TakeStatus with room for its parts. Do not copy: it points into itself. */
struct ls_take_reply {
    Lightstage__TakeStatus status;
    Lightstage__Progress progress;
    Lightstage__Report report;
    Lightstage__Drift drift;
};

void ls_take_reply_fill(struct ls_take_reply *reply, struct ls_take_status *status);

/** It is over: complete, incomplete, aborted, failed, or nothing ran at all. */
bool ls_take_ended(const struct ls_take_status *status);

#endif
