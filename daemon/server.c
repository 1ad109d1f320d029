#include "daemon/server.h"

#include "daemon/arrivals.h"
#include "daemon/listen.h"
#include "daemon/live.h"
#include "daemon/service.h"
#include "daemon/session.h"

#include <errno.h>
#include <glib-unix.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

enum {
    MEMFD_BYTES = 256 << 20,
    HASH_BYTES = 64 << 20, /* of 8,000 pictures of 4 Mpx */
    TICK_MS = 250,
    IDLE_FIELDS = 2,
    MAX_GROUPS = 65537,       /* NGROUPS_MAX of Linux, and the first */
    SEND_BYTES = 1024 * 1024, /* socket buffer asked for; the kernel caps it */
};

struct ls_server {
    struct ls_service service;
    char *socket_path, *storage;
    int fd;
    guint accepting, ticking;
    struct ls_arrivals *arrivals; /* NULL: no remote clients */
};

static void fill_defaults(struct ls_server_config *config)
{
    unsigned processors = g_get_num_processors();
    if (!config->max_connections)
        config->max_connections = 128;
    if (!config->max_connections_each)
        config->max_connections_each = 64;
    if (!config->max_requests)
        config->max_requests = 8;
    if (!config->serve_threads)
        config->serve_threads = processors < 2 ? 2 : processors > 4 ? 4 : processors;
    if (!config->hello_ms)
        config->hello_ms = 10000;
    if (!config->stall_ms)
        config->stall_ms = 30000;
    if (!config->idle_s)
        config->idle_s = 900;
    if (!config->max_payload)
        config->max_payload = 1024 * 1024;
}

static enum ls_role role_of(const struct ls_access *access, int fd, const struct ucred *peer)
{
    gid_t groups[MAX_GROUPS] = {peer->gid};
    socklen_t size = (MAX_GROUPS - 1) * sizeof *groups;
    size_t n = getsockopt(fd, SOL_SOCKET, SO_PEERGROUPS, groups + 1, &size) == 0
                   ? 1 + size / sizeof *groups
                   : 1;
    return access ? ls_access_unix(access, peer->uid, groups, n) : LS_ROLE_OPERATOR;
}

static bool peer_of(const struct ls_access *access, int fd, struct ls_peer *peer)
{
    struct ucred credentials;
    socklen_t size = sizeof credentials;
    if (getsockopt(fd, SOL_SOCKET, SO_PEERCRED, &credentials, &size))
        return false;
    *peer = (struct ls_peer){.role = role_of(access, fd, &credentials),
                             .pid = credentials.pid,
                             .uid = credentials.uid,
                             .gid = credentials.gid};
    return true;
}

static gboolean on_connection(gint listener, GIOCondition condition, gpointer data)
{
    struct ls_server *server = data;
    struct ls_peer peer;
    int size = SEND_BYTES;
    int fd = accept4(listener, NULL, NULL, SOCK_CLOEXEC | SOCK_NONBLOCK);
    if (fd < 0)
        return G_SOURCE_CONTINUE;
    if (!peer_of(server->service.config.access, fd, &peer)) {
        close(fd);
        return G_SOURCE_CONTINUE;
    }
    setsockopt(fd, SOL_SOCKET, SO_SNDBUF, &size, sizeof size);
    ls_session_admit(&server->service, ls_transport_plain(fd), &peer);
    return G_SOURCE_CONTINUE;
}

static gboolean on_tick(gpointer data)
{
    struct ls_server *server = data;
    int64_t now = g_get_monotonic_time();
    if (server->arrivals)
        ls_arrivals_tick(server->arrivals, now);
    for (GList *l = server->service.sessions, *next; l; l = next) {
        next = l->next;
        ls_session_tick(l->data, now);
    }
    return G_SOURCE_CONTINUE;
}

static enum ls_err start(struct ls_server *server, struct ls_diag *diag)
{
    const struct ls_listen_config *remote = server->service.config.listen;
    if (remote && remote->address)
        return ls_arrivals_create(&server->service, remote, &server->arrivals, diag);
    return LS_OK;
}

static void on_events(void *user)
{
    struct ls_server *server = user;
    for (GList *l = server->service.sessions, *next; l; l = next) {
        next = l->next;
        ls_session_tell_events(l->data);
    }
}

enum ls_err ls_server_create(const struct ls_server_config *config, struct ls_engine *engine,
                             struct ls_server **out, struct ls_diag *diag)
{
    int fd = config->listener;
    enum ls_err err = fd ? LS_OK : ls_listen_unix(config->socket_path, &fd, diag);
    if (err)
        return err;
    struct ls_server *server = g_new0(struct ls_server, 1);
    struct ls_service *service = &server->service;
    server->fd = fd;
    server->socket_path = g_strdup(config->socket_path);
    server->storage = g_strdup(config->storage);
    service->config = *config;
    service->config.socket_path = server->socket_path;
    service->config.storage = server->storage;
    fill_defaults(&service->config);
    service->engine = engine;
    service->fields = ls_field_cache_create(server->storage, IDLE_FIELDS, config->spare_bytes);
    service->memfds = ls_memfds_create(MEMFD_BYTES);
    service->stored = ls_stored_tiles_create(HASH_BYTES);
    service->pool = ls_job_pool_create(service->config.serve_threads);
    if ((err = start(server, diag))) {
        ls_server_destroy(server);
        return err;
    }
    server->accepting = g_unix_fd_add(fd, G_IO_IN, on_connection, server);
    server->ticking = g_timeout_add(TICK_MS, on_tick, server);
    ls_events_watch(ls_engine_events(engine), on_events, server);
    *out = server;
    return LS_OK;
}

const char *ls_server_remote_address(const struct ls_server *server)
{
    return server->arrivals ? ls_arrivals_address(server->arrivals) : NULL;
}

void ls_server_take_event(struct ls_server *server, const struct ls_take_status *status)
{
    server->service.take = *status;
    for (GList *l = server->service.sessions, *next; l; l = next) {
        next = l->next;
        ls_session_take_event(l->data);
    }
}

unsigned ls_server_connections(const struct ls_server *server)
{
    return server->service.n_sessions;
}

void ls_server_destroy(struct ls_server *server)
{
    if (!server)
        return;
    if (server->accepting)
        g_source_remove(server->accepting);
    if (server->ticking)
        g_source_remove(server->ticking);
    if (server->arrivals)
        ls_arrivals_close(server->arrivals);
    ls_live_end(&server->service);
    if (!server->service.config.listener) /* else the path is not ours */
        unlink(server->socket_path);
    close(server->fd);
    while (server->service.sessions)
        ls_session_shutdown(server->service.sessions->data);
    ls_job_pool_destroy(server->service.pool);
    ls_arrivals_destroy(server->arrivals);
    ls_field_cache_destroy(server->service.fields);
    ls_memfds_destroy(server->service.memfds);
    ls_stored_tiles_destroy(server->service.stored);
    g_free(server->socket_path);
    g_free(server->storage);
    g_free(server);
}
