#include "proto/tls.h"

#include <errno.h>
#include <openssl/err.h>
#include <openssl/x509.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/stat.h>

struct ls_tls {
    SSL_CTX *context;
    BIO_METHOD *socket;
};

const char *ls_tls_why(void)
{
    unsigned long code = ERR_peek_last_error();
    const char *text = code ? ERR_reason_error_string(code) : NULL;
    ERR_clear_error();
    return text ? text : "no reason given";
}

/* ---- certificates ---- */

static enum ls_err check_key_mode(const char *path, struct ls_diag *diag)
{
    struct stat info;
    if (stat(path, &info))
        return ls_fail(diag, LS_ERR_INVALID, "key %s: %s", path, strerror(errno));
    if (info.st_mode & (S_IROTH | S_IWOTH))
        return ls_fail(diag, LS_ERR_INVALID,
                       "key %s: everybody may read or write it; make its mode 0600", path);
    return LS_OK;
}

static enum ls_err check_dates(SSL_CTX *context, const char *path, struct ls_diag *diag)
{
    X509 *certificate = SSL_CTX_get0_certificate(context);
    if (X509_cmp_current_time(X509_get0_notAfter(certificate)) < 0)
        return ls_fail(diag, LS_ERR_INVALID, "certificate %s: it has expired", path);
    if (X509_cmp_current_time(X509_get0_notBefore(certificate)) > 0)
        return ls_fail(diag, LS_ERR_INVALID, "certificate %s: it is not valid yet", path);
    return LS_OK;
}

static enum ls_err load(SSL_CTX *context, const char *certificate, const char *key,
                        const char *authority, struct ls_diag *diag)
{
    if (SSL_CTX_use_certificate_chain_file(context, certificate) != 1)
        return ls_fail(diag, LS_ERR_INVALID, "certificate %s: %s", certificate, ls_tls_why());
    enum ls_err err = check_key_mode(key, diag);
    if (err)
        return err;
    if (SSL_CTX_use_PrivateKey_file(context, key, SSL_FILETYPE_PEM) != 1 ||
        SSL_CTX_check_private_key(context) != 1)
        return ls_fail(diag, LS_ERR_INVALID, "key %s, of certificate %s: %s", key, certificate,
                       ls_tls_why());
    if (SSL_CTX_load_verify_file(context, authority) != 1)
        return ls_fail(diag, LS_ERR_INVALID, "authority %s: %s", authority, ls_tls_why());
    return check_dates(context, certificate, diag);
}

static bool set_rules(SSL_CTX *context)
{
    SSL_CTX_set_verify(context, SSL_VERIFY_PEER | SSL_VERIFY_FAIL_IF_NO_PEER_CERT, NULL);
    SSL_CTX_set_session_cache_mode(context, SSL_SESS_CACHE_OFF);
    SSL_CTX_set_mode(context, SSL_MODE_ENABLE_PARTIAL_WRITE | SSL_MODE_ACCEPT_MOVING_WRITE_BUFFER |
                                  SSL_MODE_RELEASE_BUFFERS);
    SSL_CTX_set_options(context, SSL_OP_CIPHER_SERVER_PREFERENCE | SSL_OP_PRIORITIZE_CHACHA |
                                     SSL_OP_NO_TICKET);
    return SSL_CTX_set_min_proto_version(context, TLS1_3_VERSION) == 1 &&
           SSL_CTX_set_max_proto_version(context, TLS1_3_VERSION) == 1 &&
           SSL_CTX_set_num_tickets(context, 0) == 1 &&
           SSL_CTX_set_ciphersuites(context, "TLS_AES_128_GCM_SHA256:TLS_AES_256_GCM_SHA384:"
                                             "TLS_CHACHA20_POLY1305_SHA256") == 1;
}

/* ---- a socket that raises no SIGPIPE ---- */

static int quiet_write(BIO *bio, const char *bytes, int n)
{
    BIO_clear_retry_flags(bio);
    ssize_t sent = send((int)BIO_get_fd(bio, NULL), bytes, (size_t)n, MSG_NOSIGNAL);
    if (sent <= 0 && BIO_sock_should_retry((int)sent))
        BIO_set_retry_write(bio);
    return (int)sent;
}

static BIO_METHOD *quiet_socket(void)
{
    const BIO_METHOD *plain = BIO_s_socket();
    BIO_METHOD *quiet = BIO_meth_new(BIO_TYPE_SOCKET, "quiet socket");
    if (quiet && BIO_meth_set_write(quiet, quiet_write) &&
        BIO_meth_set_read(quiet, BIO_meth_get_read(plain)) &&
        BIO_meth_set_ctrl(quiet, BIO_meth_get_ctrl(plain)) &&
        BIO_meth_set_create(quiet, BIO_meth_get_create(plain)) &&
        BIO_meth_set_destroy(quiet, BIO_meth_get_destroy(plain)))
        return quiet;
    BIO_meth_free(quiet);
    return NULL;
}

/* ---- life ---- */

enum ls_err ls_tls_create(bool server, const char *certificate, const char *key,
                          const char *authority, struct ls_tls **out, struct ls_diag *diag)
{
    struct ls_tls *tls = calloc(1, sizeof *tls);
    if (!tls)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    tls->context = SSL_CTX_new(server ? TLS_server_method() : TLS_client_method());
    tls->socket = quiet_socket();
    enum ls_err err = tls->context && tls->socket && set_rules(tls->context)
                          ? load(tls->context, certificate, key, authority, diag)
                          : ls_fail(diag, LS_ERR_OS, "OpenSSL: %s", ls_tls_why());
    if (err)
        ls_tls_destroy(tls);
    else
        *out = tls;
    return err;
}

void ls_tls_destroy(struct ls_tls *tls)
{
    if (!tls)
        return;
    SSL_CTX_free(tls->context);
    BIO_meth_free(tls->socket);
    free(tls);
}

SSL *ls_tls_attach(struct ls_tls *tls, int fd)
{
    SSL *ssl = SSL_new(tls->context);
    BIO *bio = ssl ? BIO_new(tls->socket) : NULL;
    if (!bio) {
        SSL_free(ssl);
        return NULL;
    }
    BIO_set_fd(bio, fd, BIO_NOCLOSE);
    SSL_set_bio(ssl, bio, bio);
    return ssl;
}
