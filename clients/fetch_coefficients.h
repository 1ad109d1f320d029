/*
 * fetch_coefficients: what pictures of a basis stand for: signed coefficient pictures of the field.
 * Layer: clients. Threads: the main thread. Ownership: the caller's.
 *
 * Of harmonics, a(l,m) = (4 pi / n) sum_i Y(l,m)(omega_i) R_i; of gradients, the same with omega_x,
 * omega_y, omega_z and 1 in place of Y: core/bases.h. In the unit of R, the lights at the strengths
 * they were lit with. Linear in the pictures, so RGB is demosaiced once, at the end.
 */
#ifndef LS_CLIENTS_FETCH_COEFFICIENTS_H
#define LS_CLIENTS_FETCH_COEFFICIENTS_H

#include "clients/command.h"
#include "clients/lightstage.h"

#include <stdbool.h>
#include <stdint.h>

struct ls_fetch_coefficients {
    const char *take, *channel, *output;
    bool gradients; /* else harmonics */
    bool rgb, half;
    uint32_t camera;
    struct lightstage_region region; /* width 0 = the whole picture */
};

/**
 * Fetch the pictures of the take's basis and write `OUTPUT.harmonic-07.exr` or
 * `OUTPUT.gradient-x.exr`, and `OUTPUT.json`. Harmonics photographed both ways come from the pairs.
 * Refused (LS_ERR_STATE) where the take has a calibration without a factor of the pattern. Returns
 * an exit code; errors are printed.
 */
int ls_fetch_coefficients(struct ls_command_context *context,
                          const struct ls_fetch_coefficients *wanted);

#endif
