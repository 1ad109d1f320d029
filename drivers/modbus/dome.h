/*
 * dome: a dome controller that speaks the contract over Modbus TCP.
 * Layer: drivers. Threads: one at a time, as lights.h.
 * Lifecycle is in dome.c, bytes and reconnection in link.c; the contract in README.md.
 */
#ifndef LS_DRIVERS_MODBUS_DOME_H
#define LS_DRIVERS_MODBUS_DOME_H

#include "drivers/lights.h"

extern const struct ls_lights_ops ls_modbus_lights_ops;

#endif
