/*
 * session: one connection: bytes in, requests dispatched, frames out.
 * Layer: daemon. Threads: ls-main. Ownership: a session owns its transport and jobs, and frees
 * itself when the connection has ended and no thread is at it; the service keeps it in its list
 * until the end.
 */
#ifndef LS_DAEMON_SESSION_H
#define LS_DAEMON_SESSION_H

#include "daemon/access.h"
#include "daemon/job.h"
#include "daemon/preview.h"
#include "daemon/service.h"
#include "daemon/transport.h"
#include "proto/errors.h"
#include "proto/message.h"

#include <stdbool.h>
#include <stdint.h>

struct ls_session;

/** Who is at the other end: of the Unix socket as the kernel says, else as its certificate says. */
struct ls_peer {
    enum ls_role role;
    bool remote;
    int pid; /* not of a remote one, as uid and gid */
    unsigned uid, gid;
    char name[65]; /* common name of a remote one */
};

/** "pid 17 of uid 1000", "node-1". */
void ls_peer_describe(const struct ls_peer *peer, char *text, size_t size);

/** Serve whoever is at the other end of @transport (transfer full), or say why not and hang up: no
 * role, too many connections, too many of this peer. */
void ls_session_admit(struct ls_service *service, struct ls_transport *transport,
                      const struct ls_peer *peer);

const struct ls_peer *ls_session_peer(const struct ls_session *session);
struct ls_service *ls_session_service(const struct ls_session *session);

/** True once: it asked for what its role does not allow. */
bool ls_session_first_refusal(struct ls_session *session);

/** Queue a reply: @body of @type, with LS_FRAME_LAST if @last. @payload (transfer full, malloc'd)
 * may be NULL. A body that does not fit a frame becomes an error 500. */
void ls_session_reply(struct ls_session *session, uint32_t request, uint16_t type,
                      const ProtobufCMessage *body, uint8_t *payload, size_t payload_bytes,
                      bool last);

/** Queue a reply, its only one, with the descriptor @fd (transfer full); ls_session_passes_fds. */
void ls_session_reply_fd(struct ls_session *session, uint32_t request, uint16_t type,
                         const ProtobufCMessage *body, int fd);

/** Queue an Error; ends the request. */
void ls_session_error(struct ls_session *session, uint32_t request, uint32_t number,
                      const char *text);

/** Queue the Error of a failed call. */
void ls_session_fail(struct ls_session *session, uint32_t request, enum ls_err err,
                     enum ls_proto_context about, const struct ls_diag *diag);

/** Can its client be given descriptors? */
bool ls_session_passes_fds(const struct ls_session *session);

/** Run a job for this session; (transfer full). Its request is in job->request. */
void ls_session_run(struct ls_session *session, struct ls_job *job);

/** A request that waits for something other than a job; its maker's. */
struct ls_pending {
    uint32_t request;
    /** Nobody waits for it any more, and it has left the session: forget and free it. @cancelled:
     * by its client, else the connection has ended. */
    void (*drop)(struct ls_pending *pending, bool cancelled);
};

/** Count it among the session's requests until it is answered or dropped. False if there are too
 * many: the client has been told. */
bool ls_session_wait(struct ls_session *session, struct ls_pending *pending);

/** It is about to be answered. */
void ls_session_waited(struct ls_session *session, struct ls_pending *pending);

/** Cancel the job, subscription or pending request of @request. False if there is none. */
bool ls_session_cancel(struct ls_session *session, uint32_t request);

/** The job of @request may send @bytes more. False if there is none that counts. */
bool ls_session_credit(struct ls_session *session, uint32_t request, uint64_t bytes);

/** Subscribe @request to the progress of the take; false if the session has a subscription. */
bool ls_session_subscribe(struct ls_session *session, uint32_t request);

/** The take's status has changed: tell the subscriber, or skip it if the client is behind. */
void ls_session_take_event(struct ls_session *session);

/** Tell @request what happens, from what is so now on: of what @wish says, or of all if it says
 * nothing. False if the session is told already. */
bool ls_session_follow_events(struct ls_session *session, uint32_t request,
                              const Lightstage__Events *wish);

/** Something has happened: tell who wants to know, as far as the client is not behind. */
void ls_session_tell_events(struct ls_session *session);

/** Send @request pictures of @camera from now on; @frames: the engine's live view is this client's,
 * and ends with the request. False if the session looks already. */
bool ls_session_watch(struct ls_session *session, uint32_t request, uint32_t camera, bool frames);

bool ls_session_watches(const struct ls_session *session);
bool ls_session_frames(const struct ls_session *session);

/** Does it look at @camera, and is nothing waiting for its client? */
bool ls_session_wants_picture(const struct ls_session *session, uint32_t camera);

/** A picture of @camera (transfer none): sent if it is wanted, counted if the client is behind. */
void ls_session_picture(struct ls_session *session, uint32_t camera,
                        const struct ls_preview_picture *picture);

/** The engine has ended the live view of this client: say why. */
void ls_session_framing_ended(struct ls_session *session);

/** Once a second: close what has stalled. May free the session. */
void ls_session_tick(struct ls_session *session, int64_t now_us);

/** The daemon is going down: say so as far as the socket takes it now, and close. */
void ls_session_shutdown(struct ls_session *session);

/** End the session. Its running jobs are cancelled and freed when their step returns. */
void ls_session_close(struct ls_session *session);

#endif
