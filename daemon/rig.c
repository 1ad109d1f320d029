#include "daemon/rig.h"

#include <stdatomic.h>
#include <stdio.h>

/* Put the device's name before what its driver said. */
static enum ls_err name_device(enum ls_err err, const char *device, struct ls_diag *diag)
{
    char said[sizeof diag->text];
    snprintf(said, sizeof said, "%s", diag->text);
    return ls_fail(diag, err, "%s: %.440s", device, said);
}

static enum ls_err open_camera(struct ls_rig *rig, uint32_t i, struct ls_diag *diag)
{
    const struct ls_config_camera *c = &rig->config->cameras[i];
    char device[96];
    enum ls_err err = ls_camera_open(&c->driver, &rig->cameras[i], diag);
    if (!err)
        err = ls_camera_apply(rig->cameras[i], &c->driver, diag);
    if (!err) {
        rig->camera_infos[i] = ls_camera_info(rig->cameras[i]);
        return LS_OK;
    }
    snprintf(device, sizeof device, "camera %u (%.64s)", i, c->driver.address);
    return name_device(err, device, diag);
}

enum ls_err ls_rig_open(const struct ls_config *config, const _Atomic bool *stop,
                        struct ls_rig *rig, struct ls_diag *diag)
{
    struct ls_diag local = {0};
    diag = diag ? diag : &local;
    *rig = (struct ls_rig){.config = config};
    enum ls_err err = ls_lights_open(&config->lights_driver, &rig->lights, diag);
    if (err)
        err = name_device(err, "dome controller", diag);
    for (uint32_t i = 0; i < config->n_cameras && !err; i++)
        err =
            stop && atomic_load(stop)
                ? ls_fail(diag, LS_ERR_ABORTED,
                          "given up while the devices were opened: it was aborted, all lights were "
                          "turned off, or the daemon ends")
                : open_camera(rig, i, diag);
    if (err)
        ls_rig_close(rig);
    return err;
}

void ls_rig_close(struct ls_rig *rig)
{
    for (uint32_t i = 0; i < LS_MAX_CAMERAS; i++)
        ls_camera_close(rig->cameras[i]);
    ls_lights_close(rig->lights);
    *rig = (struct ls_rig){0};
}
