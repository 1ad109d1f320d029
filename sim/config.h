/*
 * config: the simulator's configuration file. Every key is documented in sim/README.md.
 * Layer: sim. Threads: any; pure but for reading the file. Ownership: the caller owns the struct,
 * which must stay where it is: cameras[].address and others point into it.
 */
#ifndef LS_SIM_CONFIG_H
#define LS_SIM_CONFIG_H

#include "core/error.h"
#include "sim/camera.h"
#include "sim/controller.h"
#include "sim/scene.h"

#include <stdint.h>

struct sim_config {
    struct sim_scene_config scene; /* n_cameras and views included */
    struct sim_camera_config cameras[SIM_MAX_CAMERAS];
    struct sim_camera_names {
        char address[64], serial[32], model[32];
    } names[SIM_MAX_CAMERAS];
    struct sim_controller_config controller; /* n_lights: the scene knows better for a CSV */
    char log[1024];                          /* "" = none */
};

/** What an empty file means: the reference scene, one camera at 127.0.0.2, the reference dome. */
void sim_config_defaults(struct sim_config *config);

/**
 * Read @path over the defaults. Errors: LS_ERR_NOT_FOUND (no such file), LS_ERR_INVALID (syntax,
 * unknown key, wrong type, out of range): "FILE:LINE: key: expected ...".
 */
LS_MUST_CHECK enum ls_err sim_config_load(const char *path, struct sim_config *config,
                                          struct ls_diag *diag);

#endif
