#include "drivers/lights.h"

#include "drivers/dome.h"
#include "drivers/modbus/modbus.h"
#include "drivers/usb/usb.h"

#include <stdlib.h>
#include <string.h>

struct ls_lights {
    struct ls_dome *dome;
};

static const struct ls_wire *const wires[] = {&ls_wire_modbus, &ls_wire_modbus_rtu, &ls_wire_usb};

static const struct ls_wire *find_wire(const char *name)
{
    for (size_t i = 0; name && i < sizeof wires / sizeof *wires; i++)
        if (!strcmp(wires[i]->name, name))
            return wires[i];
    return NULL;
}

enum ls_err ls_lights_open(const struct ls_lights_config *config, struct ls_lights **out,
                           struct ls_diag *diag)
{
    *out = NULL;
    struct ls_lights_config full = *config;
    if (!full.timeout_ms)
        full.timeout_ms = 500;
    const struct ls_wire *wire = find_wire(full.driver);
    if (!wire)
        return ls_fail(diag, LS_ERR_NOT_FOUND,
                       "lights driver \"%s\": expected \"modbus\", \"modbus-rtu\" or \"usb\"",
                       full.driver ? full.driver : "");
    if (!full.address || !full.address[0])
        return ls_fail(diag, LS_ERR_INVALID, "lights: expected an address, found none");
    LS_CLEANUP_FREE struct ls_lights *lights = calloc(1, sizeof *lights);
    if (!lights)
        return ls_fail(diag, LS_ERR_NOMEM, "out of memory");
    struct ls_link *link;
    enum ls_err err = wire->create(&full, &link, diag);
    if (!err)
        err = ls_dome_open(link, &lights->dome, diag);
    if (err)
        return err;
    *out = lights;
    lights = NULL;
    return LS_OK;
}

const struct ls_lights_info *ls_lights_info(const struct ls_lights *lights)
{
    return ls_dome_info(lights->dome);
}

enum ls_err ls_lights_load(struct ls_lights *lights, const struct ls_program *program,
                           const _Atomic bool *stop, struct ls_diag *diag)
{
    enum ls_err err = ls_lights_test(ls_dome_info(lights->dome), program, diag);
    return err ? err : ls_dome_load(lights->dome, program, stop, diag);
}

enum ls_err ls_lights_arm(struct ls_lights *lights, struct ls_diag *diag)
{
    return ls_dome_arm(lights->dome, diag);
}

enum ls_err ls_lights_grant(struct ls_lights *lights, uint32_t n_steps, struct ls_diag *diag)
{
    return ls_dome_grant(lights->dome, n_steps, diag);
}

enum ls_err ls_lights_poll(struct ls_lights *lights, struct ls_lights_status *status,
                           struct ls_step_event *events, size_t max_events, size_t *n_events,
                           struct ls_diag *diag)
{
    *n_events = 0;
    return ls_dome_poll(lights->dome, status, events, max_events, n_events, diag);
}

enum ls_err ls_lights_blank(struct ls_lights *lights, struct ls_diag *diag)
{
    return ls_dome_blank(lights->dome, diag);
}

enum ls_err ls_lights_set_work(struct ls_lights *lights, uint16_t channel, uint16_t level,
                               struct ls_diag *diag)
{
    enum ls_err err = ls_lights_test_work(ls_dome_info(lights->dome), channel, level, diag);
    return err ? err : ls_dome_set_work(lights->dome, channel, level, diag);
}

enum ls_err ls_lights_work(struct ls_lights *lights, struct ls_diag *diag)
{
    return ls_dome_work(lights->dome, diag);
}

enum ls_err ls_lights_steady(struct ls_lights *lights, struct ls_diag *diag)
{
    return ls_dome_steady(lights->dome, diag);
}

void ls_lights_close(struct ls_lights *lights)
{
    if (!lights)
        return;
    ls_dome_close(lights->dome);
    free(lights);
}
