/* tls: who comes in from another machine, who does not, and what those who only knock can do. */
#include "clients/certificates.h"
#include "proto/errors.h"
#include "proto/frame.h"
#include "tests/daemon/server_verbs.h"

#include <netinet/in.h>
#include <netinet/tcp.h>
#include <openssl/ssl.h>
#include <poll.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

enum { LONG_MS = 600000 /* of a limit that is not the one looked at */ };

static const char *const hosts[] = {"localhost", "127.0.0.1"};

struct hall {
    struct stage stage;
    struct ls_access access;
    struct ls_listen_config listen;
    char *pki;
    unsigned port;
};

/* What the daemon has logged. */
struct log {
    GMutex lock;
    GCond more;
    GString *text;
};

static void keep_line(const char *domain, GLogLevelFlags level, const char *line, gpointer data)
{
    struct log *log = data;
    g_mutex_lock(&log->lock);
    g_string_append_printf(log->text, "%s\n", line);
    g_cond_signal(&log->more);
    g_mutex_unlock(&log->lock);
}

/* Within 5 s, on a thread of its own. */
static void is_logged(struct log *log, const char *words)
{
    int64_t limit_us = g_get_monotonic_time() + 5 * G_USEC_PER_SEC;
    g_mutex_lock(&log->lock);
    while (!strstr(log->text->str, words))
        if (!g_cond_wait_until(&log->more, &log->lock, limit_us))
            g_error("\"%s\" is not in the log: %s", words, log->text->str);
    g_mutex_unlock(&log->lock);
}

static void certify(const struct hall *hall, const char *stem, const char *authority,
                    struct ls_certificate_wish wish)
{
    struct ls_diag diag = {0};
    wish.name = wish.name ? wish.name : stem;
    wish.days = wish.days ? wish.days : 1;
    g_assert_cmpint(ls_certificate_make(hall->pki, stem, authority, &wish, &diag), ==, LS_OK);
}

static char *file(const struct hall *hall, const char *stem, const char *suffix)
{
    return g_strdup_printf("%s/%s%s", hall->pki, stem, suffix);
}

static void hall_init(struct hall *hall)
{
    memset(hall, 0, sizeof *hall);
    stage_init(&hall->stage);
    hall->pki = hall->stage.folder;
    hall->access = (struct ls_access){.operators = {{g_strdup("desk")}, 1},
                                      .readers = {{g_strdup("node")}, 1}};
    certify(hall, "authority", NULL, (struct ls_certificate_wish){LS_CERTIFICATE_AUTHORITY});
    certify(hall, "server", "authority",
            (struct ls_certificate_wish){LS_CERTIFICATE_SERVER, .hosts = hosts, .n_hosts = 2});
    certify(hall, "desk", "authority", (struct ls_certificate_wish){LS_CERTIFICATE_CLIENT});
    certify(hall, "node", "authority", (struct ls_certificate_wish){LS_CERTIFICATE_CLIENT});
    hall->listen = (struct ls_listen_config){.address = g_strdup("127.0.0.1"),
                                             .certificate = file(hall, "server", ".pem"),
                                             .key = file(hall, "server", ".key"),
                                             .authority = file(hall, "authority", ".pem")};
    hall->stage.limits.access = &hall->access;
    hall->stage.limits.listen = &hall->listen;
}

static void hall_open(struct hall *hall)
{
    stage_open(&hall->stage);
    hall->port = (unsigned)g_ascii_strtoull(
        strrchr(ls_server_remote_address(hall->stage.server), ':') + 1, NULL, 10);
}

static void hall_close(struct hall *hall)
{
    stage_close(&hall->stage);
    ls_access_finish(&hall->access);
    ls_listen_config_finish(&hall->listen);
}

/* With the certificate of @who, @trusting an authority. */
static enum ls_err enter(const struct hall *hall, const char *host, const char *who,
                         const char *trusting, struct ls_connection **client, struct ls_diag *diag)
{
    g_autofree char *url = g_strdup_printf("tls://%s:%u", host, hall->port);
    g_autofree char *certificate = file(hall, who, ".pem"), *key = file(hall, who, ".key");
    g_autofree char *authority = file(hall, trusting, ".pem");
    const struct ls_remote remote = {url, certificate, key, authority};
    *client = NULL;
    return ls_connection_open_remote(&remote, client, diag);
}

static struct ls_connection *enter_as(const struct hall *hall, const char *who)
{
    struct ls_connection *client;
    struct ls_diag diag = {0};
    enum ls_err err = enter(hall, "localhost", who, "authority", &client, &diag);
    g_assert_cmpstr(diag.text, ==, "");
    g_assert_cmpint(err, ==, LS_OK);
    return client;
}

static void stays_out(const struct hall *hall, const char *who, enum ls_err wanted,
                      const char *words)
{
    struct ls_connection *client;
    struct ls_diag diag = {0};
    g_assert_cmpint(enter(hall, "localhost", who, "authority", &client, &diag), ==, wanted);
    if (!strstr(diag.text, words))
        g_error("%s: \"%s\" does not say \"%s\"", who, diag.text, words);
    g_assert_null(client);
}

static uint32_t ask_blank(struct ls_connection *client)
{
    Lightstage__Blank blank = LIGHTSTAGE__BLANK__INIT;
    return ask(client, LS_MESSAGE_BLANK, &blank.base, NULL, NULL);
}

static uint32_t ask_status(struct ls_connection *client)
{
    Lightstage__Status status = LIGHTSTAGE__STATUS__INIT;
    return ask(client, LS_MESSAGE_STATUS, &status.base, NULL, NULL);
}

static void a_certificates_name_is_its_role(void)
{
    struct hall hall;
    hall_init(&hall);
    hall_open(&hall);
    struct ls_connection *desk = enter_as(&hall, "desk"), *node = enter_as(&hall, "node");
    g_assert_cmpuint(ask_status(node), ==, 0);
    g_assert_cmpuint(ask_blank(node), ==, LS_PROTO_NOT_ALLOWED);
    g_assert_cmpuint(engine_state(&hall.stage).blanked, ==, 0);
    g_assert_cmpuint(ask_blank(desk), ==, 0);
    g_assert_cmpuint(engine_state(&hall.stage).blanked, ==, 1);
    ls_connection_close(desk);
    ls_connection_close(node);
    hall_close(&hall);
}

static void who_has_no_good_certificate_stays_out(void)
{
    struct hall hall;
    hall_init(&hall);
    certify(&hall, "stranger", "authority", (struct ls_certificate_wish){LS_CERTIFICATE_CLIENT});
    certify(&hall, "expired", "authority",
            (struct ls_certificate_wish){LS_CERTIFICATE_CLIENT, "desk", .from_days = -9});
    certify(&hall, "early", "authority",
            (struct ls_certificate_wish){LS_CERTIFICATE_CLIENT, "desk", .from_days = 9});
    certify(&hall, "elsewhere", NULL, (struct ls_certificate_wish){LS_CERTIFICATE_AUTHORITY});
    certify(&hall, "foreign", "elsewhere",
            (struct ls_certificate_wish){LS_CERTIFICATE_CLIENT, "desk"});
    certify(&hall, "disguised", "authority",
            (struct ls_certificate_wish){LS_CERTIFICATE_SERVER, "desk"});
    hall_open(&hall);
    stays_out(&hall, "stranger", LS_ERR_REFUSED, "\"stranger\" is neither");
    stays_out(&hall, "expired", LS_ERR_INVALID, "it has expired");
    stays_out(&hall, "early", LS_ERR_INVALID, "not valid yet");
    stays_out(&hall, "foreign", LS_ERR_GONE, "unknown ca");
    stays_out(&hall, "disguised", LS_ERR_GONE, "the daemon ended the connection");
    ls_connection_close(enter_as(&hall, "desk"));
    hall_close(&hall);
}

static void a_client_trusts_no_other_daemon(void)
{
    struct hall hall;
    struct ls_connection *client;
    struct ls_diag diag = {0};
    hall_init(&hall);
    certify(&hall, "elsewhere", NULL, (struct ls_certificate_wish){LS_CERTIFICATE_AUTHORITY});
    hall_open(&hall);
    g_assert_cmpint(enter(&hall, "localhost", "desk", "elsewhere", &client, &diag), ==,
                    LS_ERR_REFUSED);
    g_assert_nonnull(strstr(diag.text, "is not trusted"));
    g_assert_cmpint(enter(&hall, "127.0.0.2", "desk", "authority", &client, &diag), ==,
                    LS_ERR_NOT_FOUND); /* it listens at 127.0.0.1 alone */
    hall_close(&hall);
}

static void a_client_wants_the_host_it_asked_for(void)
{
    struct hall hall;
    struct ls_connection *client;
    struct ls_diag diag = {0};
    static const char *const others[] = {"other.example"};
    hall_init(&hall);
    certify(&hall, "other", "authority",
            (struct ls_certificate_wish){LS_CERTIFICATE_SERVER, .hosts = others, .n_hosts = 1});
    g_free(hall.listen.certificate);
    g_free(hall.listen.key);
    hall.listen.certificate = file(&hall, "other", ".pem");
    hall.listen.key = file(&hall, "other", ".key");
    hall_open(&hall);
    g_assert_cmpint(enter(&hall, "localhost", "desk", "authority", &client, &diag), ==,
                    LS_ERR_REFUSED);
    g_assert_nonnull(strstr(diag.text, "hostname mismatch"));
    g_assert_cmpint(enter(&hall, "127.0.0.1", "desk", "authority", &client, &diag), ==,
                    LS_ERR_REFUSED);
    g_assert_nonnull(strstr(diag.text, "IP address mismatch"));
    hall_close(&hall);
}

/* ---- bare sockets ---- */

static int knock(const struct hall *hall)
{
    struct sockaddr_in to = {.sin_family = AF_INET, .sin_port = htons((uint16_t)hall->port)};
    to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    int fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    g_assert_cmpint(connect(fd, (const struct sockaddr *)&to, sizeof to), ==, 0);
    return fd;
}

/* Whatever it still says, it hangs up within 10 s. */
static void is_hung_up_on(int fd)
{
    char bytes[4096];
    struct pollfd wait = {fd, POLLIN, 0};
    do
        g_assert_cmpint(poll(&wait, 1, 10000), ==, 1);
    while (recv(fd, bytes, sizeof bytes, 0) > 0);
    close(fd);
}

static bool shakes_hands(const struct hall *hall, int version, const char *who)
{
    int fd = knock(hall);
    SSL_CTX *context = SSL_CTX_new(TLS_client_method());
    g_autofree char *certificate = file(hall, who, ".pem"), *key = file(hall, who, ".key");
    SSL_CTX_set_max_proto_version(context, version);
    if (SSL_CTX_use_certificate_file(context, certificate, SSL_FILETYPE_PEM) == 1)
        g_assert_cmpint(SSL_CTX_use_PrivateKey_file(context, key, SSL_FILETYPE_PEM), ==, 1);
    SSL *ssl = SSL_new(context);
    SSL_set_fd(ssl, fd);
    uint8_t byte;
    static const uint8_t frame[LS_FRAME_HEADER_BYTES] = {'x'}; /* is answered with an Error */
    bool in = SSL_connect(ssl) == 1 && SSL_write(ssl, frame, sizeof frame) > 0 &&
              SSL_read(ssl, &byte, 1) == 1;
    SSL_free(ssl);
    SSL_CTX_free(context);
    close(fd);
    return in;
}

static void nothing_older_than_1_3_and_nobody_without_a_certificate(void)
{
    struct hall hall;
    struct log log = {.text = g_string_new(NULL)};
    GLogFunc before = g_log_set_default_handler(keep_line, &log);
    hall_init(&hall);
    certify(&hall, "expired", "authority",
            (struct ls_certificate_wish){LS_CERTIFICATE_CLIENT, "desk", .from_days = -9});
    hall_open(&hall);
    g_assert_true(shakes_hands(&hall, TLS1_3_VERSION, "desk"));
    g_assert_false(shakes_hands(&hall, TLS1_2_VERSION, "desk"));
    g_assert_false(shakes_hands(&hall, TLS1_3_VERSION, "nobody"));
    g_assert_false(shakes_hands(&hall, TLS1_3_VERSION, "expired"));
    is_logged(&log, "unsupported protocol");
    is_logged(&log, "peer did not return a certificate");
    is_logged(&log, "its certificate: certificate has expired");
    hall_close(&hall);
    g_log_set_default_handler(before, NULL);
    g_string_free(log.text, TRUE);
}

static void who_only_knocks_is_hung_up_on(void)
{
    struct hall hall;
    hall_init(&hall);
    hall.stage.limits.hello_ms = 300;
    hall_open(&hall);
    int silent = knock(&hall), half = knock(&hall), garbage = knock(&hall);
    static const uint8_t beginning[] = {22, 3, 1, 2, 0, 1}; /* of a ClientHello */
    g_assert_cmpint(send(half, beginning, sizeof beginning, 0), ==, sizeof beginning);
    g_assert_cmpint(send(garbage, "GET / HTTP/1.0\r\n\r\n", 18, 0), ==, 18);
    ls_connection_close(enter_as(&hall, "node")); /* meanwhile */
    is_hung_up_on(garbage);
    is_hung_up_on(silent);
    is_hung_up_on(half);
    ls_connection_close(enter_as(&hall, "node"));
    hall_close(&hall);
}

static void a_crowd_at_the_door_keeps_nobody_out(void)
{
    enum { CROWD = 100 };
    struct hall hall;
    int crowd[CROWD];
    hall_init(&hall);
    hall.stage.limits.hello_ms = LONG_MS;
    hall_open(&hall);
    for (size_t i = 0; i < CROWD; i++)
        crowd[i] = knock(&hall);
    struct ls_connection *node = enter_as(&hall, "node");
    is_hung_up_on(crowd[0]); /* at most 32 stand there */
    g_assert_cmpuint(ask_status(node), ==, 0);
    ls_connection_close(node);
    for (size_t i = 1; i < CROWD; i++)
        close(crowd[i]);
    hall_close(&hall);
}

/* The daemon's end of a connection, or -1. */
static int other_end(int fd)
{
    struct sockaddr_in ours = {0}, theirs;
    socklen_t n = sizeof ours;
    g_assert_cmpint(getsockname(fd, (struct sockaddr *)&ours, &n), ==, 0);
    for (int k = 3; k < 1024; k++) {
        n = sizeof theirs;
        if (k != fd && !getpeername(k, (struct sockaddr *)&theirs, &n) &&
            theirs.sin_family == AF_INET && theirs.sin_port == ours.sin_port)
            return k;
    }
    return -1;
}

static int option_of(int fd, int level, int option)
{
    int value = 0;
    socklen_t n = sizeof value;
    return fd >= 0 && !getsockopt(fd, level, option, &value, &n) ? value : 0;
}

/* No packet can be lost on purpose here: that the kernel was asked to look is what is tested. */
static void who_is_gone_without_a_word_is_missed(void)
{
    struct hall hall;
    hall_init(&hall);
    hall_open(&hall);
    int fd = knock(&hall), end = -1;
    gint64 limit = g_get_monotonic_time() + 10 * G_USEC_PER_SEC;
    while (!option_of(end, SOL_SOCKET, SO_KEEPALIVE) && g_get_monotonic_time() < limit) {
        g_usleep(1000); /* an accepted socket says nothing to who waits for it */
        end = other_end(fd);
    }
    g_assert_cmpint(option_of(end, SOL_SOCKET, SO_KEEPALIVE), ==, 1);
    g_assert_cmpint(option_of(end, IPPROTO_TCP, TCP_KEEPIDLE) +
                        option_of(end, IPPROTO_TCP, TCP_KEEPINTVL) *
                            option_of(end, IPPROTO_TCP, TCP_KEEPCNT),
                    ==, 120);
    close(fd);
    hall_close(&hall);
}

/* ---- slow ones, encrypted ---- */

static struct ls_secure *whisper(const struct hall *hall)
{
    g_autofree char *url = g_strdup_printf("tls://localhost:%u", hall->port);
    g_autofree char *certificate = file(hall, "node", ".pem"), *key = file(hall, "node", ".key");
    g_autofree char *authority = file(hall, "authority", ".pem");
    const struct ls_remote remote = {url, certificate, key, authority};
    struct ls_secure *secure = NULL;
    struct ls_diag diag = {0};
    g_assert_cmpint(ls_secure_connect(&remote, &secure, &diag), ==, LS_OK);
    return secure;
}

static void ends(struct ls_secure *secure)
{
    char bytes[4096];
    size_t n;
    struct ls_diag diag = {0};
    enum ls_err err;
    while ((err = ls_secure_read(secure, bytes, sizeof bytes, &n, &diag)) == LS_OK)
        ;
    g_assert_cmpint(err, ==, LS_ERR_GONE);
    ls_secure_close(secure);
}

static void half_a_request_is_not_waited_for(void)
{
    struct hall hall;
    struct ls_diag diag = {0};
    static const uint8_t half[] = {'L', 'S', 'T', 'G', 1};
    hall_init(&hall);
    hall.stage.limits.hello_ms = LONG_MS;
    hall.stage.limits.stall_ms = 400;
    hall_open(&hall);
    struct ls_secure *slow = whisper(&hall);
    g_assert_cmpint(ls_secure_write(slow, half, sizeof half, &diag), ==, LS_OK);
    ls_connection_close(enter_as(&hall, "desk"));
    ends(slow);
    wait_for_connections(&hall.stage, 0);
    hall_close(&hall);
}

static void a_greeting_is_not_waited_for(void)
{
    struct hall hall;
    hall_init(&hall);
    hall.stage.limits.hello_ms = 400;
    hall.stage.limits.stall_ms = LONG_MS;
    hall_open(&hall);
    ends(whisper(&hall));
    wait_for_connections(&hall.stage, 0);
    hall_close(&hall);
}

static void one_certificate_has_so_many_connections(void)
{
    struct hall hall;
    hall_init(&hall);
    hall.stage.limits.max_connections_each = 2;
    hall_open(&hall);
    struct ls_connection *a = enter_as(&hall, "node"), *b = enter_as(&hall, "node");
    stays_out(&hall, "node", LS_ERR_REFUSED, "2 connections already");
    ls_connection_close(enter_as(&hall, "desk"));
    ls_connection_close(a);
    ls_connection_close(b);
    hall_close(&hall);
}

/* ---- what is wrong with the daemon's own files ---- */

static void no_take(void *user, const struct ls_take_status *status)
{
}

static void refuses_to_listen(struct hall *hall, const char *words)
{
    struct ls_server *server = NULL;
    struct ls_engine *engine = NULL;
    struct ls_diag diag = {0};
    struct stage *stage = &hall->stage;
    g_assert_cmpint(ls_engine_create(&stage->config, no_take, NULL, &engine, &diag), ==, LS_OK);
    stage->limits.socket_path = stage->socket_path;
    stage->limits.storage = stage->storage;
    g_assert_cmpint(ls_server_create(&stage->limits, engine, &server, &diag), !=, LS_OK);
    ls_engine_destroy(engine);
    if (!strstr(diag.text, words))
        g_error("\"%s\" does not say \"%s\"", diag.text, words);
}

static void set_file(struct hall *hall, char **which, const char *stem, const char *suffix)
{
    g_free(*which);
    *which = file(hall, stem, suffix);
}

static void a_daemon_without_good_files_does_not_listen(void)
{
    struct hall hall;
    hall_init(&hall);
    certify(&hall, "old", "authority",
            (struct ls_certificate_wish){LS_CERTIFICATE_SERVER, .from_days = -9});
    set_file(&hall, &hall.listen.certificate, "absent", ".pem");
    refuses_to_listen(&hall, "absent.pem");
    set_file(&hall, &hall.listen.certificate, "server", ".pem");
    set_file(&hall, &hall.listen.key, "desk", ".key");
    refuses_to_listen(&hall, "key values mismatch");
    set_file(&hall, &hall.listen.key, "server", ".key");
    g_assert_cmpint(chmod(hall.listen.key, 0644), ==, 0);
    refuses_to_listen(&hall, "everybody may read");
    g_assert_cmpint(chmod(hall.listen.key, 0600), ==, 0);
    set_file(&hall, &hall.listen.certificate, "old", ".pem");
    set_file(&hall, &hall.listen.key, "old", ".key");
    refuses_to_listen(&hall, "has expired");
    set_file(&hall, &hall.listen.certificate, "server", ".pem");
    set_file(&hall, &hall.listen.key, "server", ".key");
    g_free(hall.listen.address);
    hall.listen.address = g_strdup("localhost");
    refuses_to_listen(&hall, "numeric");
    g_free(hall.listen.address);
    hall.listen.address = g_strdup("127.0.0.1");
    hall_open(&hall);
    hall_close(&hall);
}

int main(int argc, char **argv)
{
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/tls/a-certificates-name-is-its-role", a_certificates_name_is_its_role);
    g_test_add_func("/tls/who-has-no-good-certificate-stays-out",
                    who_has_no_good_certificate_stays_out);
    g_test_add_func("/tls/a-client-trusts-no-other-daemon", a_client_trusts_no_other_daemon);
    g_test_add_func("/tls/a-client-wants-the-host-it-asked-for",
                    a_client_wants_the_host_it_asked_for);
    g_test_add_func("/tls/nothing-older-than-1.3-and-nobody-without-a-certificate",
                    nothing_older_than_1_3_and_nobody_without_a_certificate);
    g_test_add_func("/tls/who-only-knocks-is-hung-up-on", who_only_knocks_is_hung_up_on);
    g_test_add_func("/tls/who-is-gone-without-a-word-is-missed",
                    who_is_gone_without_a_word_is_missed);
    g_test_add_func("/tls/a-crowd-at-the-door-keeps-nobody-out",
                    a_crowd_at_the_door_keeps_nobody_out);
    g_test_add_func("/tls/half-a-request-is-not-waited-for", half_a_request_is_not_waited_for);
    g_test_add_func("/tls/a-greeting-is-not-waited-for", a_greeting_is_not_waited_for);
    g_test_add_func("/tls/one-certificate-has-so-many-connections",
                    one_certificate_has_so_many_connections);
    g_test_add_func("/tls/a-daemon-without-good-files-does-not-listen",
                    a_daemon_without_good_files_does_not_listen);
    return g_test_run();
}
