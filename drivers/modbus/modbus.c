#include "drivers/modbus/modbus.h"

#include <errno.h>
#include <modbus.h>
#include <netdb.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

enum {
    RTU_BYTE_BITS = 10, /* start, 8 data, stop */
    RTU_TURNAROUND_MS = 20,
    /* unit, function, CRC, and: */
    RTU_READ_BYTES = 4 + 4,       /* address, count */
    RTU_WRITE_READ_BYTES = 4 + 9, /* two of those, bytes written */
    RTU_ANSWER_BYTES = 4 + 1,     /* bytes read */
};

struct modbus_link {
    struct ls_link link;
    modbus_t *modbus;
    unsigned timeout_ms;
    unsigned baud; /* serial */
    bool serial;
    unsigned turn_ms; /* serial: the longest request and its answer */
    unsigned late_ms; /* serial: an answer may still be on its way, or lie there, until the line has
                         been quiet for so long; at first one to whoever used it before us */
    char name[160];   /* of the other end, for people */
};

static struct modbus_link *of(struct ls_link *link)
{
    return (struct modbus_link *)link;
}

static void link_disconnect(struct ls_link *link)
{
    modbus_close(of(link)->modbus);
    link->connected = false;
}

static enum ls_err lost(struct ls_link *link, const char *doing, int error, struct ls_diag *diag)
{
    struct modbus_link *m = of(link);
    bool timeout = error == ETIMEDOUT || error == EINPROGRESS;
    m->late_ms = timeout && m->serial ? m->timeout_ms : m->turn_ms;
    link_disconnect(link);
    if (timeout)
        return ls_fail(diag, LS_ERR_TIMEOUT,
                       "controller %s: %s: no answer within %u ms; is it powered and is this its "
                       "address?",
                       m->name, doing, m->timeout_ms);
    return ls_fail(diag, LS_ERR_GONE, "controller %s: %s: %s", m->name, doing,
                   modbus_strerror(error));
}

/* Discard what comes until nothing has come for late_ms, but not for longer than twice that. */
static void let_pass(struct modbus_link *m)
{
    uint8_t bytes[256];
    int64_t limit = ls_link_now_ms() + 2 * (int64_t)m->late_ms;
    struct pollfd fd = {.fd = modbus_get_socket(m->modbus), .events = POLLIN};
    while (ls_link_now_ms() < limit && poll(&fd, 1, (int)m->late_ms) > 0)
        if (read(fd.fd, bytes, sizeof bytes) <= 0)
            break;
    m->late_ms = 0;
}

static enum ls_err link_connect(struct ls_link *link, struct ls_diag *diag)
{
    struct modbus_link *m = of(link);
    if (link->connected)
        return LS_OK;
    if (modbus_connect(m->modbus))
        return lost(link, "connecting", errno, diag);
    link->connected = true;
    if (m->late_ms)
        let_pass(m);
    return LS_OK;
}

static enum ls_err failed(struct ls_link *link, const char *doing, unsigned address, int error,
                          struct ls_diag *diag)
{
    if (error == EMBXSFAIL)
        return ls_fail(diag, LS_ERR_REFUSED, "%s at register %u: refused by the controller", doing,
                       address);
    if (error == EMBXSBUSY)
        return ls_fail(diag, LS_ERR_BUSY, "%s at register %u: the controller is busy", doing,
                       address);
    if (error >= EMBXILFUN && error <= EMBXGTAR)
        return ls_fail(diag, LS_ERR_UNSUPPORTED, "%s at register %u: the device answers: %s", doing,
                       address, modbus_strerror(error));
    return lost(link, doing, error, diag);
}

/** Bytes take their time on a serial line: those asked before the controller acts, those answered
 * after. */
static uint64_t on_wire_ns(const struct modbus_link *m, unsigned bytes)
{
    return m->serial ? bytes * RTU_BYTE_BITS * UINT64_C(1000000000) / m->baud : 0;
}

static void say_when(struct modbus_link *m, uint64_t asked_ns, unsigned bytes_asked,
                     unsigned bytes_answered)
{
    uint64_t before_ns = asked_ns + on_wire_ns(m, bytes_asked);
    uint64_t after_ns = ls_link_now_ns() - on_wire_ns(m, bytes_answered);
    m->link.before_ns = before_ns < after_ns ? before_ns : asked_ns;
    m->link.after_ns = before_ns < after_ns ? after_ns : ls_link_now_ns();
}

static enum ls_err link_read(struct ls_link *link, unsigned address, unsigned n, uint16_t *regs,
                             struct ls_diag *diag)
{
    if (!link->connected)
        return lost(link, "reading", ENOTCONN, diag);
    uint64_t asked_ns = ls_link_now_ns();
    if (modbus_read_registers(of(link)->modbus, (int)address, (int)n, regs) != (int)n)
        return failed(link, "reading", address, errno, diag);
    say_when(of(link), asked_ns, RTU_READ_BYTES, RTU_ANSWER_BYTES + 2 * n);
    return LS_OK;
}

static enum ls_err link_write(struct ls_link *link, unsigned address, unsigned n,
                              const uint16_t *regs, struct ls_diag *diag)
{
    if (!link->connected)
        return lost(link, "writing", ENOTCONN, diag);
    if (modbus_write_registers(of(link)->modbus, (int)address, (int)n, regs) != (int)n)
        return failed(link, "writing", address, errno, diag);
    return LS_OK;
}

static enum ls_err link_write_read(struct ls_link *link, unsigned write_address, unsigned n_write,
                                   const uint16_t *write, unsigned read_address, unsigned n_read,
                                   uint16_t *read, struct ls_diag *diag)
{
    if (!link->connected)
        return lost(link, "reading", ENOTCONN, diag);
    uint64_t asked_ns = ls_link_now_ns();
    if (modbus_write_and_read_registers(of(link)->modbus, (int)write_address, (int)n_write, write,
                                        (int)read_address, (int)n_read, read) != (int)n_read)
        return failed(link, "reading", read_address, errno, diag);
    say_when(of(link), asked_ns, RTU_WRITE_READ_BYTES + 2 * n_write, RTU_ANSWER_BYTES + 2 * n_read);
    return LS_OK;
}

static void link_destroy(struct ls_link *link)
{
    if (of(link)->modbus) {
        link_disconnect(link);
        modbus_free(of(link)->modbus);
    }
    free(link);
}

static const struct ls_link_ops modbus_ops = {
    .connect = link_connect,
    .disconnect = link_disconnect,
    .read = link_read,
    .write = link_write,
    .write_read = link_write_read,
    .destroy = link_destroy,
};

/** @modbus: (transfer full), NULL: creating it failed with errno. */
static enum ls_err finish_create(struct modbus_link *m, modbus_t *modbus,
                                 const struct ls_lights_config *config, struct ls_link **out,
                                 struct ls_diag *diag)
{
    m->link.ops = &modbus_ops;
    m->modbus = modbus;
    m->timeout_ms = config->timeout_ms;
    if (!modbus) {
        link_destroy(&m->link);
        return ls_fail(diag, errno == EINVAL ? LS_ERR_INVALID : LS_ERR_NOMEM, "controller %s: %s",
                       config->address, modbus_strerror(errno));
    }
    modbus_set_slave(modbus, (int)config->unit);
    modbus_set_error_recovery(modbus, MODBUS_ERROR_RECOVERY_NONE);
    modbus_set_response_timeout(modbus, m->timeout_ms / 1000, m->timeout_ms % 1000 * 1000);
    modbus_set_byte_timeout(modbus, m->timeout_ms / 1000, m->timeout_ms % 1000 * 1000);
    *out = &m->link;
    return LS_OK;
}

static enum ls_err check_unit(unsigned unit, unsigned highest, struct ls_diag *diag)
{
    if (unit > 247 && unit != highest)
        return ls_fail(diag, LS_ERR_INVALID, "controller unit %u: expected 0..247 or %u", unit,
                       highest);
    return LS_OK;
}

static enum ls_err resolve(const char *host, char *numeric, size_t size, struct ls_diag *diag)
{
    struct addrinfo hints = {.ai_socktype = SOCK_STREAM}, *found = NULL;
    int rc = getaddrinfo(host, NULL, &hints, &found);
    if (!rc) {
        rc = getnameinfo(found->ai_addr, found->ai_addrlen, numeric, (socklen_t)size, NULL, 0,
                         NI_NUMERICHOST);
        freeaddrinfo(found);
    }
    if (rc)
        return ls_fail(diag, LS_ERR_GONE, "controller address \"%s\": %s", host, gai_strerror(rc));
    return LS_OK;
}

static enum ls_err create_tcp(const struct ls_lights_config *config, struct ls_link **out,
                              struct ls_diag *diag)
{
    char host[64], service[8];
    *out = NULL;
    if (config->port < 1 || config->port > 65535)
        return ls_fail(diag, LS_ERR_INVALID, "controller port %u: expected 1..65535", config->port);
    enum ls_err err = check_unit(config->unit, MODBUS_TCP_SLAVE, diag);
    if (!err)
        err = resolve(config->address, host, sizeof host, diag);
    if (err)
        return err;
    struct modbus_link *m = calloc(1, sizeof *m);
    if (!m)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    snprintf(service, sizeof service, "%u", config->port);
    snprintf(m->name, sizeof m->name, "%s port %u", host, config->port);
    return finish_create(m, modbus_new_tcp_pi(host, service), config, out, diag);
}

/** libmodbus takes any other for 9600, and says nothing. */
static bool is_baud(unsigned baud)
{
    static const unsigned usual[] = {9600,    19200,   38400,   57600,   115200,  230400,
                                     460800,  500000,  576000,  921600,  1000000, 1152000,
                                     1500000, 2000000, 2500000, 3000000, 3500000, 4000000};
    for (size_t i = 0; i < sizeof usual / sizeof *usual; i++)
        if (usual[i] == baud)
            return true;
    return false;
}

static enum ls_err create_rtu(const struct ls_lights_config *config, struct ls_link **out,
                              struct ls_diag *diag)
{
    *out = NULL;
    if (!is_baud(config->baud))
        return ls_fail(diag, LS_ERR_INVALID,
                       "controller baud %u: expected a usual rate such as 115200", config->baud);
    unsigned least =
        2 * MODBUS_RTU_MAX_ADU_LENGTH * RTU_BYTE_BITS * 1000 / config->baud + RTU_TURNAROUND_MS;
    if (config->timeout_ms < least)
        return ls_fail(diag, LS_ERR_INVALID,
                       "controller timeout %u ms: expected at least %u ms, as long as the longest "
                       "request and answer take at %u baud",
                       config->timeout_ms, least, config->baud);
    enum ls_err err = check_unit(config->unit, 247, diag);
    if (err)
        return err;
    struct modbus_link *m = calloc(1, sizeof *m);
    if (!m)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    m->serial = true;
    m->baud = config->baud;
    m->turn_ms = m->late_ms = least;
    snprintf(m->name, sizeof m->name, "%s at %u baud", config->address, config->baud);
    return finish_create(m, modbus_new_rtu(config->address, (int)config->baud, 'N', 8, 1), config,
                         out, diag);
}

const struct ls_wire ls_wire_modbus = {.name = "modbus", .create = create_tcp};
const struct ls_wire ls_wire_modbus_rtu = {.name = "modbus-rtu", .create = create_rtu};
