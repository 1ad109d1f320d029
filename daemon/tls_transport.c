#include "daemon/tls_transport.h"

#include <glib.h>
#include <openssl/err.h>
#include <openssl/x509.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

enum { RECORD_BYTES = 16384 }; /* RFC 8446, 5.1 */

struct tls_transport {
    struct ls_transport base;
    SSL *ssl;
    GMutex lock; /* of ssl */
    bool greeted, broken;
    uint8_t record[RECORD_BYTES]; /* small spans put together */
};

/* ---- bytes ---- */

/* After a call that moved nothing: later, or never again? */
static enum ls_err later(struct tls_transport *self, int result)
{
    int error = SSL_get_error(self->ssl, result);
    if (error == SSL_ERROR_WANT_READ || error == SSL_ERROR_WANT_WRITE)
        return LS_OK;
    self->broken = true;
    ERR_clear_error();
    return LS_ERR_GONE;
}

static enum ls_err tls_read(struct ls_transport *transport, void *bytes, size_t size, size_t *n)
{
    struct tls_transport *self = (struct tls_transport *)transport;
    *n = 0;
    g_mutex_lock(&self->lock);
    int result = self->broken ? 0 : SSL_read_ex(self->ssl, bytes, size, n);
    enum ls_err err = result == 1 ? LS_OK : self->broken ? LS_ERR_GONE : later(self, result);
    g_mutex_unlock(&self->lock);
    return err;
}

/* The next record's bytes: where they lie if they fill one, else copied together. */
static const void *next_record(struct tls_transport *self, const struct iovec *spans,
                               size_t n_spans, size_t *n)
{
    size_t used = 0;
    if (n_spans == 1 || spans[0].iov_len >= RECORD_BYTES) {
        *n = MIN(spans[0].iov_len, RECORD_BYTES);
        return spans[0].iov_base;
    }
    for (size_t i = 0; i < n_spans && used < RECORD_BYTES; i++) {
        size_t part = MIN(spans[i].iov_len, RECORD_BYTES - used);
        memcpy(self->record + used, spans[i].iov_base, part);
        used += part;
    }
    *n = used;
    return self->record;
}

static enum ls_err tls_write(struct ls_transport *transport, const struct iovec *spans,
                             size_t n_spans, size_t *n)
{
    struct tls_transport *self = (struct tls_transport *)transport;
    size_t size = 0;
    *n = 0;
    g_mutex_lock(&self->lock);
    const void *bytes = next_record(self, spans, n_spans, &size);
    int result = self->broken ? 0 : SSL_write_ex(self->ssl, bytes, size, n);
    enum ls_err err = result == 1 ? LS_OK : self->broken ? LS_ERR_GONE : later(self, result);
    g_mutex_unlock(&self->lock);
    return err;
}

static void tls_shut(struct ls_transport *transport)
{
    struct tls_transport *self = (struct tls_transport *)transport;
    g_mutex_lock(&self->lock);
    if (self->greeted && !self->broken)
        SSL_shutdown(self->ssl);
    self->broken = true;
    ERR_clear_error();
    g_mutex_unlock(&self->lock);
    ls_transport_drain(transport->fd);
    shutdown(transport->fd, SHUT_RDWR);
}

static void tls_destroy(struct ls_transport *transport)
{
    struct tls_transport *self = (struct tls_transport *)transport;
    SSL_free(self->ssl);
    g_mutex_clear(&self->lock);
    close(transport->fd);
    g_free(self);
}

static const struct ls_transport_ops tls_ops = {"tls", tls_read, tls_write, tls_shut, tls_destroy};

struct ls_transport *ls_transport_tls(struct ls_tls *tls, int fd)
{
    SSL *ssl = ls_tls_attach(tls, fd);
    if (!ssl) {
        close(fd);
        return NULL;
    }
    struct tls_transport *self = g_new0(struct tls_transport, 1);
    self->base = (struct ls_transport){&tls_ops, fd};
    self->ssl = ssl;
    g_mutex_init(&self->lock);
    SSL_set_accept_state(ssl);
    return &self->base;
}

/* ---- the handshake ---- */

static enum ls_err refused(struct tls_transport *self, int error, struct ls_diag *diag)
{
    long verdict = SSL_get_verify_result(self->ssl);
    self->broken = true;
    if (verdict != X509_V_OK) {
        ERR_clear_error();
        return ls_fail(diag, LS_ERR_REFUSED, "its certificate: %s",
                       X509_verify_cert_error_string(verdict));
    }
    if (error == SSL_ERROR_SYSCALL || error == SSL_ERROR_ZERO_RETURN) {
        ERR_clear_error();
        return ls_fail(diag, LS_ERR_REFUSED, "it left in the middle of the handshake");
    }
    return ls_fail(diag, LS_ERR_REFUSED, "%s", ls_tls_why());
}

enum ls_err ls_tls_transport_handshake(struct ls_transport *transport, enum ls_tls_step *step,
                                       struct ls_diag *diag)
{
    struct tls_transport *self = (struct tls_transport *)transport;
    ERR_clear_error();
    int result = SSL_do_handshake(self->ssl);
    int error = result == 1 ? SSL_ERROR_NONE : SSL_get_error(self->ssl, result);
    *step = error == SSL_ERROR_NONE         ? LS_TLS_DONE
            : error == SSL_ERROR_WANT_WRITE ? LS_TLS_WANTS_OUT
                                            : LS_TLS_WANTS_IN;
    self->greeted = result == 1;
    if (result == 1 || error == SSL_ERROR_WANT_READ || error == SSL_ERROR_WANT_WRITE)
        return LS_OK;
    return refused(self, error, diag);
}

void ls_tls_transport_peer(struct ls_transport *transport, char *name, size_t size)
{
    struct tls_transport *self = (struct tls_transport *)transport;
    X509 *certificate = SSL_get0_peer_certificate(self->ssl);
    int n = certificate ? X509_NAME_get_text_by_NID(X509_get_subject_name(certificate),
                                                    NID_commonName, name, (int)size)
                        : -1;
    bool plain = n > 0 && (size_t)n < size && strlen(name) == (size_t)n;
    for (int i = 0; plain && i < n; i++)
        plain = g_ascii_isprint(name[i]);
    if (!plain)
        name[0] = '\0';
}
