/*
 * server: the sockets, their clients, and what they share.
 * Layer: daemon. Threads: every call on ls-main; starts ls-serve-N. Ownership: the server borrows
 * the engine, which must outlive it.
 *
 * Promises: a client that is slow, stalled, hostile or gone never blocks ls-main and never touches
 * a capture. Memory per connection is bounded (one request of at most 64 KiB + max_payload bytes,
 * max_requests jobs, about 4 MiB of frames waiting, what is known of the tiles of one picture for
 * each job); what a client cannot be given in time is counted, and a client that takes nothing for
 * stall_ms while something waits is closed, as is one whose request is not whole stall_ms after its
 * first byte, and one that waits for nothing and asks for nothing for idle_s.
 */
#ifndef LS_DAEMON_SERVER_H
#define LS_DAEMON_SERVER_H

#include "core/error.h"
#include "daemon/conf_access.h"
#include "daemon/engine.h"

#include <stdint.h>

/** 0 = the default in brackets. Strings: (transfer none). */
struct ls_server_config {
    const char *socket_path;
    int listener;        /* a socket that listens there already, (transfer full) [make one] */
    const char *storage; /* folder of the takes */
    const struct ls_access *access;        /* [whoever connects is an operator] */
    const struct ls_listen_config *listen; /* for remote clients [none] */
    unsigned max_connections;              /* [128] */
    unsigned max_connections_each;         /* of one uid or certificate [64] */
    unsigned max_requests;                 /* in flight on one connection [8] */
    unsigned serve_threads;                /* [processors, 2 to 4] */
    unsigned hello_ms;                     /* for a handshake, and for the first message [10000] */
    unsigned stall_ms;                     /* without progress while something waits [30000] */
    unsigned idle_s;                       /* without a request, a stream or a word [900] */
    uint64_t max_payload;                  /* of a request [1 MiB] */
    uint64_t spare_bytes; /* of the storage's disk, that maps of promotion leave free [0] */
};

struct ls_server;

/**
 * Listen. The socket is made with mode 0660: who may connect is decided by its owner and group and
 * by the folder. A socket file that nobody listens on any more is removed first. Errors:
 * LS_ERR_BUSY (a living daemon listens there), LS_ERR_INVALID (path too long), LS_ERR_EXISTS (the
 * path is something else than a socket), LS_ERR_OS, those of ls_arrivals_create. *out: (transfer
 * full).
 */
LS_MUST_CHECK enum ls_err ls_server_create(const struct ls_server_config *config,
                                           struct ls_engine *engine, struct ls_server **out,
                                           struct ls_diag *diag);

/** The engine's callback ends here: remember where the take stands and tell who subscribed. */
void ls_server_take_event(struct ls_server *server, const struct ls_take_status *status);

/** Where it listens for remote clients, "127.0.0.1:7472", or NULL. */
const char *ls_server_remote_address(const struct ls_server *server);

/** Connections now (tests, status). */
unsigned ls_server_connections(const struct ls_server *server);

/** Close every connection (their requests end with 207), stop the threads, remove the socket.
 * NULL is allowed. */
void ls_server_destroy(struct ls_server *server);

#endif
