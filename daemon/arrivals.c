#include "daemon/arrivals.h"

#include "daemon/listen.h"
#include "daemon/session.h"
#include "daemon/tls_transport.h"

#include <glib-unix.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

enum { MAX_ARRIVALS = 32 };

struct ls_arrivals {
    struct ls_service *service;
    struct ls_tls *tls;
    int fd;
    guint accepting;
    char address[64];
    GQueue list; /* struct arrival, the first to come first */
};

struct arrival {
    struct ls_job job; /* first: its step is a piece of the handshake */
    struct ls_arrivals *arrivals;
    struct ls_transport *transport;
    char from[64];
    int64_t since_us;
    guint watching;
    bool stepping, gone;
    enum ls_tls_step wants;
};

static void hang_up(struct arrival *arrival)
{
    if (arrival->watching)
        g_source_remove(arrival->watching);
    ls_transport_destroy(arrival->transport);
    g_free(arrival);
}

static void leave(struct arrival *arrival)
{
    g_queue_remove(&arrival->arrivals->list, arrival);
    arrival->gone = true;
    if (!arrival->stepping)
        hang_up(arrival);
}

static void turn_away(struct arrival *arrival, const char *why)
{
    ls_lines_turned_away(&arrival->arrivals->service->strangers, arrival->from, why);
    leave(arrival);
}

static void welcome(struct arrival *arrival)
{
    struct ls_service *service = arrival->arrivals->service;
    struct ls_transport *transport = arrival->transport;
    struct ls_peer peer = {.remote = true};
    ls_tls_transport_peer(transport, peer.name, sizeof peer.name);
    if (service->config.access)
        peer.role = ls_access_certificate(service->config.access, peer.name);
    arrival->transport = NULL;
    leave(arrival);
    ls_session_admit(service, transport, &peer);
}

/* ---- the handshake ---- */

static gboolean on_ready(gint fd, GIOCondition condition, gpointer data);

static enum ls_err shake_hands(struct ls_job *job, struct ls_chunk *chunk, bool *last,
                               struct ls_diag *diag)
{
    struct arrival *arrival = (struct arrival *)job;
    *last = true;
    return ls_tls_transport_handshake(arrival->transport, &arrival->wants, diag);
}

static void on_shaken(void *user, struct ls_job *job, struct ls_job_result *result)
{
    struct arrival *arrival = user;
    arrival->stepping = false;
    if (arrival->gone)
        hang_up(arrival);
    else if (result->err)
        turn_away(arrival, result->diag.text);
    else if (arrival->wants == LS_TLS_DONE)
        welcome(arrival);
    else
        arrival->watching = g_unix_fd_add(arrival->transport->fd,
                                          arrival->wants == LS_TLS_WANTS_OUT ? G_IO_OUT : G_IO_IN,
                                          on_ready, arrival);
}

static const struct ls_job_ops handshake_ops = {"handshake", shake_hands, NULL};

static gboolean on_ready(gint fd, GIOCondition condition, gpointer data)
{
    struct arrival *arrival = data;
    arrival->watching = 0;
    arrival->stepping = true;
    ls_job_pool_step(arrival->arrivals->service->pool, &arrival->job, NULL, on_shaken, arrival);
    return G_SOURCE_REMOVE;
}

/* ---- those who come ---- */

/* One whose machine or network is gone without a word is missed within two minutes. */
static void set_options(int fd)
{
    static const int on = 1, idle_s = 60, every_s = 10, times = 6;
    setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
    setsockopt(fd, IPPROTO_TCP, TCP_KEEPIDLE, &idle_s, sizeof idle_s);
    setsockopt(fd, IPPROTO_TCP, TCP_KEEPINTVL, &every_s, sizeof every_s);
    setsockopt(fd, IPPROTO_TCP, TCP_KEEPCNT, &times, sizeof times);
    setsockopt(fd, SOL_SOCKET, SO_KEEPALIVE, &on, sizeof on);
}

static void begin(struct ls_arrivals *arrivals, int fd, const struct sockaddr_storage *from)
{
    set_options(fd);
    struct ls_transport *transport = ls_transport_tls(arrivals->tls, fd);
    if (!transport)
        return;
    struct arrival *arrival = g_new0(struct arrival, 1);
    *arrival = (struct arrival){.job.ops = &handshake_ops,
                                .arrivals = arrivals,
                                .transport = transport,
                                .since_us = g_get_monotonic_time()};
    ls_listen_name(from, arrival->from, sizeof arrival->from);
    g_queue_push_tail(&arrivals->list, arrival);
    arrival->watching = g_unix_fd_add(fd, G_IO_IN, on_ready, arrival);
    if (arrivals->list.length > MAX_ARRIVALS)
        turn_away(arrivals->list.head->data, "others want to come in, and it is slow");
}

static gboolean on_connection(gint listener, GIOCondition condition, gpointer data)
{
    struct sockaddr_storage from;
    socklen_t size = sizeof from;
    int fd = accept4(listener, (struct sockaddr *)&from, &size, SOCK_CLOEXEC | SOCK_NONBLOCK);
    if (fd >= 0)
        begin(data, fd, &from);
    return G_SOURCE_CONTINUE;
}

void ls_arrivals_tick(struct ls_arrivals *arrivals, int64_t now_us)
{
    unsigned limit_ms = arrivals->service->config.hello_ms;
    for (struct arrival *first; (first = g_queue_peek_head(&arrivals->list));) {
        if ((now_us - first->since_us) / 1000 < limit_ms)
            return;
        turn_away(first, "its handshake took too long");
    }
}

/* ---- life ---- */

enum ls_err ls_arrivals_check(const struct ls_listen_config *config, struct ls_diag *diag)
{
    struct ls_tls *tls = NULL;
    if (!config->address)
        return LS_OK;
    enum ls_err err =
        ls_tls_create(true, config->certificate, config->key, config->authority, &tls, diag);
    ls_tls_destroy(tls);
    return err;
}

enum ls_err ls_arrivals_create(struct ls_service *service, const struct ls_listen_config *config,
                               struct ls_arrivals **out, struct ls_diag *diag)
{
    struct ls_tls *tls = NULL;
    struct sockaddr_storage bound;
    int fd = -1;
    enum ls_err err =
        ls_tls_create(true, config->certificate, config->key, config->authority, &tls, diag);
    if (!err)
        err = ls_listen_tcp(config->address, config->port, &fd, &bound, diag);
    if (err) {
        ls_tls_destroy(tls);
        return err;
    }
    struct ls_arrivals *arrivals = g_new0(struct ls_arrivals, 1);
    arrivals->service = service;
    arrivals->tls = tls;
    arrivals->fd = fd;
    ls_listen_name(&bound, arrivals->address, sizeof arrivals->address);
    g_queue_init(&arrivals->list);
    arrivals->accepting = g_unix_fd_add(fd, G_IO_IN, on_connection, arrivals);
    *out = arrivals;
    return LS_OK;
}

const char *ls_arrivals_address(const struct ls_arrivals *arrivals)
{
    return arrivals->address;
}

void ls_arrivals_close(struct ls_arrivals *arrivals)
{
    g_source_remove(arrivals->accepting);
    close(arrivals->fd);
    for (struct arrival *first; (first = g_queue_peek_head(&arrivals->list));)
        leave(first);
}

void ls_arrivals_destroy(struct ls_arrivals *arrivals)
{
    if (!arrivals)
        return;
    ls_tls_destroy(arrivals->tls);
    g_free(arrivals);
}
