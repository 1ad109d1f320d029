#include "sim/gvcp.h"

#include <arpa/inet.h>
#include <errno.h>
#include <poll.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <unistd.h>

enum command {
    DISCOVERY = 0x0002,
    PACKET_RESEND = 0x0040,
    READ_REGISTER = 0x0080,
    WRITE_REGISTER = 0x0082,
    READ_MEMORY = 0x0084,
    WRITE_MEMORY = 0x0086,
};

enum {
    KEY = 0x42,
    HEADER_BYTES = 8,
    MAX_DATA_BYTES = 540, /* of a command or an answer */
    ACK_REQUIRED = 0x01,
};

struct sim_gvcp {
    struct sim_registers *registers;
    struct sim_gvcp_hooks hooks;
    int socket, broadcast, kick; /* kick: to quit, or to lose the controller now */
    pthread_t thread;
    _Atomic uint64_t silent_until_ns;
    atomic_bool release, quit;
    bool controlled;
    struct sockaddr_in controller;
    uint64_t heard_ns;
};

/** One command and the room for its answer. */
struct exchange {
    struct sockaddr_in from;
    uint16_t command, id;
    bool ack;
    const uint8_t *data;
    uint32_t n_data;
    uint8_t answer[HEADER_BYTES + MAX_DATA_BYTES];
    uint32_t n_answer;
};

static uint32_t load32(const uint8_t *bytes)
{
    uint32_t word;
    memcpy(&word, bytes, 4);
    return ntohl(word);
}

static bool from_controller(const struct sim_gvcp *g, const struct sockaddr_in *from)
{
    return g->controlled && from->sin_port == g->controller.sin_port &&
           from->sin_addr.s_addr == g->controller.sin_addr.s_addr;
}

static void lose_controller(struct sim_gvcp *g)
{
    g->controlled = false;
    sim_registers_set(g->registers, SIM_REG_CONTROL, 0);
    g->hooks.released(g->hooks.user);
}

/** How long the controller may stay silent from now; 0: too long already. */
static uint64_t patience_ns(const struct sim_gvcp *g)
{
    uint64_t limit_ns = sim_registers_get(g->registers, SIM_REG_HEARTBEAT_MS) * 1000000ull;
    uint64_t silent_ns = sim_now_ns() - g->heard_ns;
    return silent_ns > limit_ns ? 0 : limit_ns - silent_ns;
}

static void check_heartbeat(struct sim_gvcp *g)
{
    bool released = atomic_exchange(&g->release, false);
    if (g->controlled && (released || !patience_ns(g)))
        lose_controller(g);
}

static enum sim_gvcp_status write_control(struct sim_gvcp *g, const struct sockaddr_in *from,
                                          uint32_t value)
{
    if (value > 3)
        return SIM_GVCP_INVALID_PARAMETER;
    if (!value) {
        if (g->controlled)
            lose_controller(g);
        return SIM_GVCP_OK;
    }
    g->controlled = true;
    g->controller = *from;
    g->heard_ns = sim_now_ns();
    return sim_registers_write(g->registers, SIM_REG_CONTROL, value, false);
}

/** Only the controller writes; anybody may become it while nobody is. */
static enum sim_gvcp_status write_word(struct sim_gvcp *g, const struct sockaddr_in *from,
                                       uint32_t address, uint32_t value)
{
    bool own = from_controller(g, from);
    if (address == SIM_REG_CONTROL && (own || !g->controlled))
        return write_control(g, from, value);
    if (!own)
        return SIM_GVCP_ACCESS_DENIED;
    return g->hooks.write(g->hooks.user, address, value);
}

static enum sim_gvcp_status read_registers(struct sim_gvcp *g, struct exchange *x)
{
    if (!x->n_data || x->n_data & 3)
        return SIM_GVCP_INVALID_PARAMETER;
    for (uint32_t at = 0; at < x->n_data; at += 4) {
        enum sim_gvcp_status status = sim_registers_read(g->registers, load32(x->data + at), 4,
                                                         x->answer + HEADER_BYTES + at);
        if (status)
            return status;
        x->n_answer = at + 4;
    }
    return SIM_GVCP_OK;
}

static enum sim_gvcp_status write_registers(struct sim_gvcp *g, struct exchange *x)
{
    enum sim_gvcp_status status = SIM_GVCP_OK;
    uint32_t done = 0;
    if (!x->n_data || x->n_data & 7)
        return SIM_GVCP_INVALID_PARAMETER;
    for (uint32_t at = 0; at < x->n_data && !status; at += 8) {
        status = write_word(g, &x->from, load32(x->data + at), load32(x->data + at + 4));
        done += !status;
    }
    sim_gev_store32(x->answer + HEADER_BYTES, done);
    x->n_answer = 4;
    return status;
}

static enum sim_gvcp_status read_memory(struct sim_gvcp *g, struct exchange *x)
{
    if (x->n_data != 8)
        return SIM_GVCP_INVALID_PARAMETER;
    uint32_t address = load32(x->data), size = load32(x->data + 4) & 0xffff;
    if (size > MAX_DATA_BYTES - 4 || size & 3)
        return SIM_GVCP_INVALID_PARAMETER;
    sim_gev_store32(x->answer + HEADER_BYTES, address);
    x->n_answer = 4 + size;
    return sim_registers_read(g->registers, address, size, x->answer + HEADER_BYTES + 4);
}

static enum sim_gvcp_status write_memory(struct sim_gvcp *g, struct exchange *x)
{
    enum sim_gvcp_status status = SIM_GVCP_OK;
    uint32_t at = 4;
    if (x->n_data < 8 || x->n_data & 3)
        return SIM_GVCP_INVALID_PARAMETER;
    for (; at < x->n_data && !status; at += 4)
        status = write_word(g, &x->from, load32(x->data) + at - 4, load32(x->data + at));
    sim_gev_store32(x->answer + HEADER_BYTES, at - 4);
    x->n_answer = 4;
    return status;
}

static enum sim_gvcp_status discover(struct sim_gvcp *g, struct exchange *x)
{
    x->n_answer = SIM_REG_DISCOVERY_END;
    return sim_registers_read(g->registers, 0, SIM_REG_DISCOVERY_END, x->answer + HEADER_BYTES);
}

static void request_resend(struct sim_gvcp *g, const struct exchange *x)
{
    if (x->n_data >= 12)
        g->hooks.resend(g->hooks.user, (uint16_t)load32(x->data), load32(x->data + 4) & 0xffffff,
                        load32(x->data + 8) & 0xffffff);
}

static enum sim_gvcp_status execute(struct sim_gvcp *g, struct exchange *x)
{
    switch (x->command) {
    case DISCOVERY:
        return discover(g, x);
    case READ_REGISTER:
        return read_registers(g, x);
    case WRITE_REGISTER:
        return write_registers(g, x);
    case READ_MEMORY:
        return read_memory(g, x);
    case WRITE_MEMORY:
        return write_memory(g, x);
    }
    return SIM_GVCP_NOT_IMPLEMENTED;
}

static void answer(struct sim_gvcp *g, struct exchange *x, enum sim_gvcp_status status)
{
    if (status && x->command != WRITE_REGISTER && x->command != WRITE_MEMORY)
        x->n_answer = 0;
    sim_gev_store16(x->answer, status);
    sim_gev_store16(x->answer + 2, x->command + 1u);
    sim_gev_store16(x->answer + 4, x->n_answer);
    sim_gev_store16(x->answer + 6, x->id);
    sendto(g->socket, x->answer, HEADER_BYTES + x->n_answer, 0, (struct sockaddr *)&x->from,
           sizeof x->from);
}

static void serve(struct sim_gvcp *g, int fd)
{
    uint8_t packet[HEADER_BYTES + MAX_DATA_BYTES];
    struct exchange x = {0};
    socklen_t size = sizeof x.from;
    ssize_t n =
        recvfrom(fd, packet, sizeof packet, MSG_DONTWAIT, (struct sockaddr *)&x.from, &size);
    if (n < HEADER_BYTES || packet[0] != KEY || sim_now_ns() < atomic_load(&g->silent_until_ns))
        return;
    x.command = (uint16_t)(packet[2] << 8 | packet[3]);
    x.id = (uint16_t)(packet[6] << 8 | packet[7]);
    x.ack = packet[1] & ACK_REQUIRED;
    x.data = packet + HEADER_BYTES;
    x.n_data = (uint32_t)(packet[4] << 8 | packet[5]);
    if (x.n_data > (uint32_t)n - HEADER_BYTES || (fd == g->broadcast && x.command != DISCOVERY))
        return;
    check_heartbeat(g);
    if (from_controller(g, &x.from))
        g->heard_ns = sim_now_ns();
    if (x.command == PACKET_RESEND) {
        request_resend(g, &x);
        return;
    }
    enum sim_gvcp_status status = execute(g, &x);
    if (x.ack)
        answer(g, &x, status);
}

static void *serve_until_quit(void *user)
{
    struct sim_gvcp *g = user;
    struct pollfd fds[] = {{g->kick, POLLIN, 0}, {g->socket, POLLIN, 0}, {g->broadcast, POLLIN, 0}};
    eventfd_t kicks;
    while (!atomic_load(&g->quit)) {
        int n = poll(fds, 3, g->controlled ? (int)(patience_ns(g) / 1000000) + 1 : -1);
        if (n < 0 && errno != EINTR)
            return NULL;
        if (n > 0 && fds[0].revents)
            eventfd_read(g->kick, &kicks);
        if (n > 0 && fds[1].revents)
            serve(g, g->socket);
        if (n > 0 && fds[2].revents)
            serve(g, g->broadcast);
        check_heartbeat(g);
    }
    return NULL;
}

static int bound_socket(uint32_t ip_address, bool shared)
{
    struct sockaddr_in at = {.sin_family = AF_INET,
                             .sin_port = htons(SIM_GVCP_PORT),
                             .sin_addr.s_addr = htonl(ip_address)};
    int fd = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0), on = 1;
    if (fd < 0)
        return -1;
    if (shared)
        setsockopt(fd, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
    if (bind(fd, (struct sockaddr *)&at, sizeof at) == 0)
        return fd;
    int error = errno;
    close(fd);
    errno = error;
    return -1;
}

static enum ls_err fail_bind(uint32_t ip_address, struct ls_diag *diag)
{
    struct in_addr at = {htonl(ip_address)};
    char text[INET_ADDRSTRLEN];
    enum ls_err err = errno == EADDRINUSE ? LS_ERR_BUSY : LS_ERR_OS;
    inet_ntop(AF_INET, &at, text, sizeof text);
    return ls_fail(diag, err, "camera %s: cannot bind UDP port %d: %s", text, SIM_GVCP_PORT,
                   strerror(errno));
}

static void close_all(struct sim_gvcp *g)
{
    if (g->socket >= 0)
        close(g->socket);
    if (g->broadcast >= 0)
        close(g->broadcast);
    if (g->kick >= 0)
        close(g->kick);
    free(g);
}

enum ls_err sim_gvcp_create(uint32_t ip_address, struct sim_registers *registers,
                            const struct sim_gvcp_hooks *hooks, struct sim_gvcp **out,
                            struct ls_diag *diag)
{
    struct sim_gvcp *g = calloc(1, sizeof *g);
    if (!g)
        return LS_ERR_NOMEM;
    enum ls_err err = LS_OK;
    g->registers = registers;
    g->hooks = *hooks;
    g->kick = eventfd(0, EFD_CLOEXEC);
    g->broadcast = bound_socket(INADDR_BROADCAST, true);
    g->socket = bound_socket(ip_address, false);
    if (g->socket < 0)
        err = fail_bind(ip_address, diag);
    else if (g->kick < 0 || pthread_create(&g->thread, NULL, serve_until_quit, g))
        err = ls_fail(diag, LS_ERR_OS, "camera: cannot start its control thread");
    if (err) {
        close_all(g);
        return err;
    }
    *out = g;
    return LS_OK;
}

void sim_gvcp_silence(struct sim_gvcp *g, uint64_t until_ns)
{
    atomic_store(&g->silent_until_ns, until_ns);
}

void sim_gvcp_release(struct sim_gvcp *g)
{
    atomic_store(&g->release, true);
    eventfd_write(g->kick, 1);
}

void sim_gvcp_destroy(struct sim_gvcp *g)
{
    if (!g)
        return;
    atomic_store(&g->quit, true);
    eventfd_write(g->kick, 1);
    pthread_join(g->thread, NULL);
    close_all(g);
}
