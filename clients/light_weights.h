/*
 * light_weights: from an environment and a take's calibration to what the daemon relights with.
 * Layer: clients. Threads: the main thread. Ownership: owns the weights; see finish.
 *
 * Spectral (default): the environment of each light's cell as a spectrum (lobes: their own; an RGB
 * map: the smoothest non-negative spectrum that reproduces it); what a colour chart would read of it
 * through the camera; the LED strengths that give the same readings (LeGendre, Yu and Debevec,
 * Eq. 4, after M Eq. 5; a mono camera per output channel, Eq. 6).
 * Tristimulus: the paper's baseline, white light weighted with the environment in camera-raw.
 */
#ifndef LS_CLIENTS_LIGHT_WEIGHTS_H
#define LS_CLIENTS_LIGHT_WEIGHTS_H

#include "clients/environment_file.h"
#include "clients/take_document.h"
#include "core/error.h"
#include "proto/lightstage.pb-c.h"

#include <stdbool.h>
#include <stdint.h>

struct ls_light_weights {
    Lightstage__WeightMode mode;
    uint32_t n_names;
    char *names[LS_DOCUMENT_CHANNELS]; /* point into the document */
    uint32_t n_rows, n_lights;
    float *rows;           /* [n_rows][n_lights], radiance x sr */
    bool after_m;          /* the picture is Rec. 709 already (mono), M is not to be applied */
    double worst_residual; /* relative, of the solve, over the lights that matter */
    double unreachable;    /* share of the map's energy no light can have exactly */
    const char *warning;   /* or NULL */
};

/** @turn_deg: the environment turned about y, right-handed. Errors: LS_ERR_UNSUPPORTED (the take's
 * calibration lacks what this solve needs: says what, and what to do), those of core/solve.h. */
LS_MUST_CHECK enum ls_err ls_light_weights_make(const struct ls_take_document *document,
                                                const struct ls_environment_file *environment,
                                                bool tristimulus, double turn_deg,
                                                struct ls_light_weights *out,
                                                struct ls_diag *diag);

/** Zeroed is allowed. */
void ls_light_weights_finish(struct ls_light_weights *weights);

#endif
