/*
 * lights_fixture: a lights driver on a simulated controller, in verbs.
 * Layer: tests. Threads: the test's one. Ownership: stand_up / stand_down.
 *
 * A test of the conformance suite is run against every driver there is.
 */
#ifndef LS_TESTS_LIGHTS_FIXTURE_H
#define LS_TESTS_LIGHTS_FIXTURE_H

#include "drivers/lights.h"
#include "tests/drivers/dome_fixture.h"

#include <glib.h>

enum { N_CONDITIONS = 6, MAX_STEPS = 4096 };

struct driver {
    const char *name;
    enum sim_controller_wire wire;
};

/** Dark, one LED, one dimmed, sphere, segment, list. */
extern const struct ls_condition conditions[N_CONDITIONS];

/** Driver and controller. */
struct stand {
    struct dome dome;
    struct ls_lights *lights;
};

/** dome_small, on the wire of this driver. */
struct sim_controller_config small(const struct driver *driver);

/** Start a controller (NULL: a small one) and open it. */
struct stand stand_up(const struct driver *driver, const struct sim_controller_config *config);
void stand_down(struct stand *stand);

struct ls_lights *open_dome(const struct driver *driver, const struct dome *dome);

/** The test fails, with the sentence, if @err is one. */
void must(enum ls_err err, const struct ls_diag *diag);

void load(struct ls_lights *lights, const struct ls_program *program);
void arm(struct ls_lights *lights);
void grant(struct ls_lights *lights, uint32_t n);
struct ls_lights_status status_of(struct ls_lights *lights);

/** Poll until @n events have come; 10 s at most. */
struct ls_lights_status collect(struct ls_lights *lights, struct ls_step_event *events, size_t n);

/** @n steps of 100 to 250 us, 2 ms apart, through all conditions. */
struct ls_program small_program(struct ls_step *steps, uint32_t n);

/** For drivers on which a test makes sense: several hosts, ports and units are Modbus TCP's; a
 * serial line takes its time. */
enum { TCP = 1 << SIM_WIRE_MODBUS, USB = 1 << SIM_WIRE_USB };

/** "name" becomes /lights/DRIVER/name; after g_test_init. */
struct lights_test {
    const char *name;
    GTestDataFunc run;
    unsigned wires; /* 0: all */
};

int run_lights_tests(const struct lights_test *tests, size_t n);

#endif
