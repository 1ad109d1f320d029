#include "drivers/lights.h"

#include "drivers/modbus/dome.h"

#include <stdlib.h>
#include <string.h>

struct ls_lights {
    const struct ls_lights_ops *ops;
    void *priv;
    struct ls_lights_info info;
};

static const struct ls_lights_ops *const drivers[] = {&ls_modbus_lights_ops};

static const struct ls_lights_ops *find_driver(const char *name)
{
    for (size_t i = 0; name && i < sizeof drivers / sizeof *drivers; i++)
        if (!strcmp(drivers[i]->name, name))
            return drivers[i];
    return NULL;
}

enum ls_err ls_lights_open(const struct ls_lights_config *config, struct ls_lights **out,
                           struct ls_diag *diag)
{
    *out = NULL;
    struct ls_lights_config full = *config;
    if (!full.timeout_ms)
        full.timeout_ms = 500;
    const struct ls_lights_ops *ops = find_driver(full.driver);
    if (!ops)
        return ls_fail(diag, LS_ERR_NOT_FOUND, "lights driver \"%s\": expected \"modbus\"",
                       full.driver ? full.driver : "");
    if (!full.address || !full.address[0])
        return ls_fail(diag, LS_ERR_INVALID, "lights: expected an address, found none");
    LS_CLEANUP_FREE struct ls_lights *lights = calloc(1, sizeof *lights);
    if (!lights)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    lights->ops = ops;
    enum ls_err err = ops->open(&full, &lights->priv, &lights->info, diag);
    if (err)
        return err;
    *out = lights;
    lights = NULL;
    return LS_OK;
}

const struct ls_lights_info *ls_lights_info(const struct ls_lights *lights)
{
    return &lights->info;
}

enum ls_err ls_lights_load(struct ls_lights *lights, const struct ls_program *program,
                           const _Atomic bool *stop, struct ls_diag *diag)
{
    enum ls_err err = ls_lights_test(&lights->info, program, diag);
    return err ? err : lights->ops->load(lights->priv, program, stop, diag);
}

enum ls_err ls_lights_arm(struct ls_lights *lights, struct ls_diag *diag)
{
    return lights->ops->arm(lights->priv, diag);
}

enum ls_err ls_lights_grant(struct ls_lights *lights, uint32_t n_steps, struct ls_diag *diag)
{
    return lights->ops->grant(lights->priv, n_steps, diag);
}

enum ls_err ls_lights_poll(struct ls_lights *lights, struct ls_lights_status *status,
                           struct ls_step_event *events, size_t max_events, size_t *n_events,
                           struct ls_diag *diag)
{
    *n_events = 0;
    return lights->ops->poll(lights->priv, status, events, max_events, n_events, diag);
}

enum ls_err ls_lights_blank(struct ls_lights *lights, struct ls_diag *diag)
{
    return lights->ops->blank(lights->priv, diag);
}

void ls_lights_close(struct ls_lights *lights)
{
    if (!lights)
        return;
    lights->ops->close(lights->priv);
    free(lights);
}
