#include "clients/certificates.h"

#include <arpa/inet.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <openssl/err.h>
#include <openssl/evp.h>
#include <openssl/pem.h>
#include <openssl/rand.h>
#include <openssl/x509v3.h>
#include <stdbool.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

enum { SERIAL_BYTES = 16, DAY_S = 24 * 60 * 60, MAX_HOSTS = 16, HOST_CHARACTERS = 255 };

/* Who is certified, and by whom. */
struct pair {
    X509 *certificate;
    EVP_PKEY *key;
};

static void finish(struct pair *pair)
{
    X509_free(pair->certificate);
    EVP_PKEY_free(pair->key);
}

static enum ls_err failed(struct ls_diag *diag)
{
    const char *text = ERR_reason_error_string(ERR_peek_last_error());
    ERR_clear_error();
    return ls_fail(diag, LS_ERR_OS, "OpenSSL: %s", text ? text : "no reason given");
}

/* ---- what a certificate says ---- */

static bool extend(X509 *certificate, X509 *issuer, int what, const char *value)
{
    X509V3_CTX context;
    X509V3_set_ctx_nodb(&context);
    X509V3_set_ctx(&context, issuer, certificate, NULL, NULL, 0);
    X509_EXTENSION *extension = X509V3_EXT_conf_nid(NULL, &context, what, value);
    bool ok = extension && X509_add_ext(certificate, extension, -1) == 1;
    X509_EXTENSION_free(extension);
    return ok;
}

static bool is_address(const char *host)
{
    struct in6_addr binary;
    return inet_pton(AF_INET, host, &binary) == 1 || inet_pton(AF_INET6, host, &binary) == 1;
}

/* A comma or an equals sign would say more than a name. */
static bool is_host(const char *host)
{
    static const char letters[] =
        "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789-._*";
    size_t n = strlen(host);
    return is_address(host) || (n > 0 && n <= HOST_CHARACTERS && strspn(host, letters) == n);
}

static enum ls_err add_hosts(X509 *certificate, X509 *issuer,
                             const struct ls_certificate_wish *wish, struct ls_diag *diag)
{
    char text[MAX_HOSTS * (HOST_CHARACTERS + 8)] = "";
    size_t used = 0;
    if (wish->n_hosts > MAX_HOSTS)
        return ls_fail(diag, LS_ERR_INVALID, "%zu hosts: at most %d", wish->n_hosts, MAX_HOSTS);
    for (size_t i = 0; i < wish->n_hosts; i++) {
        const char *host = wish->hosts[i];
        if (!is_host(host))
            return ls_fail(diag, LS_ERR_INVALID, "\"%.255s\": expected a host's name or address",
                           host);
        used += (size_t)snprintf(text + used, sizeof text - used, "%s%s:%s", i ? "," : "",
                                 is_address(host) ? "IP" : "DNS", host);
    }
    return used == 0 || extend(certificate, issuer, NID_subject_alt_name, text) ? LS_OK
                                                                                : failed(diag);
}

static bool add_uses(X509 *certificate, X509 *issuer, enum ls_certificate_use use)
{
    static const char *const constraints[] = {"critical,CA:TRUE,pathlen:0", "critical,CA:FALSE",
                                              "critical,CA:FALSE"};
    static const char *const keys[] = {"critical,keyCertSign,cRLSign", "critical,digitalSignature",
                                       "critical,digitalSignature"};
    static const char *const purposes[] = {NULL, "serverAuth", "clientAuth"};
    return extend(certificate, issuer, NID_basic_constraints, constraints[use]) &&
           extend(certificate, issuer, NID_key_usage, keys[use]) &&
           extend(certificate, issuer, NID_subject_key_identifier, "hash") &&
           extend(certificate, issuer, NID_authority_key_identifier, "keyid:always") &&
           (!purposes[use] || extend(certificate, issuer, NID_ext_key_usage, purposes[use]));
}

static bool number(X509 *certificate)
{
    unsigned char bytes[SERIAL_BYTES];
    if (RAND_bytes(bytes, sizeof bytes) != 1)
        return false;
    bytes[0] = (bytes[0] & 0x7f) | 0x40; /* positive, and never shorter */
    BIGNUM *serial = BN_bin2bn(bytes, sizeof bytes, NULL);
    bool ok = serial && BN_to_ASN1_INTEGER(serial, X509_get_serialNumber(certificate));
    BN_free(serial);
    return ok;
}

static bool describe(X509 *certificate, const X509 *issuer, EVP_PKEY *key,
                     const struct ls_certificate_wish *wish)
{
    X509_NAME *name = X509_get_subject_name(certificate);
    return X509_set_version(certificate, X509_VERSION_3) == 1 && number(certificate) &&
           X509_gmtime_adj(X509_getm_notBefore(certificate),
                           wish->from_days * DAY_S - DAY_S / 24) &&
           X509_gmtime_adj(X509_getm_notAfter(certificate),
                           (wish->from_days + wish->days) * DAY_S) &&
           X509_NAME_add_entry_by_txt(name, "CN", MBSTRING_UTF8, (const unsigned char *)wish->name,
                                      -1, -1, 0) == 1 &&
           X509_set_issuer_name(certificate, X509_get_subject_name(issuer)) == 1 &&
           X509_set_pubkey(certificate, key) == 1;
}

/* @authority signs; without one it signs itself. */
static enum ls_err create(const struct ls_certificate_wish *wish, const struct pair *authority,
                          struct pair *out, struct ls_diag *diag)
{
    out->key = EVP_EC_gen("P-256");
    out->certificate = X509_new();
    const struct pair *signer = authority ? authority : out;
    if (!out->key || !out->certificate ||
        !describe(out->certificate, signer->certificate, out->key, wish) ||
        !add_uses(out->certificate, signer->certificate, wish->use))
        return failed(diag);
    enum ls_err err = add_hosts(out->certificate, signer->certificate, wish, diag);
    if (err)
        return err;
    return X509_sign(out->certificate, signer->key, EVP_sha256()) ? LS_OK : failed(diag);
}

/* ---- files ---- */

static enum ls_err path_of(const char *folder, const char *stem, const char *suffix,
                           char path[PATH_MAX], struct ls_diag *diag)
{
    return snprintf(path, PATH_MAX, "%s/%s%s", folder, stem, suffix) < PATH_MAX
               ? LS_OK
               : ls_fail(diag, LS_ERR_INVALID, "%s: the path is too long", folder);
}

static enum ls_err new_file(const char *folder, const char *stem, const char *suffix, FILE **out,
                            struct ls_diag *diag)
{
    char path[PATH_MAX];
    enum ls_err err = path_of(folder, stem, suffix, path, diag);
    if (err)
        return err;
    int fd = open(path, O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0600);
    if (fd < 0)
        return ls_fail(diag, errno == EEXIST ? LS_ERR_EXISTS : LS_ERR_INVALID, "%s: %s", path,
                       errno == EEXIST ? "it is there already, and is kept" : strerror(errno));
    *out = fdopen(fd, "w");
    return LS_OK;
}

static enum ls_err save(const struct pair *pair, const char *folder, const char *stem,
                        struct ls_diag *diag)
{
    FILE *key = NULL, *certificate = NULL;
    enum ls_err err = new_file(folder, stem, ".key", &key, diag);
    if (err)
        return err;
    bool ok = PEM_write_PrivateKey(key, pair->key, NULL, NULL, 0, NULL, NULL) == 1;
    ok = fclose(key) == 0 && ok;
    err = new_file(folder, stem, ".pem", &certificate, diag);
    if (err)
        return err;
    ok = PEM_write_X509(certificate, pair->certificate) == 1 && ok;
    ok = fclose(certificate) == 0 && ok;
    return ok ? LS_OK : ls_fail(diag, LS_ERR_INVALID, "%s/%s: cannot be written", folder, stem);
}

static enum ls_err load(const char *folder, const char *stem, struct pair *out,
                        struct ls_diag *diag)
{
    char path[PATH_MAX];
    enum ls_err err = path_of(folder, stem, ".pem", path, diag);
    FILE *file = err ? NULL : fopen(path, "re");
    if (file) {
        out->certificate = PEM_read_X509(file, NULL, NULL, NULL);
        fclose(file);
    }
    err = err ? err : path_of(folder, stem, ".key", path, diag);
    file = err ? NULL : fopen(path, "re");
    if (file) {
        out->key = PEM_read_PrivateKey(file, NULL, NULL, NULL);
        fclose(file);
    }
    ERR_clear_error();
    if (!err && !(out->certificate && out->key))
        err = ls_fail(diag, LS_ERR_NOT_FOUND,
                      "%s: no authority there (%s.pem, %s.key): make one with pki init", folder,
                      stem, stem);
    return err;
}

enum ls_err ls_certificate_make(const char *folder, const char *stem, const char *authority,
                                const struct ls_certificate_wish *wish, struct ls_diag *diag)
{
    struct pair signer = {0}, made = {0};
    enum ls_err err = authority ? load(folder, authority, &signer, diag) : LS_OK;
    if (!err)
        err = create(wish, authority ? &signer : NULL, &made, diag);
    if (!err)
        err = save(&made, folder, stem, diag);
    finish(&signer);
    finish(&made);
    return err;
}
