/*
 * watch: whether a camera that streams is still there and still ours.
 * Layer: drivers. Threads: one of its own from start to stop; answers on any; start and stop on
 * one. Ownership: the stream is (transfer none) and outlives it; start (transfer full).
 *
 * The heartbeat of Aravis gives a silent camera up after 5.6 s, and its time limits cannot be set.
 * So the camera is asked, every 0.4 s, from a socket of ours, who controls it: a register that
 * anybody may read. When five questions in a row, 2 s, brought no answer and no
 * packet of a frame, or an answer says that nobody controls it (it has started afresh), it is gone.
 * A camera that has never answered these questions is left to the heartbeat.
 */
#ifndef LS_DRIVERS_ARAVIS_WATCH_H
#define LS_DRIVERS_ARAVIS_WATCH_H

#include "core/error.h"

#include <arv.h>
#include <stdbool.h>

struct ls_aravis_watch;

/** @gone is called once, on the watch's thread. LS_ERR_OS, LS_ERR_NOMEM. */
LS_MUST_CHECK enum ls_err ls_aravis_watch_start(const char *address, ArvStream *stream,
                                                void (*gone)(void *user), void *user,
                                                struct ls_aravis_watch **out, struct ls_diag *diag);

/** Wait until the newest question is answered, a millisecond, or the camera gone: false. To be
 * asked before an access that Aravis would wait seconds for. Allocates nothing, takes no lock. */
bool ls_aravis_watch_answers(struct ls_aravis_watch *watch);

/** NULL is allowed. */
void ls_aravis_watch_stop(struct ls_aravis_watch *watch);

#endif
