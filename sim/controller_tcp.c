#include "sim/controller_modbus.h"

#include <arpa/inet.h>
#include <errno.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <unistd.h>

enum { MAX_CLIENTS = 8 };

struct tcp {
    struct sim_modbus modbus;
    int listen_fd;
};

/** One request of one client. Returns -1 when the client is gone. */
static int serve(struct sim_controller *c, int fd)
{
    uint8_t req[MODBUS_MAX_ADU_LENGTH];
    struct sim_modbus *m = &((struct tcp *)c->wire_data)->modbus;
    modbus_set_socket(m->context, fd);
    int length = sim_modbus_receive(m, req);
    if (length <= 0)
        return length;
    return sim_modbus_answer(m, req, length, sim_modbus_act(m, c, req, length));
}

struct clients {
    int fd[MAX_CLIENTS];
    unsigned n;
};

static void drop(struct clients *clients, unsigned i)
{
    close(clients->fd[i]);
    memmove(clients->fd + i, clients->fd + i + 1, (--clients->n - i) * sizeof *clients->fd);
}

/** A host that lost its link comes back before its old connection has died: the oldest yields. */
static void accept_client(struct sim_controller *c, struct clients *clients)
{
    int fd = accept4(((struct tcp *)c->wire_data)->listen_fd, NULL, NULL, SOCK_CLOEXEC);
    struct timeval limit = {.tv_usec = 200000};
    if (fd < 0)
        return;
    setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &(int){1}, sizeof(int));
    setsockopt(fd, SOL_SOCKET, SO_SNDTIMEO, &limit, sizeof limit);
    if (clients->n == MAX_CLIENTS)
        drop(clients, 0);
    clients->fd[clients->n++] = fd;
}

/** How long the controller stays dead, for poll(): 0 if it lives, -1 if it does not come back. */
static int apply_faults(struct sim_controller *c, struct clients *clients)
{
    pthread_mutex_lock(&c->lock);
    bool disconnect = c->disconnect;
    uint64_t until_ns = c->dead_until_ns, now_ns = sim_now_ns();
    c->disconnect = false;
    pthread_mutex_unlock(&c->lock);
    while (disconnect && clients->n)
        close(clients->fd[--clients->n]);
    if (until_ns <= now_ns)
        return 0;
    return until_ns == UINT64_MAX ? -1 : (int)((until_ns - now_ns) / 1000000) + 1;
}

static void step(struct sim_controller *c, struct clients *clients)
{
    struct pollfd fds[MAX_CLIENTS + 2] = {{c->kick_fd, POLLIN, 0},
                                          {((struct tcp *)c->wire_data)->listen_fd, POLLIN, 0}};
    eventfd_t kicks;
    int dead_ms = apply_faults(c, clients);
    unsigned n = clients->n;
    for (unsigned i = 0; i < n; i++)
        fds[2 + i] = (struct pollfd){clients->fd[i], POLLIN, 0};
    if (poll(fds, dead_ms ? 1 : 2 + n, dead_ms ? dead_ms : -1) <= 0)
        return;
    if (fds[0].revents)
        eventfd_read(c->kick_fd, &kicks);
    for (unsigned i = n; i-- > 0;)
        if (fds[2 + i].revents && serve(c, fds[2 + i].fd) < 0)
            drop(clients, i);
    if (fds[1].revents)
        accept_client(c, clients);
}

static void tcp_serve(struct sim_controller *c)
{
    struct clients clients = {.n = 0};
    while (!sim_controller_quitting(c))
        step(c, &clients);
    while (clients.n)
        drop(&clients, 0);
}

static enum ls_err listen_on(struct sim_controller *c, struct tcp *tcp, struct ls_diag *diag)
{
    struct sockaddr_in sa = {.sin_family = AF_INET, .sin_port = htons((uint16_t)c->config.port)};
    socklen_t len = sizeof sa;
    if (inet_pton(AF_INET, c->config.address, &sa.sin_addr) != 1)
        return ls_fail(diag, LS_ERR_INVALID, "controller address \"%s\": expected an IPv4 address",
                       c->config.address);
    tcp->listen_fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    if (tcp->listen_fd < 0)
        return ls_fail(diag, LS_ERR_OS, "controller: socket: %s", strerror(errno));
    setsockopt(tcp->listen_fd, SOL_SOCKET, SO_REUSEADDR, &(int){1}, sizeof(int));
    if (bind(tcp->listen_fd, (struct sockaddr *)&sa, sizeof sa) || listen(tcp->listen_fd, 8) ||
        getsockname(tcp->listen_fd, (struct sockaddr *)&sa, &len))
        return ls_fail(diag, errno == EADDRINUSE ? LS_ERR_BUSY : LS_ERR_OS,
                       "controller: %s port %u: %s", c->config.address, c->config.port,
                       strerror(errno));
    c->port = ntohs(sa.sin_port);
    return LS_OK;
}

static enum ls_err tcp_open(struct sim_controller *c, struct ls_diag *diag)
{
    struct tcp *tcp = c->wire_data = calloc(1, sizeof *tcp);
    if (!tcp)
        return ls_fail(diag, LS_ERR_NOMEM, "controller: out of memory");
    tcp->listen_fd = -1;
    enum ls_err err = sim_modbus_init(&tcp->modbus, modbus_new_tcp(NULL, 0), diag);
    return err ? err : listen_on(c, tcp, diag);
}

static void tcp_close(struct sim_controller *c)
{
    struct tcp *tcp = c->wire_data;
    if (!tcp)
        return;
    if (tcp->listen_fd >= 0)
        close(tcp->listen_fd);
    sim_modbus_finish(&tcp->modbus);
    free(tcp);
}

const struct sim_wire sim_wire_tcp = {
    .open = tcp_open,
    .serve = tcp_serve,
    .close = tcp_close,
};
