/*
 * session_private: a session's state, for the files it is made of: session.c (its life, frames),
 * session_jobs.c (what it waits for), session_streams.c (what it is told of its own accord).
 * Layer: daemon. Threads: ls-main. Ownership: session.h.
 */
#ifndef LS_DAEMON_SESSION_PRIVATE_H
#define LS_DAEMON_SESSION_PRIVATE_H

#include "daemon/session.h"
#include "daemon/traffic.h"

struct ls_session {
    struct ls_service *service;
    struct ls_peer peer;
    struct ls_traffic traffic;
    bool greeted, refused;   /* has said Hello; has asked for too much */
    bool closing;            /* an error is on its way out, then close */
    GQueue jobs;             /* waiting for their turn */
    struct ls_job *stepping; /* on a thread now */
    GList *pending;          /* struct ls_pending */
    uint32_t subscription;   /* request id, 0 = none */
    bool event_pending;
    struct {
        uint32_t request; /* 0 = none */
        bool progress, published, alarms;
        bool moved; /* the take's progress has changed since it was told */
        struct ls_events_cursor cursor;
    } events;
    struct {
        uint32_t request; /* 0 = does not look */
        uint32_t camera;
        bool frames; /* the live view is this client's */
        uint64_t skipped;
    } preview;
    unsigned refs; /* the connection, each thread and call that is at it */
    bool open;
};

void ls_session_hold(struct ls_session *session);
void ls_session_release(struct ls_session *session);

/* session_jobs.c */

/** Requests that are not answered yet, and streams. */
unsigned ls_session_in_flight(const struct ls_session *session);

/** Step the next job, if there is one and room for its frame. One at a time per client; the jobs of
 * a client take turns. */
void ls_session_next_job(struct ls_session *session);

/** Nobody waits for any of them any more. */
void ls_session_drop_requests(struct ls_session *session);

/* session_streams.c */

/** What the subscriber has missed while its client was behind. */
void ls_session_catch_up(struct ls_session *session);

/** Is nothing waiting for the client? Frames of their own accord are sent only then. */
bool ls_session_is_idle(const struct ls_session *session);

/* session_events.c */

/** The take's progress has changed. */
void ls_session_events_moved(struct ls_session *session);

void ls_session_end_streams(struct ls_session *session);
bool ls_session_cancel_stream(struct ls_session *session, uint32_t request);
unsigned ls_session_streams(const struct ls_session *session);

#endif
