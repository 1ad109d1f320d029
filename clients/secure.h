/*
 * secure: the encrypted bytes to a daemon on another machine, blocking.
 * Layer: clients (core, proto). Threads: one at a time. Ownership: below.
 */
#ifndef LS_CLIENTS_SECURE_H
#define LS_CLIENTS_SECURE_H

#include "core/error.h"

#include <stdbool.h>
#include <stddef.h>

/** Where a daemon listens for TLS, and who asks. (transfer none). */
struct ls_remote {
    const char *url;                           /* "tls://stage.example:7472", "tls://[::1]" */
    const char *certificate, *key, *authority; /* PEM files */
};

/** Is it the address of such a daemon, not the path of a socket? */
bool ls_remote_is_url(const char *text);

struct ls_secure;

/**
 * Connect and shake hands, for 10 s at most each. The daemon's certificate must be the authority's,
 * and for the host that the url names. Errors: LS_ERR_INVALID (url, files), LS_ERR_NOT_FOUND
 * (nobody there), LS_ERR_REFUSED (its certificate; that it refuses ours shows when reading),
 * LS_ERR_TIMEOUT. *out: (transfer full).
 */
LS_MUST_CHECK enum ls_err ls_secure_connect(const struct ls_remote *remote, struct ls_secure **out,
                                            struct ls_diag *diag);

/** To wait for bytes with; unless some have come already. */
int ls_secure_fd(const struct ls_secure *secure);
bool ls_secure_has_bytes(const struct ls_secure *secure);

/** All of them. LS_ERR_GONE. */
LS_MUST_CHECK enum ls_err ls_secure_write(struct ls_secure *secure, const void *bytes, size_t n,
                                          struct ls_diag *diag);

/** What has come, or waits for some. LS_ERR_ABORTED: a signal arrived. LS_ERR_GONE, with what the
 * daemon said last: that it refuses the certificate, and why. */
LS_MUST_CHECK enum ls_err ls_secure_read(struct ls_secure *secure, void *bytes, size_t size,
                                         size_t *n, struct ls_diag *diag);

/** NULL is allowed. */
void ls_secure_close(struct ls_secure *secure);

#endif
