/*
 * showing: what the LEDs show and have lately shown, for exposures that no pulse started and for
 * the log.
 * Layer: sim. Threads: any; locked inside. Ownership: create / destroy.
 */
#ifndef LS_SIM_SHOWING_H
#define LS_SIM_SHOWING_H

#include "sim/controller.h"

#include <stdint.h>

/** A condition in brief. */
struct sim_shown {
    uint16_t kind; /* LS_WIRE_CONDITION_* */
    uint32_t n_leds;
    struct sim_led first; /* valid if n_leds > 0 */
    uint32_t hash;        /* CRC-32C over light, channel and duty x 65535 of every LED */
};

struct sim_showing;

LS_MUST_CHECK enum ls_err sim_showing_create(struct sim_showing **out, struct ls_diag *diag);
void sim_showing_destroy(struct sim_showing *showing);

/** A new program: its conditions are described from now on. LS_ERR_NOMEM. */
LS_MUST_CHECK enum ls_err sim_showing_commit(struct sim_showing *showing,
                                             const struct sim_condition *conditions, uint32_t n,
                                             struct ls_diag *diag);

/** LEDs on; off at the end of the pulse, of a held one at sim_showing_end. */
void sim_showing_begin(struct sim_showing *showing, const struct sim_pulse *pulse);

/** LEDs off: a hold was released, or a pulse cut short. */
void sim_showing_end(struct sim_showing *showing, uint64_t true_ns);

/** The work light has changed: every light of @channel steadily at @duty, 0 = off. */
void sim_showing_work(struct sim_showing *showing, uint64_t true_ns, uint32_t channel, double duty);

/** Which step was lit longest in [@start_ns, @end_ns), and for how long; all UINT32_MAX and 0 if
 * none. Where no step was, SIM_CONDITION_WORK + channel if the work light was. Remembers the last
 * 1024 pulses. */
void sim_showing_in(struct sim_showing *showing, uint64_t start_ns, uint64_t end_ns,
                    uint32_t *condition, uint32_t *step, double *lit_us);

/** Condition @index of the program in brief; dark for an index it does not have. */
struct sim_shown sim_showing_describe(struct sim_showing *showing, uint32_t index);

#endif
