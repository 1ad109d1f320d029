/*
 * stage: the seam between the three simulated devices of one process: the dome controller fires,
 * the stage knows what the LEDs show, the cameras expose.
 * Layer: sim. Threads: stated per function. Ownership: the stage owns pictures.
 *
 * Simulated time is host CLOCK_MONOTONIC_RAW in ns ("true time"); every device reads it through
 * a clock of its own (sim_clock), with its own epoch and drift.
 */
#ifndef LS_SIM_STAGE_H
#define LS_SIM_STAGE_H

#include "core/error.h"
#include "drivers/lights_wire.h"

#include <pthread.h>
#include <stdint.h>

/** A device clock: ticks = epoch + (true - start) * (1 + drift_ppm * 1e-6) * hz / 1e9. */
struct sim_clock {
    uint64_t start_ns; /* true time at which it showed epoch_ticks */
    uint64_t epoch_ticks;
    double hz;
    double drift_ppm;
};

/** CLOCK_MONOTONIC_RAW. Any thread. */
uint64_t sim_now_ns(void);

/** Wait on @wake, whose clock is CLOCK_MONOTONIC, until it is signalled or @true_ns has come. */
void sim_wait_until(pthread_cond_t *wake, pthread_mutex_t *lock, uint64_t true_ns);

/** What the clock shows at @true_ns. Any thread, as long as nobody writes the clock. */
uint64_t sim_clock_at(const struct sim_clock *clock, uint64_t true_ns);

/** The first true time at which the clock shows @ticks: the inverse of sim_clock_at. */
uint64_t sim_clock_true(const struct sim_clock *clock, uint64_t ticks);

/** One LED as driven: the duty is already quantised to the hardware's PWM levels. */
struct sim_led {
    uint16_t light, channel;
    float duty; /* [0, 1] */
};

/** What the LEDs do in one condition, decoded from the controller's program. */
struct sim_condition {
    uint16_t kind; /* LS_WIRE_CONDITION_* */
    uint32_t n_leds;
    struct sim_led *leds; /* SPHERE and SEGMENT are already expanded */
};

/** Of an exposure: this plus a channel where the work light shines, every light of the channel.
 * What is steadily on at a duty is on for that share of the exposure: `lit_us` is exposure x duty.
 */
#define SIM_CONDITION_WORK 0xffffff00u

/** One exposure of one camera, as it truly happened. */
struct sim_exposure {
    uint64_t true_ns;   /* start */
    double exposure_us; /* as integrated: pulse + offset, or the ExposureTime register */
    double lit_us;      /* how long of it the LEDs were on */
    uint32_t condition; /* index into the committed program; SIM_CONDITION_WORK + channel;
                           UINT32_MAX = dark */
    uint32_t step;      /* controller step since arm; UINT32_MAX = not a step */
    uint32_t camera;    /* index */
    uint64_t sequence;  /* exposures of this camera since start: seeds the noise */
};

/** Geometry of the raw image a camera wants. */
struct sim_raw_format {
    uint32_t width, height, offset_x, offset_y;
    uint32_t pixel_format; /* GigE Vision PFNC code */
    double gain_db;        /* analogue gain as set on the camera; 0 = unity */
};

#endif
