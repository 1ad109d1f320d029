/*
 * controller: the simulated dome controller: it speaks the contract of drivers/lights_wire.h over
 * Modbus TCP, a serial line or USB, and its engine fires steps by its own clock.
 * Layer: sim. Threads: create and destroy on one thread; three threads of its own (server, engine,
 * preparation) call the hooks. Ownership: the controller owns everything it hands to a hook.
 *
 * Step times are exact: a pulse happens at the microsecond of the controller's clock at which the
 * contract puts it, also if the host machine woke the engine a little later.
 */
#ifndef LS_SIM_CONTROLLER_H
#define LS_SIM_CONTROLLER_H

#include "core/error.h"
#include "sim/stage.h"

#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>

enum sim_controller_fault_kind {
    SIM_CONTROLLER_STALL,      /* the engine pauses value ms before step at */
    SIM_CONTROLLER_REFUSE,     /* the next count commits end as unprepared; at, value unused */
    SIM_CONTROLLER_DISCONNECT, /* after step at every TCP connection is closed; on USB it is
                                  unplugged, and plugged in again after value ms, 0 = never */
    SIM_CONTROLLER_INTERLOCK,  /* opens before step at; closes again after value ms, 0 = never */
    SIM_CONTROLLER_ESTOP,      /* as interlock, of the emergency stop */
    SIM_CONTROLLER_DEAD,    /* no request is answered after step at, for value ms, 0 = for ever */
    SIM_CONTROLLER_CORRUPT, /* the next count window writes lose a bit */
    SIM_CONTROLLER_REBOOT,  /* after step at: program, run and connections are gone; on USB it
                               comes back after value ms */
    SIM_CONTROLLER_LATE,    /* serial: count answers after step at come value ms late */
    SIM_CONTROLLER_LOSE_PACKET,   /* USB: count event packets from step at on never leave */
    SIM_CONTROLLER_DAMAGE_PACKET, /* USB: the same lose a bit */
    SIM_CONTROLLER_HALT,          /* USB: the event endpoint stalls after step at */
    SIM_CONTROLLER_HEAT,          /* hot_c is reached before step at, for value ms, 0 = for ever */
    SIM_CONTROLLER_OVERHEAT,      /* the same of max_c */
    SIM_CONTROLLER_DAMAGE_ANSWER, /* serial: count answers after step at have a wrong CRC */
};

struct sim_controller_fault {
    enum sim_controller_fault_kind kind;
    uint32_t at;    /* step since arm; the n-th arm does not matter */
    uint32_t count; /* how often; 0 = once */
    double value;
};

enum { SIM_CONTROLLER_MAX_FAULTS = 16 };

enum sim_controller_wire { SIM_WIRE_MODBUS, SIM_WIRE_MODBUS_RTU, SIM_WIRE_USB };

struct sim_controller_config {
    uint32_t wire;    /* enum sim_controller_wire */
    char address[64]; /* Modbus TCP: to bind; default 127.0.0.1 */
    unsigned port;    /* Modbus TCP: 0: any free one */
    unsigned unit;    /* Modbus unit identifier answered to */
    unsigned baud;    /* serial: answers take as long as their bytes, and those asked, do */
    char serial[32];
    uint32_t firmware;
    uint32_t n_lights, n_channels;
    uint32_t pwm_period_us, pwm_levels;
    uint32_t min_pulse_us, max_pulse_us, min_period_us;
    uint32_t max_duty_permille, max_current_ma, led_current_ma;
    uint32_t max_conditions, max_steps, max_program_bytes;
    uint32_t max_power_mw, led_power_mw;
    uint32_t max_hold_us, heartbeat_ms;
    uint32_t event_queue; /* events kept for the host */
    int32_t temperature_c, hot_c, max_c;
    struct sim_clock clock; /* hz 1e6; start_ns 0: now */
    uint32_t n_faults;
    struct sim_controller_fault faults[SIM_CONTROLLER_MAX_FAULTS];
};

/** A pulse on the LEDs and on the trigger output. */
struct sim_pulse {
    uint64_t true_ns;   /* start; may be a little in the past, or up to 1 ms ahead */
    double pulse_us;    /* of a held step: its shortest; hooks.release tells the end */
    uint32_t step;      /* since arm */
    uint32_t condition; /* of the committed program */
    bool hold;
};

/** What the controller tells the rest of the stage. Any member but user may be NULL. */
struct sim_controller_hooks {
    void *user;
    /* A program was accepted: get ready for it. Preparation thread; may take minutes and write
     * [0, 1000] to *progress. The conditions live until the next commit or destroy. An error
     * refuses the program. */
    enum ls_err (*commit)(void *user, const struct sim_condition *conditions, uint32_t n,
                          _Atomic uint32_t *progress, struct ls_diag *diag);
    void (*pulse)(void *user, const struct sim_pulse *pulse);     /* engine thread */
    void (*release)(void *user, uint64_t true_ns, uint32_t step); /* engine thread */
    void (*dark)(void *user, uint64_t true_ns); /* blank or fault cut a pulse short; any thread */
    /* The work light changed; duty 0: off. Any thread, with the controller locked. */
    void (*work)(void *user, uint64_t true_ns, uint16_t channel, double duty);
};

struct sim_controller;

/** The reference rig: 346 lights, 8 channels, 72 fps, 1000 PWM levels of 50 us. */
void sim_controller_defaults(struct sim_controller_config *config);

/** Bind, listen and start. Errors: LS_ERR_INVALID (configuration), LS_ERR_BUSY (port taken),
 * LS_ERR_NOMEM, LS_ERR_OS. @out: (transfer full). */
LS_MUST_CHECK enum ls_err sim_controller_create(const struct sim_controller_config *config,
                                                const struct sim_controller_hooks *hooks,
                                                struct sim_controller **out, struct ls_diag *diag);

/** Modbus TCP: the port really bound; else 0. */
unsigned sim_controller_port(const struct sim_controller *controller);

/** Serial: path of the line's other end. USB: root of the umockdev testbed (UMOCKDEV_DIR of a
 * process that runs under libumockdev-preload). Modbus TCP: "". Constant. */
const char *sim_controller_path(const struct sim_controller *controller);

/** LEDs dark, threads joined, memory freed. NULL is allowed. */
void sim_controller_destroy(struct sim_controller *controller);

#endif
