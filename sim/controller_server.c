#include "sim/controller_private.h"

#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <string.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <unistd.h>

enum { MAX_CLIENTS = 8, HEADER = 7 /* MBAP and unit */ };

static unsigned get16(const uint8_t *bytes)
{
    return (unsigned)bytes[0] << 8 | bytes[1];
}

static void get_regs(const uint8_t *bytes, uint16_t *regs, unsigned n)
{
    for (unsigned i = 0; i < n; i++)
        regs[i] = (uint16_t)get16(bytes + 2 * i);
}

static int do_read(struct sim_controller *c, unsigned address, unsigned n)
{
    if (n < 1 || n > MODBUS_MAX_READ_REGISTERS)
        return MODBUS_EXCEPTION_ILLEGAL_DATA_VALUE;
    if (address + n > (unsigned)c->map->nb_registers)
        return MODBUS_EXCEPTION_ILLEGAL_DATA_ADDRESS;
    return sim_controller_read(c, address, c->map->tab_registers + address, n);
}

static int do_write(struct sim_controller *c, unsigned address, const uint8_t *bytes, unsigned n)
{
    uint16_t regs[MODBUS_MAX_WRITE_REGISTERS];
    if (n < 1 || n > MODBUS_MAX_WRITE_REGISTERS)
        return MODBUS_EXCEPTION_ILLEGAL_DATA_VALUE;
    get_regs(bytes, regs, n);
    return sim_controller_write(c, address, regs, n);
}

/** Act on a request of @length bytes. Returns 0 when modbus_reply may answer from the map. */
static int act(struct sim_controller *c, const uint8_t *req, int length)
{
    const uint8_t *pdu = req + HEADER;
    if (length < HEADER + 5)
        return MODBUS_EXCEPTION_ILLEGAL_FUNCTION;
    unsigned address = get16(pdu + 1), n = get16(pdu + 3);
    if (pdu[0] == MODBUS_FC_READ_HOLDING_REGISTERS)
        return do_read(c, address, n);
    if (pdu[0] == MODBUS_FC_WRITE_SINGLE_REGISTER)
        return do_write(c, address, pdu + 3, 1);
    if (pdu[0] == MODBUS_FC_WRITE_MULTIPLE_REGISTERS) {
        if (length < HEADER + 6 || pdu[5] != 2 * n || length < HEADER + 6 + 2 * (int)n)
            return MODBUS_EXCEPTION_ILLEGAL_DATA_VALUE;
        return do_write(c, address, pdu + 6, n);
    }
    if (pdu[0] == MODBUS_FC_WRITE_AND_READ_REGISTERS) {
        unsigned n_write = length >= HEADER + 10 ? get16(pdu + 7) : 0;
        if (length < HEADER + 10 || pdu[9] != 2 * n_write ||
            length < HEADER + 10 + 2 * (int)n_write)
            return MODBUS_EXCEPTION_ILLEGAL_DATA_VALUE;
        int rc = do_write(c, get16(pdu + 5), pdu + 10, n_write);
        return rc ? rc : do_read(c, address, n);
    }
    return MODBUS_EXCEPTION_ILLEGAL_FUNCTION;
}

/** One request of one client. Returns -1 when the client is gone. */
static int serve(struct sim_controller *c, int fd)
{
    uint8_t req[MODBUS_TCP_MAX_ADU_LENGTH];
    modbus_set_socket(c->modbus, fd);
    int length = modbus_receive(c->modbus, req);
    if (length < 0)
        return -1;
    if (length == 0)
        return 0;
    int rc = MODBUS_EXCEPTION_GATEWAY_TARGET;
    if (req[HEADER - 1] == c->config.unit || req[HEADER - 1] == MODBUS_TCP_SLAVE) {
        pthread_mutex_lock(&c->lock);
        rc = act(c, req, length);
        pthread_mutex_unlock(&c->lock);
    }
    if (rc)
        return modbus_reply_exception(c->modbus, req, (unsigned)rc) < 0 ? -1 : 0;
    return modbus_reply(c->modbus, req, length, c->map) < 0 ? -1 : 0;
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
    int fd = accept4(c->listen_fd, NULL, NULL, SOCK_CLOEXEC);
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
    struct pollfd fds[MAX_CLIENTS + 2] = {{c->kick_fd, POLLIN, 0}, {c->listen_fd, POLLIN, 0}};
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

static bool quitting(struct sim_controller *c)
{
    pthread_mutex_lock(&c->lock);
    bool quit = c->quit;
    pthread_mutex_unlock(&c->lock);
    return quit;
}

void *sim_controller_server(void *controller)
{
    struct sim_controller *c = controller;
    struct clients clients = {.n = 0};
    while (!quitting(c))
        step(c, &clients);
    while (clients.n)
        drop(&clients, 0);
    return NULL;
}
