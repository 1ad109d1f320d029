/*
 * rig: the whole simulated rig of one process: scene, cameras and dome controller, wired together.
 * Layer: sim. Threads: create and destroy on one thread. Ownership: create / destroy; the
 * configuration outlives the rig.
 */
#ifndef LS_SIM_RIG_H
#define LS_SIM_RIG_H

#include "core/error.h"
#include "sim/config.h"

struct sim_rig;

/** Build the scene, bind everything and serve. Errors: those of the parts. (transfer full). */
LS_MUST_CHECK enum ls_err sim_rig_create(const struct sim_config *config, struct sim_rig **out,
                                         struct ls_diag *diag);

/** One JSON object in one line: pid, modbus_address, modbus_port, cameras (addresses), lights,
 * channels. (transfer full), free(). NULL if out of memory. */
char *sim_rig_ready_line(const struct sim_rig *rig);

/** LEDs dark, connections closed, log closed. LS_ERR_OS if the log lost lines. NULL is allowed.
 * While a program is being prepared this ends the process instead, with success: the pictures of a
 * program can take minutes, and a rig that was told to go must go. */
LS_MUST_CHECK enum ls_err sim_rig_destroy(struct sim_rig *rig, struct ls_diag *diag);

#endif
