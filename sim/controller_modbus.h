/*
 * controller_modbus: Modbus requests on the controller's registers, for both of its Modbus wires.
 * Layer: sim. Threads: the server's. Ownership: embedded; init and finish.
 */
#ifndef LS_SIM_CONTROLLER_MODBUS_H
#define LS_SIM_CONTROLLER_MODBUS_H

#include "sim/controller_private.h"

#include <modbus.h>

struct sim_modbus {
    modbus_t *context;
    modbus_mapping_t *map;
};

/** @context: (transfer full), NULL: LS_ERR_NOMEM. */
LS_MUST_CHECK enum ls_err sim_modbus_init(struct sim_modbus *m, modbus_t *context,
                                          struct ls_diag *diag);

/** Receive one request into @request, of MODBUS_MAX_ADU_LENGTH bytes. Returns its length, 0 if it
 * is to be ignored, -1 when the client is gone. */
int sim_modbus_receive(struct sim_modbus *m, uint8_t *request);

/** Act on a request. Returns enum sim_answer; what was read is in the map. */
int sim_modbus_act(struct sim_modbus *m, struct sim_controller *c, const uint8_t *request,
                   int length);

/** Answer it, given what act returned. Returns -1 when the client is gone. */
int sim_modbus_answer(struct sim_modbus *m, const uint8_t *request, int length, int act);

/** A zeroed one is allowed. */
void sim_modbus_finish(struct sim_modbus *m);

#endif
