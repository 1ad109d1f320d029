/*
 * lights: the interface to a dome controller, whatever wire it hangs on.
 * Layer: drivers (may include core). Threads: one thread at a time per ls_lights; the sequencer
 * owns it between arm and blank. Ownership: the caller owns the ls_lights and every array passed.
 *
 * A controller holds *conditions* (what the LEDs do) and *steps* (which condition, how long the
 * pulse, how much dark before it) and fires steps by its own clock, one trigger pulse each, as far
 * as it has been granted. The host only grants credit and reads step events.
 *
 * Time. Step i starts no earlier than s(i) = s(i-1) + max(period, pulse(i-1) + settle(i)), s(0)
 * one settle after arm, and no earlier than its grant. Duty is judged along this shortest
 * schedule: for every step j, no LED may gather more than max_duty_permille x 1 ms of on-time
 * (pulse x level / 65535) over the steps that start within (s(j) - 1 s, s(j)], and all LEDs
 * together no more energy than max_power_mw x 1 s, one of full level taking led_power_mw.
 *
 * The same limits hold from one program to the next: what was shown before arm, a work light
 * included, counts for a second, and the controller begins a step as much later as that asks for, at
 * most a second.
 *
 * Hold. A held step lights at its start and counts as fired, status.holding is set, and it stays
 * lit until the next grant or max_hold_us, and at least for its pulse. To release the last step
 * granted, grant the same number again: a driver sends that as a release, since a grant that it
 * repeats after a lost reply must not put out the step just lit. Its event comes with the release
 * and carries the real width. The controller follows it with as much dark as the limits of duty and
 * power ask of that width.
 *
 * Work light. One channel of every light at a low level, steadily, which the host names. It is on
 * when the host asks for it while nothing is armed, and comes on by itself when an armed controller
 * misses its host. A steady light is the same for a host that stays: it goes out
 * when that is silent for a heartbeat. arm and blank put both out, and every fault but a missed heartbeat.
 *
 * A lost link. grant and poll reconnect once, check that it is the same controller, since the same
 * power-up and arm, and repeat the request, which does no harm: a mute controller blocks them for
 * at most five timeouts of the link, one whose every answer comes at the last moment for nine, a
 * round trip of poll; on USB 0.4 s are added for closing. Everything else fails and leaves it to
 * the caller. What was fired in the meantime is not lost: events wait in the controller until they
 * have been read.
 */
#ifndef LS_DRIVERS_LIGHTS_H
#define LS_DRIVERS_LIGHTS_H

#include "core/error.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/** One LED group of one light, at a duty cycle of level / 65535 within its pulse. */
struct ls_led {
    uint16_t light;   /* address on the controller (the rig file's address column) */
    uint16_t channel; /* 0 W, 1 R, 2 A, 3 G, 4 C, 5 B, 6 V, 7 H on the reference rig */
    uint16_t level;   /* PWM duty, [0, 65535] */
};

enum ls_condition_kind {
    LS_CONDITION_DARK,    /* every LED off */
    LS_CONDITION_ONE,     /* leds[0] alone */
    LS_CONDITION_SPHERE,  /* every light of leds[0].channel at leds[0].level; light ignored */
    LS_CONDITION_SEGMENT, /* leds[0..n): several lights, one channel, one level */
    LS_CONDITION_LIST,    /* leds[0..n): anything */
};

/** One state of all LEDs. */
struct ls_condition {
    enum ls_condition_kind kind;
    uint32_t n_leds;           /* 0 for DARK, 1 for ONE and SPHERE */
    const struct ls_led *leds; /* transfer none; valid during test and load */
};

enum ls_step_flags {
    LS_STEP_HOLD = 1 << 0, /* stay lit after the pulse's start until the next grant, at most
                              the controller's hold limit (software-triggered cameras) */
};

/** One trigger pulse. Times in whole microseconds of the controller's clock. */
struct ls_step {
    uint32_t condition; /* index into the program's conditions */
    uint32_t pulse_us;  /* width of LED and trigger pulse */
    uint32_t settle_us; /* dark before the pulse, counted into the period */
    uint32_t flags;     /* enum ls_step_flags */
};

/** What a controller executes after arm. */
struct ls_program {
    const struct ls_condition *conditions;
    uint32_t n_conditions;
    const struct ls_step *steps;
    uint32_t n_steps;
    uint32_t period_us; /* smallest time from pulse start to pulse start */
};

/** What the controller says of itself. */
struct ls_lights_info {
    char serial[32];
    uint32_t contract; /* version of the controller contract */
    uint32_t firmware;
    uint32_t n_lights, n_channels;
    uint32_t pwm_period_us; /* a dimmed pulse is a whole number of these */
    uint32_t pwm_levels;    /* distinct duties the hardware knows */
    uint32_t min_pulse_us, max_pulse_us, min_period_us;
    uint32_t max_duty_permille; /* mean on-time of one LED over a second */
    uint32_t max_current_ma;    /* of the whole dome at one moment */
    uint32_t led_current_ma;    /* of one LED group at full level */
    uint32_t max_conditions, max_steps, max_program_bytes;
    uint32_t max_hold_us;
    uint32_t heartbeat_ms; /* silence after which the controller blanks */
    uint32_t max_power_mw; /* of the whole dome, mean over a second */
    uint32_t led_power_mw; /* of one LED group at full level */
    uint32_t hot_c;        /* from here on the host should let it cool */
    uint32_t max_c;        /* here it goes dark and latches */
};

enum ls_event_flags {
    LS_EVENT_LATE = 1 << 0,    /* fired later than s(i): credit or the controller was late */
    LS_EVENT_CLIPPED = 1 << 1, /* pulse or level clipped by a hardware limit */
};

/** A step that was fired. */
struct ls_step_event {
    uint32_t step;     /* index since arm */
    uint32_t width_us; /* pulse width really driven */
    uint64_t us;       /* start of the pulse, controller clock */
    uint32_t flags;    /* enum ls_event_flags */
};

enum ls_lights_state {
    LS_LIGHTS_IDLE,
    LS_LIGHTS_LOADED,
    LS_LIGHTS_ARMED,
    LS_LIGHTS_DONE,  /* every step fired */
    LS_LIGHTS_FAULT, /* blanked and latched; see faults. The next load clears what can be cleared */
};

enum ls_lights_fault {
    LS_FAULT_INTERLOCK = 1 << 0,
    LS_FAULT_ESTOP = 1 << 1,
    LS_FAULT_OVERTEMP = 1 << 2,
    LS_FAULT_OVERCURRENT = 1 << 3,
    LS_FAULT_OVERDUTY = 1 << 4,
    LS_FAULT_HEARTBEAT = 1 << 5,
    LS_FAULT_PROGRAM = 1 << 6, /* program memory is inconsistent */
    LS_FAULT_OVERPOWER = 1 << 7,
};

struct ls_lights_status {
    enum ls_lights_state state;
    uint32_t faults;                         /* enum ls_lights_fault */
    bool holding;                            /* step fired - 1 is lit and held */
    bool work_light;                         /* it is on */
    bool interlock_open, estop_pressed, hot; /* at this moment, latched or not */
    uint32_t fired;                          /* steps started since arm */
    uint32_t granted;
    uint32_t missed_triggers; /* pulses requested earlier than the period allows */
    uint32_t events_lost;     /* overwritten before they were read: a protocol failure */
    int32_t temperature_c;
    uint64_t now_us;         /* controller clock ... */
    uint64_t host_before_ns; /* ... read between these two host CLOCK_MONOTONIC_RAW times, as
                                close as the wire can tell */
    uint64_t host_after_ns;
};

struct ls_lights_config {
    const char *driver; /* "modbus" (TCP), "modbus-rtu", "usb" */
    const char
        *address;  /* host; path of the serial line; serial number on USB, "any": the only one */
    unsigned port; /* modbus: TCP port */
    unsigned baud; /* modbus-rtu: bits per second; 8 data bits, no parity, 1 stop bit */
    unsigned unit; /* modbus, modbus-rtu: unit identifier */
    unsigned timeout_ms; /* response timeout of the link, default 500 */
};

struct ls_lights;

/**
 * Connect and identify. Errors: LS_ERR_NOT_FOUND (no such driver), LS_ERR_GONE (nobody there),
 * LS_ERR_TIMEOUT, LS_ERR_UNSUPPORTED (other contract version or not a dome at all), LS_ERR_INVALID
 * (no usable address, rate or timeout; several controllers that it names), LS_ERR_REFUSED (this
 * user may not open it), LS_ERR_BUSY (it is in use), LS_ERR_NOMEM. Who reconnects later
 * can meet the same.
 * @out: (transfer full), released by ls_lights_close.
 */
LS_MUST_CHECK enum ls_err ls_lights_open(const struct ls_lights_config *config,
                                         struct ls_lights **out, struct ls_diag *diag);

/** What the controller said at open. (transfer none). RT-safe. */
const struct ls_lights_info *ls_lights_info(const struct ls_lights *lights);

/**
 * Would the controller accept this program? Pure: talks to nobody. Names the limit and by how much
 * it is exceeded. Errors: LS_ERR_INVALID, LS_ERR_LIMIT (duty, current, power, period, pulse,
 * memory).
 */
LS_MUST_CHECK enum ls_err ls_lights_test(const struct ls_lights_info *info,
                                         const struct ls_program *program, struct ls_diag *diag);

/** test, clear latched faults, upload, read the CRC back, commit. LEDs stay dark. Errors as test,
 * plus LS_ERR_MISMATCH (CRC), LS_ERR_REFUSED (controller's own check, or a fault whose cause
 * persists), LS_ERR_STATE (armed: blank first), LS_ERR_TIMEOUT, LS_ERR_GONE. May take minutes:
 * returns once the controller reports ready, and gives up when its progress has stood still for
 * two minutes, or with LS_ERR_ABORTED soon after *@stop is set (NULL: never); blank then. */
LS_MUST_CHECK enum ls_err ls_lights_load(struct ls_lights *lights, const struct ls_program *program,
                                         const _Atomic bool *stop, struct ls_diag *diag);

/** Reset step counter and event queue; nothing fires until granted. LS_ERR_STATE if nothing is
 * loaded, LS_ERR_REFUSED if a fault is latched. */
LS_MUST_CHECK enum ls_err ls_lights_arm(struct ls_lights *lights, struct ls_diag *diag);

/** Allow steps [0, n_steps) since arm. Never decreases. Also releases a held step. Allocates
 * nothing of ours. LS_ERR_REFUSED if not armed any more, LS_ERR_MISMATCH if the controller was
 * restarted or armed by somebody else, LS_ERR_TIMEOUT, LS_ERR_GONE. */
LS_MUST_CHECK enum ls_err ls_lights_grant(struct ls_lights *lights, uint32_t n_steps,
                                          struct ls_diag *diag);

/** Read status and the step events since the last poll, oldest first; also the heartbeat.
 * Reads at most 9 events per round trip, as many round trips as @max_events asks for. Allocates
 * nothing of ours. A latched fault is not an error of poll: it is in the status. Errors:
 * LS_ERR_TIMEOUT, LS_ERR_GONE, LS_ERR_MISMATCH (restarted, or armed by somebody else). */
LS_MUST_CHECK enum ls_err ls_lights_poll(struct ls_lights *lights, struct ls_lights_status *status,
                                         struct ls_step_event *events, size_t max_events,
                                         size_t *n_events, struct ls_diag *diag);

/** All LEDs off, the work light too, program stopped. Always allowed, idempotent. */
LS_MUST_CHECK enum ls_err ls_lights_blank(struct ls_lights *lights, struct ls_diag *diag);

/** Would the controller accept this work light? As ls_lights_test. @level 0: none. */
LS_MUST_CHECK enum ls_err ls_lights_test_work(const struct ls_lights_info *info, uint16_t channel,
                                              uint16_t level, struct ls_diag *diag);

/** Name the work light; the controller keeps it until it is switched off. One that is on changes
 * with it. Errors as ls_lights_test_work, LS_ERR_REFUSED (the controller's own check),
 * LS_ERR_TIMEOUT, LS_ERR_GONE. */
LS_MUST_CHECK enum ls_err ls_lights_set_work(struct ls_lights *lights, uint16_t channel,
                                             uint16_t level, struct ls_diag *diag);

/** Show it; with level 0 stay dark. LS_ERR_REFUSED while armed, hot beyond the limit, or with
 * interlock or E-stop latched; LS_ERR_TIMEOUT, LS_ERR_GONE. */
LS_MUST_CHECK enum ls_err ls_lights_work(struct ls_lights *lights, struct ls_diag *diag);

/** The same as ls_lights_work for a host that stays and polls: after heartbeat_ms without it the light
 * goes out. */
LS_MUST_CHECK enum ls_err ls_lights_steady(struct ls_lights *lights, struct ls_diag *diag);

/** Blank if still connected and armed from here, disconnect, free: who only looked leaves another
 * host's program alone. NULL is allowed. */
void ls_lights_close(struct ls_lights *lights);

#endif
