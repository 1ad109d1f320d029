/*
 * connection: a blocking connection to lightstaged, one thread, many requests if need be.
 * Layer: clients (core, proto). Threads: one at a time per connection. Ownership: below.
 */
#ifndef LS_CLIENTS_CONNECTION_H
#define LS_CLIENTS_CONNECTION_H

#include "clients/secure.h"
#include "core/error.h"
#include "proto/message.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct ls_connection;

/** A frame from the daemon. Finish it before receiving the next. */
struct ls_reply {
    uint16_t type;
    uint32_t request;
    bool last;                 /* nothing more follows for this request */
    ProtobufCMessage *message; /* of the type's schema */
    const uint8_t *payload;    /* (transfer none), valid until the next receive */
    size_t payload_bytes;
    int fd; /* that a frame says comes with it, or -1; finish closes it unless it has been taken */
};

void ls_reply_finish(struct ls_reply *reply);

/** Connect to the daemon that remote->url names, the path of a Unix socket too. Errors:
 * LS_ERR_NOT_FOUND (nobody there), those of ls_secure_connect. *out: (transfer full). */
LS_MUST_CHECK enum ls_err ls_connection_reach(const struct ls_remote *remote,
                                              struct ls_connection **out, struct ls_diag *diag);

/** The same over @fd or @secure, either (transfer full). */
LS_MUST_CHECK enum ls_err ls_connection_over(int fd, struct ls_secure *secure,
                                             struct ls_connection **out, struct ls_diag *diag);

/** Say Hello; @reply is its answer. Errors: LS_ERR_REFUSED (turned away: ls_connection_error, or a
 * certificate's words), LS_ERR_UNSUPPORTED (another version), LS_ERR_GONE. */
LS_MUST_CHECK enum ls_err ls_connection_greet(struct ls_connection *connection,
                                              struct ls_reply *reply, struct ls_diag *diag);

/** Both, to a Unix socket and to a daemon on another machine; what fails is closed. */
LS_MUST_CHECK enum ls_err ls_connection_open(const char *socket_path, struct ls_connection **out,
                                             struct ls_diag *diag);
LS_MUST_CHECK enum ls_err ls_connection_open_remote(const struct ls_remote *remote,
                                                    struct ls_connection **out,
                                                    struct ls_diag *diag);

/** Send a request; its id goes to *request. Errors: LS_ERR_LIMIT, LS_ERR_GONE. */
LS_MUST_CHECK enum ls_err ls_connection_send(struct ls_connection *connection, uint16_t type,
                                             const ProtobufCMessage *body, const void *payload,
                                             size_t payload_bytes, uint32_t *request,
                                             struct ls_diag *diag);

/**
 * The next frame for request @request (0: for any). An Error of the daemon is LS_ERR_REFUSED: its
 * sentence is in @diag, its number in ls_connection_error. LS_ERR_ABORTED: a signal arrived and
 * nothing is lost, call again. LS_ERR_GONE: the connection is lost. Frames of other requests are
 * dropped. Of an Error, reply->request says whose it is (0: the connection's).
 */
LS_MUST_CHECK enum ls_err ls_connection_receive(struct ls_connection *connection, uint32_t request,
                                                struct ls_reply *reply, struct ls_diag *diag);

/** Send and receive the one answer; signals do not interrupt it. */
LS_MUST_CHECK enum ls_err ls_connection_call(struct ls_connection *connection, uint16_t type,
                                             const ProtobufCMessage *body, const void *payload,
                                             size_t payload_bytes, struct ls_reply *reply,
                                             struct ls_diag *diag);

/** Number (proto/errors.h) of the last Error, 0 if there was none. */
uint32_t ls_connection_error(const struct ls_connection *connection);

/** To wait for bytes with; unless some have come already that no receive has handed out. */
int ls_connection_descriptor(const struct ls_connection *connection);
bool ls_connection_has_bytes(const struct ls_connection *connection);

/** NULL is allowed. */
void ls_connection_close(struct ls_connection *connection);

#endif
