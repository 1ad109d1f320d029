/* dome_server [WIRE]: the simulated controller alone, for tests that drive it from another program,
 * on Modbus TCP, or "modbus-rtu", "usb". The port, or the path of the line or testbed, is the first
 * line of output; every pulse is a line "step condition width_us"; it ends with its standard input.
 */
#include "sim/controller.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static void on_pulse(void *user, const struct sim_pulse *pulse)
{
    printf("%u %u %.0f\n", pulse->step, pulse->condition, pulse->pulse_us);
    fflush(stdout);
}

int main(int argc, char **argv)
{
    struct sim_controller_config config;
    struct sim_controller_hooks hooks = {.pulse = on_pulse};
    struct sim_controller *controller;
    struct ls_diag diag = {0};
    sim_controller_defaults(&config);
    config.heartbeat_ms = 60000;
    if (argc > 1)
        config.wire = strcmp(argv[1], "usb") ? SIM_WIRE_MODBUS_RTU : SIM_WIRE_USB;
    if (sim_controller_create(&config, &hooks, &controller, &diag)) {
        fprintf(stderr, "%s\n", diag.text);
        return EXIT_FAILURE;
    }
    if (config.wire == SIM_WIRE_MODBUS)
        printf("%u\n", sim_controller_port(controller));
    else
        printf("%s\n", sim_controller_path(controller));
    fflush(stdout);
    while (getchar() != EOF)
        ;
    sim_controller_destroy(controller);
    return EXIT_SUCCESS;
}
