/*
 * calibrate_shoot: the takes of a calibration, each after somebody has put its object in place.
 * Layer: clients. Threads: the main thread. Ownership: as stated.
 */
#ifndef LS_CLIENTS_CALIBRATE_SHOOT_H
#define LS_CLIENTS_CALIBRATE_SHOOT_H

#include "clients/command.h"

#include <stdbool.h>
#include <stdint.h>

enum ls_calibrate_object { LS_OBJECT_GREY, LS_OBJECT_CHROME, LS_OBJECT_GLOSS, LS_N_OBJECTS };

struct ls_calibrate_shoot {
    const char *exposures_us[LS_N_OBJECTS]; /* "100, 800, 6400" */
    uint32_t darks, segments;               /* segments 0 = none */
    bool segments_asked;                    /* else a rig of fewer lights goes without */
    const char *shown, *shown_name;         /* calibrate_plan.h; NULL = none */
    bool yes;                               /* do not ask */
};

/** Ask for the object, photograph it, and wait for the end. id[128]: of the take. Returns an exit
 * code; LS_EXIT_NO where nobody answered or the take is not complete (said). */
int ls_calibrate_shoot(struct ls_command_context *context, const struct ls_calibrate_shoot *shoot,
                       enum ls_calibrate_object object, char id[128]);

#endif
