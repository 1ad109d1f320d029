/*
 * arrivals: remote clients until they have shown who they are.
 * Layer: daemon. Threads: ls-main; handshakes are computed on ls-serve. Ownership: the server owns
 * it; it owns those who are on their way in.
 *
 * At most 32 at once: the one that came first goes when another comes. An honest handshake takes
 * milliseconds, so that those who only knock cannot keep anybody out for long.
 */
#ifndef LS_DAEMON_ARRIVALS_H
#define LS_DAEMON_ARRIVALS_H

#include "core/error.h"
#include "daemon/conf_access.h"
#include "daemon/service.h"

#include <stdint.h>

struct ls_arrivals;

/** Are the certificates of @config good, if it asks to listen at all? Errors: those of
 * ls_tls_create. */
LS_MUST_CHECK enum ls_err ls_arrivals_check(const struct ls_listen_config *config,
                                            struct ls_diag *diag);

/**
 * Listen at config->address:port for TLS. Errors: those of ls_tls_create, LS_ERR_INVALID (no
 * numeric address), LS_ERR_BUSY (the port is taken), LS_ERR_OS. (transfer full).
 */
LS_MUST_CHECK enum ls_err ls_arrivals_create(struct ls_service *service,
                                             const struct ls_listen_config *config,
                                             struct ls_arrivals **out, struct ls_diag *diag);

/** "127.0.0.1:7472", with the port that was found free. */
const char *ls_arrivals_address(const struct ls_arrivals *arrivals);

/** Now and then: turn away who has not finished within config.hello_ms. */
void ls_arrivals_tick(struct ls_arrivals *arrivals, int64_t now_us);

/** Stop listening and hang up. Handshakes on threads end with the pool. */
void ls_arrivals_close(struct ls_arrivals *arrivals);

/** When the pool has ended. NULL is allowed. */
void ls_arrivals_destroy(struct ls_arrivals *arrivals);

#endif
