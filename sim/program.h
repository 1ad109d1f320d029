/*
 * program: a program image as the controller decodes and judges it.
 * Layer: sim. Threads: any; pure. Ownership: sim_program_decode fills, sim_program_finish frees.
 */
#ifndef LS_SIM_PROGRAM_H
#define LS_SIM_PROGRAM_H

#include "sim/controller.h"

#include <stddef.h>
#include <stdint.h>

struct sim_step {
    uint32_t condition, pulse_us, settle_us, flags;
};

struct sim_program {
    uint32_t n_conditions, n_steps, period_us, crc;
    struct sim_condition *conditions;
    float *max_duty;   /* [n_conditions]: of the brightest LED */
    uint64_t *total;   /* [n_conditions]: sum of the levels of all LEDs */
    uint16_t **levels; /* [n_conditions][n_leds]: as asked, before quantising */
    struct sim_step *steps;
};

/** Why a program is refused: enum ls_wire_refusal, what it is about, faults it latches. */
struct sim_refusal {
    uint16_t reason;
    uint32_t detail;
    uint16_t faults;
};

/**
 * Decode @n registers into conditions (full spheres and segments expanded, duties quantised to the
 * hardware's levels) and judge them against the limits of @config. Returns 0, or -1 with
 * *refusal filled and *out empty.
 */
int sim_program_decode(const struct sim_controller_config *config, const uint16_t *image, size_t n,
                       struct sim_program *out, struct sim_refusal *refusal);

/** Frees and zeroes. */
void sim_program_finish(struct sim_program *program);

#endif
