/*
 * tls: what both ends of an encrypted connection hold to: TLS 1.3 only (RFC 8446), a certificate at
 * either end, both of one authority.
 * Layer: proto. Threads: any, one at a time per object. Ownership: the caller's.
 *
 * No session is resumed, so every connection shows its certificates. One that names uses must name
 * the one it is put to: a client's cannot pass for a server's.
 */
#ifndef LS_PROTO_TLS_H
#define LS_PROTO_TLS_H

#include "core/error.h"

#include <openssl/ssl.h>
#include <stdbool.h>

struct ls_tls;

/**
 * Read the own certificate (PEM, with its chain), its key and the authority's certificate.
 * LS_ERR_INVALID, with the file and what is wrong: unreadable, not PEM, a key that does not fit or
 * that everybody may read, a certificate that has expired or is not valid yet. (transfer full).
 */
LS_MUST_CHECK enum ls_err ls_tls_create(bool server, const char *certificate, const char *key,
                                        const char *authority, struct ls_tls **out,
                                        struct ls_diag *diag);

/** NULL is allowed. Connections must have ended. */
void ls_tls_destroy(struct ls_tls *tls);

/** For the socket @fd (transfer none), which raises no SIGPIPE. (transfer full), SSL_free; NULL
 * without memory. */
SSL *ls_tls_attach(struct ls_tls *tls, int fd);

/** OpenSSL's newest error of this thread in its words, and none left. */
const char *ls_tls_why(void);

#endif
