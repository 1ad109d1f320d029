/*
 * fake_rig: a dome controller and cameras in the test's own process, behind the drivers'
 * interfaces (drivers/lights.h, drivers/camera.h), with faults and a truth to compare with.
 * Layer: tests. Threads: one engine thread of its own; the interfaces' functions on any.
 *
 * Every frame is Mono16. Pixel 0 holds 2 + the light that was on (1 = dark), pixel 1 the pulse's
 * ordinal, pixel 2 1 + its width in units of 10 us, and all others
 *     BLACK + RATE (1 + light) exposure_us.
 * Against the host the controller's clock is 80 ppm fast, the cameras' 60 ppm slow.
 */
#ifndef LS_TESTS_FAKE_RIG_H
#define LS_TESTS_FAKE_RIG_H

#include "drivers/camera.h"
#include "drivers/lights.h"

#include <glib.h>
#include <stdbool.h>
#include <stdint.h>

enum {
    FAKE_WIDTH = 48,
    FAKE_HEIGHT = 40,
    FAKE_BLACK = 100,
    FAKE_FULL_SCALE = 60000,
    FAKE_MAX_PULSES = 4096,
};

#define FAKE_RATE 0.5 /* DN per us per (1 + light) */
#define FAKE_OFFSET_US 13.7

enum fake_fault {
    FAKE_FINE,
    FAKE_DROPPED,  /* the pulse does not reach camera 0 */
    FAKE_LOST,     /* camera 0's frame comes incomplete */
    FAKE_VANISHED, /* camera 0's frame does not come */
    FAKE_DOUBLED,  /* camera 0 exposes once more, half a period later */
    FAKE_UNLIT,    /* held: the light goes off as soon as it is on */
    FAKE_CUT,      /* held: the light goes off just before camera 0 is triggered */
    FAKE_SLOW,     /* camera 0's frame comes 250 ms later */
    FAKE_SLOWER,   /* ... 400 ms */
};

struct fake_options {
    uint32_t n_cameras;
    bool software, timed, no_time; /* kind of cameras */
    bool noisy_link;               /* camera 0 has a packet socket until it starts */
    bool mixed;                    /* camera 1 has a line and a clock all the same */
    bool blank_fails;              /* from the second program on */
    int lose_light;                /* camera 0 never gives a frame of this light; -1 none */
    /* Pulses are counted from the second program on: the first is the warm-up. */
    uint32_t interlock_at; /* pulse that opens it, 0 = never */
    uint32_t stall_at;     /* pulse after which the controller sleeps 300 ms, 0 = never */
    uint32_t stuck_at;     /* pulse after which it answers and fires nothing any more, 0 = never */
    uint32_t hot_at;       /* pulse from which the dome is hot for hot_ms, 0 = never */
    uint32_t hot_ms;
    uint32_t stall_every;    /* after every so many pulses it sleeps 40 ms, 0 = never */
    uint32_t gone_at;        /* pulse at which camera 0 disappears, 0 = never */
    uint32_t drift_at;       /* pulse from which every pixel reads 1 DN more, 0 = never */
    uint32_t frame_delay_us; /* from the end of exposure, default 2000 */
    uint32_t crowded_us; /* lights: camera 0's frames come so much after one another, 0 = at once */
    unsigned char faults[FAKE_MAX_PULSES]; /* enum fake_fault */
    unsigned char warm_up_faults[FAKE_MAX_PULSES];
    bool warm_up_blank_fails;
    void (*armed)(bool now); /* called with true at every arm, with false at every blank; or NULL */
};

struct fake_rig;

struct fake_rig *fake_rig_new(const struct fake_options *options);
struct ls_lights *fake_rig_lights(struct fake_rig *rig);
struct ls_camera *const *fake_rig_cameras(struct fake_rig *rig);

/** Fired since the warm-up. */
uint32_t fake_rig_pulses(struct fake_rig *rig);
/** Exposures that found no queued slot. */
uint32_t fake_rig_underruns(struct fake_rig *rig);
/** Wait until camera 0 has been given @n slots that it has not filled. */
void fake_rig_wait_released(struct fake_rig *rig, uint32_t n);
/** A frame as above into @raw, with @black instead of BLACK. */
void fake_rig_draw(void *raw, uint32_t pulse, int light, uint32_t width_us, double black,
                   double exposure_us);
/** The lock that every function of the drivers' interfaces takes. */
GMutex *fake_rig_lock(struct fake_rig *rig);
bool fake_rig_is_dark(struct fake_rig *rig);
/** Level of the work light, 0 = off. */
unsigned fake_rig_work_light(struct fake_rig *rig);
/** Host time of the last lit pulse's start, ns. */
uint64_t fake_rig_last_lit_ns(struct fake_rig *rig);
void fake_rig_free(struct fake_rig *rig);

#endif
