/*
 * credit: how far the controller may run ahead of the frames, and when to stay dark instead.
 * Layer: daemon. Threads: ls-seq; pure logic. Ownership: none.
 *
 * granted - settled <= queued - 4 for every camera, where settled counts steps with a verdict and
 * queued the slots its driver holds: whatever is fired has a slot to land in, four to spare.
 *
 * With a live subject a starved sequence must not sink into the flashing band (3-30 Hz) by
 * trickling. Its pulses come at the planned rate or not at all: when the controller is about to
 * run dry, it stays dark until a whole burst (all the credit there can be, or all the steps that
 * are left) has gathered and at least LS_CREDIT_PAUSE_NS have passed since the last burst began,
 * so that bursts follow each other below 3 Hz. Dark steps in a row (darks, watches) are such a
 * pause too: what is lit after them is a burst of its own. Sequences whose planned rate lies inside
 * the band were allowed by the operator and are not held back.
 */
#ifndef LS_DAEMON_CREDIT_H
#define LS_DAEMON_CREDIT_H

#include "drivers/lights.h"

#include <stdbool.h>
#include <stdint.h>

enum { LS_CREDIT_SPARE = 4, LS_CREDIT_LEAST = 4 };

#define LS_CREDIT_PAUSE_NS 400000000ull /* 2.5 Hz */

/** What one camera has room for. */
struct ls_credit_camera {
    uint32_t queued;  /* slots the driver holds */
    uint32_t settled; /* steps of this program with a verdict */
};

/** How many slots to count of @slots, @period_us apart, when frames are waited for @patience_us: no
 * more steps are under way than come in half of that, so that a camera or network half as fast as
 * planned slows the lights and loses nothing; at least LS_CREDIT_LEAST beside the spare. RT-safe.
 */
uint32_t ls_credit_slots(uint32_t slots, uint64_t patience_us, uint32_t period_us);

/** The most steps that may be granted; at least the fewest settled, at most @n_steps. RT-safe. */
uint32_t ls_credit_limit(const struct ls_credit_camera *cameras, uint32_t n_cameras,
                         uint32_t n_steps);

struct ls_credit {
    bool bursts; /* live subject at a rate above the flashing band */
    const struct ls_program *program;
    uint32_t burst;               /* steps of a full burst */
    uint32_t dark_from, lit_from; /* the next steps whose darkness is seen; n_steps: none */
    bool dark;
    uint64_t started_ns; /* of the current burst, or the last one; 0 = none yet */
};

/** @program: (transfer none), its steps and kinds of conditions are read later. @ring_slots: of the
 * smallest ring; @live: of the plan; @started_ns: of the credit of the program before. RT-safe. */
void ls_credit_init(struct ls_credit *credit, const struct ls_program *program, uint32_t ring_slots,
                    bool live, uint64_t started_ns);

/** The new value of granted (>= @granted), given what was fired and the limit. RT-safe. */
uint32_t ls_credit_grant(struct ls_credit *credit, uint32_t granted, uint32_t fired, uint32_t limit,
                         uint64_t now_ns);

#endif
