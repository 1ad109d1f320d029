/*
 * rig: the devices of the configuration, opened together.
 * Layer: daemon. Threads: one at a time. Ownership: the rig owns its devices; the configuration is
 * (transfer none) and outlives it.
 */
#ifndef LS_DAEMON_RIG_H
#define LS_DAEMON_RIG_H

#include "core/error.h"
#include "daemon/config.h"
#include "drivers/camera.h"
#include "drivers/lights.h"

#include <stdbool.h>

struct ls_rig {
    const struct ls_config *config;
    struct ls_lights *lights;
    struct ls_camera *cameras[LS_MAX_CAMERAS];
    const struct ls_camera_info *camera_infos[LS_MAX_CAMERAS];
};

/** Open every device and apply every camera's settings. On error nothing stays open and the
 * sentence names the device. Once *stop is set no other is begun with (NULL: never). Errors as
 * ls_lights_open, ls_camera_open, ls_camera_apply; LS_ERR_ABORTED. */
LS_MUST_CHECK enum ls_err ls_rig_open(const struct ls_config *config, const _Atomic bool *stop,
                                      struct ls_rig *rig, struct ls_diag *diag);

/** LEDs dark, devices closed. A zeroed rig is allowed. */
void ls_rig_close(struct ls_rig *rig);

#endif
