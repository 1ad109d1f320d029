/*
 * modbus: links to a controller over Modbus TCP and over a serial line (RTU).
 * Layer: drivers. Threads, errors and ownership: drivers/link.h.
 *
 * libmodbus' own recovery is off. On a serial line a late answer would be taken for the next one,
 * for want of a transaction number: after a timeout connect waits until the line has been quiet for
 * one more.
 */
#ifndef LS_DRIVERS_MODBUS_MODBUS_H
#define LS_DRIVERS_MODBUS_MODBUS_H

#include "drivers/link.h"

/** create resolves the host: the only call that may ask a name server. Errors: LS_ERR_INVALID,
 * LS_ERR_GONE (no such host), LS_ERR_NOMEM. */
extern const struct ls_wire ls_wire_modbus;

/** create refuses, with LS_ERR_INVALID, a timeout shorter than the longest request and answer
 * take at this rate. */
extern const struct ls_wire ls_wire_modbus_rtu;

#endif
