#include "drivers/modbus/link.h"

#include <errno.h>
#include <netdb.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>

static enum ls_err resolve(struct ls_link *link, const char *host, struct ls_diag *diag)
{
    struct addrinfo hints = {.ai_socktype = SOCK_STREAM}, *found = NULL;
    int rc = getaddrinfo(host, NULL, &hints, &found);
    if (!rc) {
        rc = getnameinfo(found->ai_addr, found->ai_addrlen, link->host, sizeof link->host, NULL, 0,
                         NI_NUMERICHOST);
        freeaddrinfo(found);
    }
    if (rc)
        return ls_fail(diag, LS_ERR_GONE, "controller address \"%s\": %s", host, gai_strerror(rc));
    return LS_OK;
}

enum ls_err ls_link_init(struct ls_link *link, const char *host, unsigned port, unsigned unit,
                         unsigned timeout_ms, struct ls_diag *diag)
{
    memset(link, 0, sizeof *link);
    if (port < 1 || port > 65535)
        return ls_fail(diag, LS_ERR_INVALID, "controller port %u: expected 1..65535", port);
    if (unit > 247 && unit != MODBUS_TCP_SLAVE)
        return ls_fail(diag, LS_ERR_INVALID, "controller unit %u: expected 0..247 or 255", unit);
    enum ls_err err = resolve(link, host, diag);
    if (err)
        return err;
    char service[8];
    snprintf(service, sizeof service, "%u", port);
    link->port = port;
    link->timeout_ms = timeout_ms;
    link->modbus = modbus_new_tcp_pi(link->host, service);
    if (!link->modbus)
        return ls_fail(diag, LS_ERR_NOMEM, "modbus: %s", modbus_strerror(errno));
    modbus_set_slave(link->modbus, (int)unit);
    modbus_set_error_recovery(link->modbus, MODBUS_ERROR_RECOVERY_NONE);
    modbus_set_response_timeout(link->modbus, timeout_ms / 1000, timeout_ms % 1000 * 1000);
    modbus_set_byte_timeout(link->modbus, timeout_ms / 1000, timeout_ms % 1000 * 1000);
    return LS_OK;
}

static enum ls_err lost(struct ls_link *link, const char *doing, int error, struct ls_diag *diag)
{
    bool timeout = error == ETIMEDOUT || error == EINPROGRESS;
    ls_link_disconnect(link);
    if (timeout)
        return ls_fail(diag, LS_ERR_TIMEOUT,
                       "controller %s port %u: %s: no answer within %u ms; is it powered and is "
                       "this its address?",
                       link->host, link->port, doing, link->timeout_ms);
    return ls_fail(diag, LS_ERR_GONE, "controller %s port %u: %s: %s", link->host, link->port,
                   doing, modbus_strerror(error));
}

enum ls_err ls_link_connect(struct ls_link *link, struct ls_diag *diag)
{
    if (link->connected)
        return LS_OK;
    if (modbus_connect(link->modbus))
        return lost(link, "connecting", errno, diag);
    link->connected = true;
    return LS_OK;
}

void ls_link_disconnect(struct ls_link *link)
{
    modbus_close(link->modbus);
    link->connected = false;
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

enum ls_err ls_link_read(struct ls_link *link, unsigned address, unsigned n, uint16_t *regs,
                         struct ls_diag *diag)
{
    if (!link->connected)
        return lost(link, "reading", ENOTCONN, diag);
    if (modbus_read_registers(link->modbus, (int)address, (int)n, regs) != (int)n)
        return failed(link, "reading", address, errno, diag);
    return LS_OK;
}

enum ls_err ls_link_write(struct ls_link *link, unsigned address, unsigned n, const uint16_t *regs,
                          struct ls_diag *diag)
{
    if (!link->connected)
        return lost(link, "writing", ENOTCONN, diag);
    if (modbus_write_registers(link->modbus, (int)address, (int)n, regs) != (int)n)
        return failed(link, "writing", address, errno, diag);
    return LS_OK;
}

enum ls_err ls_link_write_read(struct ls_link *link, unsigned write_address, unsigned n_write,
                               const uint16_t *write, unsigned read_address, unsigned n_read,
                               uint16_t *read, struct ls_diag *diag)
{
    if (!link->connected)
        return lost(link, "reading", ENOTCONN, diag);
    if (modbus_write_and_read_registers(link->modbus, (int)write_address, (int)n_write, write,
                                        (int)read_address, (int)n_read, read) != (int)n_read)
        return failed(link, "reading", read_address, errno, diag);
    return LS_OK;
}

void ls_link_finish(struct ls_link *link)
{
    if (!link->modbus)
        return;
    ls_link_disconnect(link);
    modbus_free(link->modbus);
    link->modbus = NULL;
}
