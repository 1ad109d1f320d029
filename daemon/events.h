/*
 * events: what happens to takes that clients are told of: pictures published, alarms.
 * Layer: daemon. Threads: stated per function. Ownership: the engine's.
 *
 * The pictures of the current take, or of the last one, are kept in a list from which every reader
 * takes at its own speed: who is slow misses none, and a list is as long as its plan. A take that
 * begins starts a new list; who has not read the old one by then is told so (`missed`). Of an alarm
 * only the last state is kept.
 */
#ifndef LS_DAEMON_EVENTS_H
#define LS_DAEMON_EVENTS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/** As AlarmKind of the protocol. */
enum ls_alarm_kind {
    LS_ALARM_DRIFT,
    LS_ALARM_SWEEP,
    LS_ALARM_HOT,
    LS_ALARM_FAULT,
    LS_ALARM_DISK,
    LS_ALARM_KINDS,
};

/** A picture of lights that can be fetched. */
struct ls_event_picture {
    char condition[64];
    char channel[32]; /* "" = several */
    uint32_t camera;
    int32_t light; /* it shows alone; -1 = several */
};

struct ls_alarm {
    enum ls_alarm_kind kind;
    bool active; /* else it is over */
    char take[128], text[384];
};

struct ls_events;

/** For readers on the thread-default main context. NULL: out of memory. (transfer full). */
struct ls_events *ls_events_create(void);

/** NULL is allowed. */
void ls_events_destroy(struct ls_events *events);

/* ---- what happens: any thread that may block ---- */

/** Take @id begins, or goes on: an empty list, no alarm but those of the dome (SWEEP, HOT). */
void ls_events_begin(struct ls_events *events, const char *id);

void ls_events_published(struct ls_events *events, const struct ls_event_picture *picture);

/** The alarm is so now; nothing happens where it was already. @take, @text: cut where too long. */
void ls_events_alarm(struct ls_events *events, enum ls_alarm_kind kind, bool active,
                     const char *take, const char *text);

/* ---- who reads: ls-main ---- */

/** Call @changed after something has happened, for as long as the loop runs. One at a time. */
void ls_events_watch(struct ls_events *events, void (*changed)(void *user), void *user);

/** How far somebody has read. Zeroed: nothing yet. */
struct ls_events_cursor {
    uint32_t list;
    size_t at;
    uint32_t alarms[LS_ALARM_KINDS];
};

/** The next pictures, at most @most; *take: whose. *missed: those left of the list before are gone.
 */
size_t ls_events_read(struct ls_events *events, struct ls_events_cursor *cursor, char take[128],
                      struct ls_event_picture *out, size_t most, bool *missed);

/** The next alarm that has changed; those that are over are told only to who was told of them.
 * False: there is none. */
bool ls_events_read_alarm(struct ls_events *events, struct ls_events_cursor *cursor,
                          struct ls_alarm *out);

#endif
