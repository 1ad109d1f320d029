/*
 * still_life_study: a model of promotion on the still life, and how far it is from the truth.
 * Layer: tests. Threads: one per study. Ownership: still_life_study_finish; the world outlives it.
 *
 * Errors are over lights, R A G C B and colours: `field` over all pixels, `inter` where more than
 * 20 % is bounced light, `shadow` the mean relative colour error (in percent) of pairs of light and
 * pixel of those that see less than a tenth of their brightest light (a thousandth of the brightest
 * at least), `highlight` over pairs that are more than half specular. `promotion` is the model,
 * fitted on noisy pictures, applied to the noise-free field: what it adds to it. `served` is the
 * model applied to the noisy field, as a user gets it.
 */
#ifndef LS_TESTS_CORE_STILL_LIFE_STUDY_H
#define LS_TESTS_CORE_STILL_LIFE_STUDY_H

#include "tests/core/still_life.h"

enum { STILL_LIFE_MAX_SEGMENTS = 26, STILL_LIFE_HEADLIGHTS = 3 };

/** What is photographed per light: spectra in order, white first. Those are not fitted. */
struct still_life_inputs {
    int n, spectrum[STILL_LIFE_SPECTRA];
};

struct still_life_sums {
    double difference, truth; /* of squares */
};

struct still_life_errors {
    struct still_life_sums field, inter, highlight;
    double shadow;
    uint64_t n_shadow;
};

struct still_life_row {
    struct still_life_errors promotion, served;
    struct ls_linear_error left_out; /* of more than one segment */
};

enum still_life_model {
    STILL_LIFE_LINEAR, /* core/linear.h; one segment: Eq. 1 */
    STILL_LIFE_BLEND,  /* core/mono_blend.h */
    STILL_LIFE_BETTER, /* mono: each spectrum by the one of these two that is estimated better */
    STILL_LIFE_HEAD,   /* Eq. 2: the lights nearest the camera in place of the full sphere */
};

/** Fields of the noisy and the noise-free camera, by spectrum. */
struct still_life_study {
    const struct still_life *world;
    struct still_life_camera camera, quiet;
    float *noisy[STILL_LIFE_SPECTRA]; /* [light][pixel][colour]; NULL where nobody photographs it */
    float *clean[STILL_LIFE_SPECTRA];
    float *brightest; /* [pixel], of the white field's lights */
};

/** @every: photograph every spectrum per light, for inputs beyond white. */
void still_life_study_init(struct still_life_study *study, const struct still_life *world,
                           bool noise, bool mosaic, bool every);

/** With a camera of one's own; its generator is the study's then. */
void still_life_study_init_with(struct still_life_study *study, const struct still_life *world,
                                const struct still_life_camera *camera, bool every);
void still_life_study_finish(struct still_life_study *study);

/** Fit, promote and compare. @n_segments: 1 for a full sphere and for the head light. */
struct still_life_row still_life_judge(const struct still_life_study *study,
                                       enum still_life_model model,
                                       const struct still_life_inputs *inputs, uint32_t n_segments);

/** Pictures that takes: one per light and input, and per spectrum that is fitted its segments. */
uint32_t still_life_pictures(const struct still_life_inputs *inputs, uint32_t n_segments);

/** Relative root mean square, in percent. */
double still_life_percent(const struct still_life_sums *sums);

#endif
