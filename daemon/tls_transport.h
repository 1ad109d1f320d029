/*
 * tls_transport: the transport of remote clients, encrypted by the rules of proto/tls.h.
 * Layer: daemon. Threads: stated per function; the rest as transport.h. Ownership: as transport.h.
 */
#ifndef LS_DAEMON_TLS_TRANSPORT_H
#define LS_DAEMON_TLS_TRANSPORT_H

#include "core/error.h"
#include "daemon/transport.h"
#include "proto/tls.h"

#include <stddef.h>

/** The connected non-blocking socket @fd (transfer full), before its handshake. It writes a
 * record (16 KiB) at a time; reading waits for such a write of another thread. (transfer full);
 * NULL without memory, @fd closed. */
struct ls_transport *ls_transport_tls(struct ls_tls *tls, int fd);

enum ls_tls_step { LS_TLS_DONE, LS_TLS_WANTS_IN, LS_TLS_WANTS_OUT };

/** Any thread, one at a time, not ls-main: as much of the handshake as goes now, milliseconds of
 * computing. LS_ERR_REFUSED: with the reason. */
LS_MUST_CHECK enum ls_err ls_tls_transport_handshake(struct ls_transport *transport,
                                                     enum ls_tls_step *step, struct ls_diag *diag);

/** After the handshake: the common name of the peer's certificate; "" if it has none, or one that
 * is not plain text. */
void ls_tls_transport_peer(struct ls_transport *transport, char *name, size_t size);

#endif
