/*
 * link: Modbus TCP transactions with errors a driver can act on.
 * Layer: drivers/modbus. Threads: one at a time. Ownership: embedded; init and finish.
 *
 * libmodbus' own recovery is off. After a timeout, a broken connection or an answer that makes no
 * sense the connection is closed, since a late answer could be taken for the next one; the next
 * ls_link_connect opens a new one. An exception answered by the device leaves it open.
 */
#ifndef LS_DRIVERS_MODBUS_LINK_H
#define LS_DRIVERS_MODBUS_LINK_H

#include "core/error.h"

#include <modbus.h>
#include <stdbool.h>
#include <stdint.h>

struct ls_link {
    modbus_t *modbus;
    bool connected;
    char host[64]; /* numeric */
    unsigned port;
    unsigned timeout_ms;
};

/** Resolve @host (the only call that may ask a name server) and prepare; does not connect.
 * Errors: LS_ERR_INVALID, LS_ERR_GONE (no such host), LS_ERR_NOMEM. */
LS_MUST_CHECK enum ls_err ls_link_init(struct ls_link *link, const char *host, unsigned port,
                                       unsigned unit, unsigned timeout_ms, struct ls_diag *diag);

/** LS_OK at once if connected. Errors: LS_ERR_GONE, LS_ERR_TIMEOUT. Blocks one timeout at most. */
LS_MUST_CHECK enum ls_err ls_link_connect(struct ls_link *link, struct ls_diag *diag);

void ls_link_disconnect(struct ls_link *link);

/**
 * One transaction each: FC3, FC16 and FC23. Block for one timeout at most, allocate nothing.
 * Errors: LS_ERR_TIMEOUT and LS_ERR_GONE (connection closed), LS_ERR_REFUSED (exception 4: the
 * device says why in its status), LS_ERR_BUSY (exception 6), LS_ERR_UNSUPPORTED (any other
 * exception: the device does not have these registers). On an unconnected link: LS_ERR_GONE.
 */
LS_MUST_CHECK enum ls_err ls_link_read(struct ls_link *link, unsigned address, unsigned n,
                                       uint16_t *regs, struct ls_diag *diag);
LS_MUST_CHECK enum ls_err ls_link_write(struct ls_link *link, unsigned address, unsigned n,
                                        const uint16_t *regs, struct ls_diag *diag);
LS_MUST_CHECK enum ls_err ls_link_write_read(struct ls_link *link, unsigned write_address,
                                             unsigned n_write, const uint16_t *write,
                                             unsigned read_address, unsigned n_read, uint16_t *read,
                                             struct ls_diag *diag);

/** Disconnect and free. A zeroed link is allowed. */
void ls_link_finish(struct ls_link *link);

#endif
