/*
 * led_check: dead and dim LEDs, told from how bright each one's picture is.
 * Layer: core. Threads: any (no state). Ownership: all arrays are the caller's.
 *
 * level[c * n_lights + i] is the mean brightness of the picture of light i in channel c, NAN where
 * there is none. What a light gives a picture varies with where it stands, smoothly and alike in
 * all channels; so an LED is judged twice: against the other channels of its light, each channel
 * divided by its median over the lights: less than LS_LED_DIM of their median (of two channels: of
 * the brighter) is dim; a light as a whole against its neighbours, where the dome is dense enough
 * for that (the eighth nearest at most LS_LED_NEAR_DEG away): less than LS_LED_DIM of the second
 * darkest of eight. Less than LS_LED_DEAD of what was expected is dead. A light from which less
 * than @floor is expected is not seen by the camera: it cannot be judged.
 */
#ifndef LS_CORE_LED_CHECK_H
#define LS_CORE_LED_CHECK_H

#include "core/error.h"

#include <stdint.h>

#define LS_LED_DIM 0.6
#define LS_LED_DEAD 0.05
#define LS_LED_NEAR_DEG 40.0

enum ls_led_verdict {
    LS_LED_UNKNOWN, /* no picture of it */
    LS_LED_FINE,
    LS_LED_IS_DIM,
    LS_LED_IS_DEAD,
    LS_LED_UNSEEN,
};

struct ls_led_levels {
    const float (*directions)[3]; /* not zero; any length */
    const float *level;
    uint32_t n_lights, n_channels;
    double floor; /* of a channel's median level, [0, 1) */
};

/** verdict[c * n_lights + i]: enum ls_led_verdict; share: alike, of what was expected, NAN where
 * nothing was. Channels with fewer than 3 pictures are UNKNOWN. LS_ERR_NOMEM. */
LS_MUST_CHECK enum ls_err ls_led_check(const struct ls_led_levels *levels, uint8_t *verdict,
                                       float *share, struct ls_diag *diag);

#endif
