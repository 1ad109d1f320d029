/*
 * calibrate_grey: what a take of the grey sphere says of the lights: gains, directions, factors.
 * Layer: clients. Threads: the main thread. Ownership: as stated.
 */
#ifndef LS_CLIENTS_CALIBRATE_GREY_H
#define LS_CLIENTS_CALIBRATE_GREY_H

#include "clients/calibrate_take.h"
#include "core/gains.h"
#include "core/pattern_factor.h"
#include "core/shading.h"
#include "core/sphere_view.h"

#include <stdint.h>

enum { LS_GREY_PATTERNS = 1024 }; /* pictures of several lights in one channel */

/** The factor of one pattern at one duty in one channel. */
struct ls_grey_factor {
    uint32_t channel;
    char pattern[24];
    double duty;
    struct ls_pattern_factor value;
    uint32_t pictures;
};

struct ls_grey {
    uint32_t n_lights, n_channels, n_colours;
    struct ls_sphere sphere; /* where it stands */
    struct ls_outline outline;
    struct ls_sphere_view *view;
    struct ls_gains gains[LS_DOCUMENT_CHANNELS];
    double *numbers;            /* behind the pointers of gains */
    uint8_t *flags;             /* [light], of all channels together */
    struct ls_shading *shading; /* [light * n_channels + channel] */
    double misplaced_deg;       /* by which the lights stand beside the rig file's places */
    double misfit, rejected;    /* middle of the well-lit white pictures */
    double saturated;           /* share of the sphere's white pixels */
    double scale;
    float p[LS_DOCUMENT_CHANNELS][3];
    uint32_t n_factors;
    struct ls_grey_factor *factors;
};

/**
 * @radius_m and @reflectance of the sphere, which stands about at the stage's centre. Errors, each
 * with a sentence that says what to do: LS_ERR_NOT_FOUND (no sphere in the picture, cut off, not
 * grey and matte, too bright), LS_ERR_STATE (the take lacks pictures that are needed), those of
 * ls_calibrate_fetch and of core. *out: (transfer full).
 */
LS_MUST_CHECK enum ls_err ls_calibrate_grey(const struct ls_calibrate_take *take, double radius_m,
                                            double reflectance, struct ls_grey **out);

/** Strength of a light on the grey sphere, per colour; 0 where it was not measured. */
void ls_grey_strength(const struct ls_grey *grey, uint32_t light, uint32_t channel,
                      double strength[3]);

/** NULL is allowed. */
void ls_grey_destroy(struct ls_grey *grey);

#endif
