#include "clients/secure.h"

#include "proto/tls.h"

#include <arpa/inet.h>
#include <errno.h>
#include <netdb.h>
#include <netinet/tcp.h>
#include <openssl/err.h>
#include <openssl/x509v3.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

enum { PATIENCE_S = 10, BUFFER_BYTES = 256 * 1024 };
#define SCHEME "tls://"
#define DEFAULT_PORT "7472"

struct ls_secure {
    struct ls_tls *tls;
    SSL *ssl;
    int fd;
};

struct place {
    char host[256], port[8];
};

bool ls_remote_is_url(const char *text)
{
    return strncmp(text, SCHEME, strlen(SCHEME)) == 0;
}

void ls_secure_close(struct ls_secure *secure)
{
    if (!secure)
        return;
    SSL_free(secure->ssl);
    ls_tls_destroy(secure->tls);
    if (secure->fd >= 0)
        close(secure->fd);
    free(secure);
}

/* "host", "host:port", "[v6]:port" after the scheme. */
static enum ls_err parse(const char *url, struct place *out, struct ls_diag *diag)
{
    const char *at = url + strlen(SCHEME), *end;
    bool bracketed = *at == '[';
    at += bracketed;
    end = at + strcspn(at, bracketed ? "]" : ":");
    size_t n = (size_t)(end - at);
    const char *rest = bracketed && *end ? end + 1 : end;
    const char *port = *rest == ':' ? rest + 1 : DEFAULT_PORT;
    if (!ls_remote_is_url(url) || n == 0 || n >= sizeof out->host || (*rest && *rest != ':') ||
        !*port || strlen(port) > 5 || strspn(port, "0123456789") != strlen(port))
        return ls_fail(diag, LS_ERR_INVALID, "\"%.200s\": expected tls://HOST:PORT", url);
    snprintf(out->host, sizeof out->host, "%.*s", (int)n, at);
    snprintf(out->port, sizeof out->port, "%s", port);
    return LS_OK;
}

/* Also bounds connect(2). */
static void limit_waiting(int fd, int seconds)
{
    struct timeval limit = {.tv_sec = seconds};
    setsockopt(fd, SOL_SOCKET, SO_SNDTIMEO, &limit, sizeof limit);
    setsockopt(fd, SOL_SOCKET, SO_RCVTIMEO, &limit, sizeof limit);
}

static int try_address(const struct addrinfo *to)
{
    int on = 1;
    int fd = socket(to->ai_family, SOCK_STREAM | SOCK_CLOEXEC, 0);
    if (fd < 0)
        return -1;
    limit_waiting(fd, PATIENCE_S);
    if (connect(fd, to->ai_addr, to->ai_addrlen) == 0) {
        setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
        return fd;
    }
    int reason = errno;
    close(fd);
    errno = reason == EINPROGRESS ? ETIMEDOUT : reason;
    return -1;
}

static enum ls_err connect_to(const struct place *place, int *out, struct ls_diag *diag)
{
    struct addrinfo hints = {.ai_socktype = SOCK_STREAM}, *list = NULL;
    int failed = getaddrinfo(place->host, place->port, &hints, &list);
    int fd = -1;
    if (failed)
        return ls_fail(diag, LS_ERR_NOT_FOUND, "%s: %s", place->host, gai_strerror(failed));
    for (const struct addrinfo *a = list; a && fd < 0; a = a->ai_next)
        fd = try_address(a);
    int reason = errno;
    freeaddrinfo(list);
    if (fd < 0)
        return ls_fail(diag, LS_ERR_NOT_FOUND, "no lightstaged answers at %s port %s (%s)",
                       place->host, place->port, strerror(reason));
    *out = fd;
    return LS_OK;
}

/* The certificate must be for the host that was asked for. */
static bool expect_host(SSL *ssl, const char *host)
{
    struct in6_addr binary;
    bool numeric =
        inet_pton(AF_INET, host, &binary) == 1 || inet_pton(AF_INET6, host, &binary) == 1;
    if (numeric)
        return X509_VERIFY_PARAM_set1_ip_asc(SSL_get0_param(ssl), host) == 1;
    return SSL_set1_host(ssl, host) == 1 && SSL_set_tlsext_host_name(ssl, host) == 1;
}

static enum ls_err shake_hands(struct ls_secure *secure, const struct place *place,
                               struct ls_diag *diag)
{
    ERR_clear_error();
    int result = SSL_connect(secure->ssl);
    int error = result == 1 ? SSL_ERROR_NONE : SSL_get_error(secure->ssl, result);
    long verdict = SSL_get_verify_result(secure->ssl);
    if (result == 1)
        return LS_OK;
    if (verdict != X509_V_OK)
        return ls_fail(diag, LS_ERR_REFUSED, "the certificate of %s is not trusted: %s",
                       place->host, X509_verify_cert_error_string(verdict));
    if (error == SSL_ERROR_WANT_READ || error == SSL_ERROR_WANT_WRITE)
        return ls_fail(diag, LS_ERR_TIMEOUT, "%s port %s: no TLS handshake within %d s",
                       place->host, place->port, PATIENCE_S);
    return ls_fail(diag, LS_ERR_REFUSED, "%s port %s: TLS handshake: %s", place->host, place->port,
                   ls_tls_why());
}

static enum ls_err open_secure(struct ls_secure *secure, const struct ls_remote *remote,
                               struct ls_diag *diag)
{
    struct place place;
    enum ls_err err = parse(remote->url, &place, diag);
    if (!err && !(remote->certificate && remote->key && remote->authority))
        err = ls_fail(diag, LS_ERR_INVALID,
                      "%s: expected --certificate, --key and --authority (or "
                      "LIGHTSTAGED_CERTIFICATE, LIGHTSTAGED_KEY and LIGHTSTAGED_AUTHORITY)",
                      remote->url);
    if (!err)
        err = ls_tls_create(false, remote->certificate, remote->key, remote->authority,
                            &secure->tls, diag);
    if (!err)
        err = connect_to(&place, &secure->fd, diag);
    if (err)
        return err;
    secure->ssl = ls_tls_attach(secure->tls, secure->fd);
    if (!secure->ssl || !expect_host(secure->ssl, place.host))
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    SSL_set_read_ahead(secure->ssl, 1); /* many records to a system call */
    SSL_set_default_read_buffer_len(secure->ssl, BUFFER_BYTES);
    err = shake_hands(secure, &place, diag);
    limit_waiting(secure->fd, 0);
    return err;
}

enum ls_err ls_secure_connect(const struct ls_remote *remote, struct ls_secure **out,
                              struct ls_diag *diag)
{
    struct ls_secure *secure = calloc(1, sizeof *secure);
    if (!secure)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    secure->fd = -1;
    enum ls_err err = open_secure(secure, remote, diag);
    if (err)
        ls_secure_close(secure);
    else
        *out = secure;
    return err;
}

int ls_secure_fd(const struct ls_secure *secure)
{
    return secure->fd;
}

bool ls_secure_has_bytes(const struct ls_secure *secure)
{
    return SSL_has_pending(secure->ssl) == 1;
}

/* A lost connection, or what its last alert said. */
static enum ls_err lost(struct ls_diag *diag)
{
    unsigned long code = ERR_peek_last_error();
    bool alert = ERR_GET_LIB(code) == ERR_LIB_SSL && ERR_GET_REASON(code) >= SSL_AD_REASON_OFFSET;
    const char *why = ls_tls_why();
    return alert ? ls_fail(diag, LS_ERR_GONE,
                           "the daemon ended the connection: %s; its log says "
                           "more",
                           why)
                 : ls_fail(diag, LS_ERR_GONE, "the connection to the daemon is lost");
}

enum ls_err ls_secure_write(struct ls_secure *secure, const void *bytes, size_t n,
                            struct ls_diag *diag)
{
    size_t wrote = 0;
    for (size_t at = 0; at < n; at += wrote) {
        wrote = 0;
        ERR_clear_error();
        int result = SSL_write_ex(secure->ssl, (const char *)bytes + at, n - at, &wrote);
        if (result != 1 && SSL_get_error(secure->ssl, result) != SSL_ERROR_WANT_WRITE)
            return lost(diag);
    }
    return LS_OK;
}

enum ls_err ls_secure_read(struct ls_secure *secure, void *bytes, size_t size, size_t *n,
                           struct ls_diag *diag)
{
    ERR_clear_error();
    int result = SSL_read_ex(secure->ssl, bytes, size, n);
    if (result == 1)
        return LS_OK;
    return SSL_get_error(secure->ssl, result) == SSL_ERROR_WANT_READ
               ? ls_fail(diag, LS_ERR_ABORTED, "interrupted")
               : lost(diag);
}
