/* Stored tiles to one client by TLS over loopback, held against a plain loop of SSL_write of as
 * many bytes from memory, same certificates, same cipher, to a reader that does as little. */
#include "clients/certificates.h"
#include "clients/secure.h"
#include "proto/frame.h"
#include "proto/tls.h"
#include "tests/bench/bench.h"
#include "tests/bench/serving.h"

#include <math.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

enum { READ_BYTES = 256 * 1024, WRITE_BYTES = 1 << 20 };

static void must(bool ok, const char *what)
{
    if (!ok) {
        fprintf(stderr, "%s\n", what);
        exit(1);
    }
}

struct setting {
    struct serving serving;
    struct ls_access access;
    struct ls_listen_config listen;
    struct ls_remote remote;
    Lightstage__Fetch fetch;
    struct ls_secure *client, *plain_client;
    SSL *plain_server; /* the other end of plain_client */
    uint32_t request;
    uint8_t *in, *from;
    size_t bytes; /* of all stored tiles */
};

static void certify(struct setting *s, const char *stem, enum ls_certificate_use use)
{
    static const char *const hosts[] = {"127.0.0.1"};
    struct ls_diag diag = {{0}};
    bool authority = use == LS_CERTIFICATE_AUTHORITY;
    const struct ls_certificate_wish wish = {use, stem, hosts, use == LS_CERTIFICATE_SERVER ? 1 : 0,
                                             0,   1};
    must(!ls_certificate_make(s->serving.stage.folder, stem, authority ? NULL : "authority", &wish,
                              &diag),
         diag.text);
}

static char *file(const struct setting *s, const char *name)
{
    return g_build_filename(s->serving.stage.folder, name, NULL);
}

/* ---- served ---- */

static void ask(struct setting *s, uint16_t type, const ProtobufCMessage *body)
{
    uint8_t *head = NULL;
    size_t n = 0;
    struct ls_diag diag = {{0}};
    must(!ls_message_frame(type, ++s->request, LS_FRAME_LAST, body, 0, &head, &n, &diag),
         diag.text);
    must(!ls_secure_write(s->client, head, n, &diag), diag.text);
    free(head);
}

/* Frames up to the last of a request; what they carry is dropped where it was decrypted. */
static size_t receive_frames(struct setting *s)
{
    struct ls_frame_header header = {.flags = 0};
    uint8_t head[LS_FRAME_HEADER_BYTES];
    size_t payload = 0, known = 0;
    uint64_t left = 0;
    struct ls_diag diag = {{0}};
    for (;;) {
        size_t n = 0;
        must(!ls_secure_read(s->client, s->in, READ_BYTES, &n, &diag), diag.text);
        for (const uint8_t *at = s->in; n > 0;) {
            size_t part = left > 0 ? (left < n ? left : n) : sizeof head - known;
            part = part < n ? part : n;
            if (left > 0) {
                left -= part;
            } else {
                memcpy(head + known, at, part);
                known += part;
            }
            at += part;
            n -= part;
            if (known == sizeof head) {
                must(!ls_frame_get(head, UINT64_MAX, &header, &diag), diag.text);
                must(header.type != LS_MESSAGE_ERROR, "the server answers with an Error");
                known = 0;
                left = header.message_bytes + header.payload_bytes;
                payload += header.payload_bytes;
            }
        }
        if (left == 0 && known == 0 && (header.flags & LS_FRAME_LAST))
            return payload;
    }
}

static void serve(void *data)
{
    struct setting *s = data;
    ask(s, LS_MESSAGE_FETCH, &s->fetch.base);
    must(receive_frames(s) == s->bytes, "not all tiles came");
}

/* ---- plainly ---- */

static void *write_all(void *data)
{
    struct setting *s = data;
    for (size_t at = 0; at < s->bytes;) {
        size_t n = s->bytes - at < WRITE_BYTES ? s->bytes - at : WRITE_BYTES, wrote = 0;
        must(SSL_write_ex(s->plain_server, s->from + at, n, &wrote) == 1, ls_tls_why());
        at += wrote;
    }
    return NULL;
}

static void plain(void *data)
{
    struct setting *s = data;
    struct ls_diag diag = {{0}};
    pthread_t writer;
    must(pthread_create(&writer, NULL, write_all, s) == 0, "no thread");
    for (size_t got = 0, n; got < s->bytes; got += n)
        must(!ls_secure_read(s->plain_client, s->in, READ_BYTES, &n, &diag), diag.text);
    pthread_join(writer, NULL);
}

struct accepting {
    int listener;
    struct ls_tls *tls;
    SSL *ssl;
};

static void *accept_one(void *data)
{
    struct accepting *a = data;
    int on = 1;
    int fd = accept(a->listener, NULL, NULL);
    must(fd >= 0 && !setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on), "no connection");
    a->ssl = ls_tls_attach(a->tls, fd);
    must(a->ssl && SSL_accept(a->ssl) == 1, "no handshake");
    return NULL;
}

static void connect_plainly(struct setting *s)
{
    struct sockaddr_in at = {.sin_family = AF_INET, .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    socklen_t size = sizeof at;
    struct ls_diag diag = {{0}};
    struct accepting a = {.listener = socket(AF_INET, SOCK_STREAM, 0)};
    must(!bind(a.listener, (struct sockaddr *)&at, sizeof at) && !listen(a.listener, 1) &&
             !getsockname(a.listener, (struct sockaddr *)&at, &size),
         "no port");
    must(!ls_tls_create(true, s->listen.certificate, s->listen.key, s->listen.authority, &a.tls,
                        &diag),
         diag.text);
    pthread_t thread;
    must(pthread_create(&thread, NULL, accept_one, &a) == 0, "no thread");
    g_autofree char *url = g_strdup_printf("tls://127.0.0.1:%u", ntohs(at.sin_port));
    const struct ls_remote remote = {url, s->remote.certificate, s->remote.key,
                                     s->remote.authority};
    must(!ls_secure_connect(&remote, &s->plain_client, &diag), diag.text);
    pthread_join(thread, NULL);
    close(a.listener);
    s->plain_server = a.ssl; /* which keeps what it needs of a.tls to the program's end */
}

/* ---- both ---- */

static void open_all(struct setting *s, uint32_t n_lights, uint32_t side)
{
    struct ls_diag diag = {{0}};
    serving_make(&s->serving, n_lights, side, 8);
    certify(s, "authority", LS_CERTIFICATE_AUTHORITY);
    certify(s, "server", LS_CERTIFICATE_SERVER);
    certify(s, "node", LS_CERTIFICATE_CLIENT);
    s->access = (struct ls_access){.readers = {{g_strdup("node")}, 1}};
    s->listen = (struct ls_listen_config){.address = g_strdup("127.0.0.1"),
                                          .certificate = file(s, "server.pem"),
                                          .key = file(s, "server.key"),
                                          .authority = file(s, "authority.pem")};
    s->serving.stage.limits.access = &s->access;
    s->serving.stage.limits.listen = &s->listen;
    serving_start(&s->serving);
    s->remote = (struct ls_remote){
        g_strdup_printf("tls://%s", ls_server_remote_address(s->serving.stage.server)),
        file(s, "node.pem"), file(s, "node.key"), s->listen.authority};
    must(!ls_secure_connect(&s->remote, &s->client, &diag), diag.text);
    s->in = bench_alloc(READ_BYTES);
    uint32_t across = (side + 63) / 64;
    s->bytes = (size_t)n_lights * across * across * 64 * 64 * sizeof(uint16_t);
    s->from = bench_alloc(s->bytes);
    memset(s->from, 0x5a, s->bytes);
    stored_fetch(&s->fetch, &s->serving);
    Lightstage__Hello hello = LIGHTSTAGE__HELLO__INIT;
    hello.version = LS_FRAME_VERSION;
    ask(s, LS_MESSAGE_HELLO, &hello.base);
    receive_frames(s);
    connect_plainly(s);
}

static void close_all(struct setting *s)
{
    ls_secure_close(s->client);
    ls_secure_close(s->plain_client);
    serving_close(&s->serving);
    ls_access_finish(&s->access);
    ls_listen_config_finish(&s->listen);
    SSL_free(s->plain_server);
    free(s->in);
    free(s->from);
}

int main(int argc, char **argv)
{
    struct bench bench;
    struct setting s = {.request = 0};
    bench_init(&bench, argc, argv);
    open_all(&s, (uint32_t)bench_size(&bench, 24, 4), (uint32_t)bench_size(&bench, 2048, 192));
    struct bench_task tasks[] = {{.name = "SSL_write", .run = plain, .data = &s},
                                 {.name = "stored tiles by TLS", .run = serve, .data = &s}};
    bench_time(&bench, tasks, 2);
    double rate = (double)s.bytes / tasks[1].best_s, reference = (double)s.bytes / tasks[0].best_s;
    bench_row(&bench, &(struct bench_row){.name = "serve_tls",
                                          .unit = "GB/s",
                                          .value = 1e-9 * rate,
                                          .median = 1e-9 * (double)s.bytes / tasks[1].median_s,
                                          .error = NAN,
                                          .reference = "SSL_write over loopback",
                                          .reference_value = 1e-9 * reference,
                                          .ratio = rate / reference,
                                          .wanted = 0.8});
    close_all(&s);
    return 0;
}
