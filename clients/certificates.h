/*
 * certificates: an authority's certificate and those it signs, made with OpenSSL's library.
 * Layer: clients. Threads: any. Ownership: none, files.
 *
 * Keys are of the curve P-256; files are PEM, STEM.pem and STEM.key in one folder, both of mode
 * 0600, and none is ever overwritten.
 */
#ifndef LS_CLIENTS_CERTIFICATES_H
#define LS_CLIENTS_CERTIFICATES_H

#include "core/error.h"

#include <stddef.h>

enum ls_certificate_use { LS_CERTIFICATE_AUTHORITY, LS_CERTIFICATE_SERVER, LS_CERTIFICATE_CLIENT };

struct ls_certificate_wish {
    enum ls_certificate_use use;
    const char *name;         /* common name, at most 64 bytes */
    const char *const *hosts; /* of a server: names and addresses it is asked for by */
    size_t n_hosts;
    long from_days, days; /* valid from that many days after now, so long */
};

/**
 * Make FOLDER/@stem.pem and .key, signed by FOLDER/@authority (an authority: NULL, signs itself).
 * Errors: LS_ERR_EXISTS, LS_ERR_NOT_FOUND (no authority there), LS_ERR_INVALID (a host, a file that
 * cannot be written), LS_ERR_OS.
 */
LS_MUST_CHECK enum ls_err ls_certificate_make(const char *folder, const char *stem,
                                              const char *authority,
                                              const struct ls_certificate_wish *wish,
                                              struct ls_diag *diag);

#endif
