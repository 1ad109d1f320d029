/*
 * flashing: may a live subject be shown these pulses? One rule, asked of a plan before it runs and
 * of the pulses really fired.
 * Layer: daemon. Threads: one at a time; ls_flashing_pulse is RT-safe. Ownership: an ls_flashing
 * is a value; conditions are (transfer none) and looked at during the call.
 *
 * Light that comes again within 1/30 s is seen as going on; light that comes after longer is seen
 * as a flash, and more than three flashes within a second (3 to 30 Hz) are dangerous. So each of
 * these is followed by itself, and none may flash:
 *   pulses    of any light;
 *   changes   from one condition to another;
 *   bright    pulses of at least half the energy of the brightest one of the plan: three exposures
 *             at 72 Hz are a long pulse 24 times a second, whatever lies between;
 *   a colour  the pulses of each channel;
 *   red       the pulses of all channels that are saturated red together.
 * Dark steps are no pulses.
 */
#ifndef LS_DAEMON_FLASHING_H
#define LS_DAEMON_FLASHING_H

#include "core/error.h"
#include "daemon/plan.h"
#include "drivers/lights.h"

#include <stdbool.h>
#include <stdint.h>

enum { LS_FLASH_FUSED_US = 33333, LS_FLASHES_PER_SECOND = 3 };

enum ls_flash_kind {
    LS_FLASH_PULSES,
    LS_FLASH_CHANGES,
    LS_FLASH_BRIGHT,
    LS_FLASH_RED,
    LS_FLASH_CHANNEL, /* + channel */
    LS_FLASH_TRAINS = LS_FLASH_CHANNEL + LS_MAX_CHANNELS,
};

/** One of the things that are followed. */
struct ls_flash_train {
    bool begun;
    uint64_t last_us;
    uint32_t n_flashes;
    uint64_t flash_us[LS_FLASHES_PER_SECOND]; /* the last of them, round and round */
};

struct ls_flashing {
    struct ls_flash_train trains[LS_FLASH_TRAINS];
    uint32_t red_channels; /* a bit each */
    uint32_t n_lights;     /* of the controller: a full sphere's */
    double brightest;      /* us x level of the plan's brightest pulse */
    const void *shown;     /* LEDs of the condition shown last */
};

struct ls_flash_found {
    uint32_t train; /* enum ls_flash_kind */
    double hz;
};

/** For the conditions of @plan. */
void ls_flashing_init(struct ls_flashing *flashing, const struct ls_plan *plan,
                      const struct ls_config *config, const struct ls_lights_info *lights);

/** A pulse of @width_us starts at @us, none before the last; @condition is one of the plan's. True:
 * it flashes, and *@found says what and how often. RT-safe. */
bool ls_flashing_pulse(struct ls_flashing *flashing, uint64_t us, uint32_t width_us,
                       const struct ls_condition *condition, struct ls_flash_found *found);

/** "pulses at 20.0 Hz", "W flash at 12.0 Hz" ... */
void ls_flashing_describe(const struct ls_flash_found *found, const struct ls_config *config,
                          char *text, size_t size);

/**
 * Would a live subject see @plan flash, at its own pace? LS_ERR_REFUSED with what, how often and
 * what to do, unless the subject is still or allow_flashing is set. Refused too: pulses faster than
 * 3 Hz one step at a time (@stepwise, as some cameras need it), whose pace nobody knows.
 */
LS_MUST_CHECK enum ls_err ls_flashing_check(const struct ls_plan *plan,
                                            const struct ls_config *config,
                                            const struct ls_lights_info *lights, bool stepwise,
                                            struct ls_diag *diag);

#endif
