/*
 * dome_fixture: a simulated controller in a child process, and a log of what its LEDs did.
 * Layer: tests. Threads: the test's one. Ownership: dome_start / dome_stop.
 */
#ifndef LS_TESTS_DOME_FIXTURE_H
#define LS_TESTS_DOME_FIXTURE_H

#include "drivers/lights.h"
#include "sim/controller.h"

#include <semaphore.h>
#include <sys/types.h>

enum { DOME_PULSES = 8192, DOME_CONDITIONS = 1024, DOME_LEDS = 8 };

/** Shared with the child, which appends. */
struct dome_log {
    _Atomic bool hold_commit; /* getting ready takes until let_commit is posted */
    sem_t let_commit;
    sem_t dark; /* posted when the LEDs went dark */
    _Atomic uint32_t n_pulses, n_releases, n_darks, n_commits;
    struct sim_pulse pulses[DOME_PULSES];
    uint64_t release_ns[DOME_PULSES];
    uint64_t dark_ns[64];
    _Atomic double work_duty; /* of the work light; 0 off */
    uint32_t work_channel;
    uint32_t n_conditions;
    struct {
        uint32_t n_leds;
        struct sim_led leds[DOME_LEDS]; /* the first of them */
    } conditions[DOME_CONDITIONS];
};

struct dome {
    pid_t pid;
    int hold_fd; /* the child lives until this is closed */
    enum sim_controller_wire wire;
    unsigned port;  /* Modbus TCP */
    unsigned baud;  /* Modbus RTU */
    char path[128]; /* serial line, or USB testbed */
    struct dome_log *log;
};

/** Start a controller; the test fails if it does not come up. */
struct dome dome_start(const struct sim_controller_config *config);
void dome_stop(struct dome *dome);

/** Wait until the LEDs went dark once more; the test fails after 10 s. */
void dome_wait_dark(struct dome *dome);

/** How to reach it, on the wire it was started with: unit 1, a timeout of two seconds. Strings are
 * @dome's. On USB this process must run under libumockdev-preload. */
struct ls_lights_config dome_address(const struct dome *dome);

/** A small fast controller: 12 lights, 3 channels, 1 ms period, drifting clock. */
struct sim_controller_config dome_small(void);

#endif
