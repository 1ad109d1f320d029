/*
 * response: what a camera channel reads of a material under a light: spectra integrated once.
 * Layer: sim. Threads: built on one, then read only. Ownership: finish frees the tables.
 *
 * A pixel's radiance is a sum of products geometry x integral; the integrals depend on light
 * spectrum, material and camera channel only and are kept here. Bounced light passes by one or two
 * materials more on its way: a chain.
 */
#ifndef LS_SIM_RESPONSE_H
#define LS_SIM_RESPONSE_H

#include "core/error.h"
#include "core/spectrum.h"
#include "sim/scene.h"
#include "sim/subject.h"

#include <stdint.h>

enum {
    /* one emitter, or two in a row: 4 + 16 */
    SIM_CHAINS = 20,
};

/** Every spectrum a scene needs. Colours: R, G, B, mono. */
struct sim_library {
    struct ls_spectrum material[SIM_MATERIALS];
    struct ls_spectrum polariser; /* transmission for unpolarised light, over one half */
    struct ls_spectrum camera[4];
    struct ls_spectra *leds;
};

/** Load from a folder. Errors: LS_ERR_NOT_FOUND, LS_ERR_INVALID naming the file. */
LS_MUST_CHECK enum ls_err sim_library_load(const char *directory, struct sim_library *out,
                                           struct ls_diag *diag);
void sim_library_finish(struct sim_library *library);

/** A light's spectrum as the subject sees it: what a depolarising white reads is 1, or one half
 * behind a polariser. */
struct sim_source {
    enum sim_channel_kind kind;
    struct ls_spectrum spectrum;
};

struct sim_response {
    uint32_t n_sources, n_colours;
    enum sim_channel_kind kind[SIM_MAX_CHANNELS];
    float diffuse[SIM_MAX_CHANNELS]; /* factor of diffuse terms: 1, or 1/2 behind a polariser */
    /* [(source * n_colours + colour) * SIM_MATERIALS + material] */
    float *material;
    /* [(source * n_colours + colour) * SIM_CHAINS + chain] * SIM_MATERIALS + receiver */
    float *chain;
};

/** @camera: n_colours sensitivities. */
LS_MUST_CHECK enum ls_err sim_response_build(const struct sim_library *library,
                                             const struct sim_subject *subject,
                                             const struct sim_source *sources, uint32_t n_sources,
                                             const struct ls_spectrum *camera, uint32_t n_colours,
                                             struct sim_response *out, struct ls_diag *diag);
void sim_response_finish(struct sim_response *response);

static inline float sim_response_of(const struct sim_response *r, uint32_t source, uint32_t colour,
                                    uint32_t material)
{
    return r->material[(source * r->n_colours + colour) * SIM_MATERIALS + material];
}

#endif
