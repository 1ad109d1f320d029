/*
 * calibrate_options: the command line of calibrate.
 * Layer: clients. Threads: the main thread. Ownership: strings are the command line's.
 */
#ifndef LS_CLIENTS_CALIBRATE_OPTIONS_H
#define LS_CLIENTS_CALIBRATE_OPTIONS_H

#include "clients/calibrate_shoot.h"
#include "core/calibration.h"

#include <stdbool.h>
#include <stdint.h>

struct ls_calibrate_options {
    const char *output, *base, *plan;
    const char *takes[LS_N_OBJECTS]; /* existing ones; NULL = to be made */
    bool skip[LS_N_OBJECTS];
    double radius_m, reflectance;
    uint32_t cameras[LS_CALIBRATION_MAX_CAMERAS], n_cameras;
    struct ls_calibrate_shoot shoot;
};

/** LS_EXIT_OK or the exit code, said already. */
int ls_calibrate_options_parse(struct ls_command_context *context, int argc, char **argv,
                               struct ls_calibrate_options *o);

#endif
