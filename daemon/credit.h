/*
 * credit: how far the controller may run ahead of the frames, and when to stay dark instead.
 * Layer: daemon. Threads: ls-seq; pure logic. Ownership: none.
 *
 * granted - settled <= min(queued - 4, window) for every camera, where settled counts steps with a
 * verdict and queued the slots its driver holds: whatever is fired has a slot to land in, four to
 * spare. Merge and store give slots back as they get through with them, so they slow the lights.
 *
 * The window follows what is measured: a frame that came L after its pulse, when n steps were under
 * way, was served at n / L frames a second; of as many as are served within half of a frame's
 * patience no more are under way. A camera, network or host that falls behind slows the lights
 * before its frames are too late; one that is only far away (L does not grow with n) does not.
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
    uint32_t window;  /* steps that may be under way for what its frames' latency was */
};

/** The window after a frame came @latency_us after its pulse, which was the @under_way-th step
 * under way then: @under_way * @patience_us / 2 / @latency_us, at least 1. RT-safe. */
uint32_t ls_credit_window(uint64_t patience_us, uint32_t under_way, uint64_t latency_us);

/** Before any frame came: as if they came as planned, every @period_us; at least LS_CREDIT_LEAST.
 * RT-safe. */
uint32_t ls_credit_first_window(uint64_t patience_us, uint32_t period_us);

/** The most steps that may be granted; at least the fewest settled, at most @n_steps. RT-safe. */
uint32_t ls_credit_limit(const struct ls_credit_camera *cameras, uint32_t n_cameras,
                         uint32_t n_steps);

struct ls_credit {
    bool bursts; /* live subject at a rate above the flashing band */
    const struct ls_program *program;
    uint32_t burst;               /* steps of a full burst, if the window is as large */
    uint32_t dark_from, lit_from; /* the next steps whose darkness is seen; n_steps: none */
    bool dark;
    uint64_t started_ns; /* of the current burst, or the last one; 0 = none yet */
};

/** @program: (transfer none), its steps and kinds of conditions are read later. @ring_slots: of the
 * smallest ring; @live: of the plan; @started_ns: of the credit of the program before. RT-safe. */
void ls_credit_init(struct ls_credit *credit, const struct ls_program *program, uint32_t ring_slots,
                    bool live, uint64_t started_ns);

/** The new value of granted (>= @granted), given what was fired, the limit and the smallest of the
 * cameras' windows. RT-safe. */
uint32_t ls_credit_grant(struct ls_credit *credit, uint32_t granted, uint32_t fired, uint32_t limit,
                         uint32_t window, uint64_t now_ns);

#endif
