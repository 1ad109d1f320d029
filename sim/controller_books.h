/*
 * controller_books: what the LEDs were lit for in the last second, so that limits of duty and power
 * hold from one program to the next.
 * Layer: sim. Threads: one at a time. Ownership: init allocates, finish frees.
 */
#ifndef LS_SIM_CONTROLLER_BOOKS_H
#define LS_SIM_CONTROLLER_BOOKS_H

#include "sim/program.h"

#include <stdbool.h>
#include <stdint.h>

/** One pulse, or a work light that went out, which counts as if it had begun then. */
struct sim_shown {
    uint64_t start_us;
    uint32_t width_us, n_leds;
    uint16_t arm;
    uint32_t *leds; /* light x n_channels + channel */
    uint16_t *levels;
};

struct sim_books {
    struct sim_shown *shown; /* oldest first */
    uint32_t n, room;
    uint64_t *on; /* [n_lights x n_channels], us x level; scratch */
};

/** False: out of memory. */
bool sim_books_init(struct sim_books *books, const struct sim_controller_config *config);

/** A step of @program was lit from @start_us for @width_us. */
void sim_books_note(struct sim_books *books, const struct sim_controller_config *config,
                    const struct sim_program *program, uint32_t condition, uint16_t arm,
                    uint64_t start_us, uint32_t width_us);

/** The work light went out at @us, having been on for @width_us. */
void sim_books_note_work(struct sim_books *books, const struct sim_controller_config *config,
                         uint16_t channel, uint16_t level, uint16_t arm, uint64_t us,
                         uint64_t width_us);

/** When @step of arm @arm may begin: at @start_us, or later for what other arms have shown in the
 * second before. Forgets what is older. */
uint64_t sim_books_start(struct sim_books *books, const struct sim_controller_config *config,
                         const struct sim_program *program, const struct sim_step *step,
                         uint16_t arm, uint64_t start_us);

/** Nothing was shown. */
void sim_books_clear(struct sim_books *books);

void sim_books_finish(struct sim_books *books);

#endif
