/*
 * light_weights: from an environment and a take's calibration to what the daemon relights with.
 * Layer: clients. Threads: the main thread. Ownership: owns the weights; see finish.
 *
 * Spectral (default): the environment of each light's cell as a spectrum (lobes: their own; an RGB
 * map: the smoothest non-negative spectrum that reproduces it); what a colour chart would read of
 * it through the camera (a captured environment: what its charts did read); the LED strengths that
 * give the same readings (LeGendre, Yu and Debevec, Eq. 4, after M Eq. 5; a mono camera per output
 * channel, Eq. 6).
 * Tristimulus: the paper's baseline, white light weighted with the environment in camera-raw.
 */
#ifndef LS_CLIENTS_LIGHT_WEIGHTS_H
#define LS_CLIENTS_LIGHT_WEIGHTS_H

#include "clients/environment_file.h"
#include "clients/lightstage.h"
#include "clients/row_weights.h"
#include "clients/take_document.h"
#include "core/error.h"
#include "core/lighting.h"

#include <stdbool.h>
#include <stdint.h>

enum ls_light_solve {
    LS_LIGHT_SPECTRAL, /* as the camera suggests: colour shared, mono per target */
    LS_LIGHT_TRISTIMULUS,
    LS_LIGHT_SHARED,     /* one set of strengths for all output channels */
    LS_LIGHT_PER_TARGET, /* one set for each */
};

enum ls_light_method {
    LS_LIGHT_METHOD_DEFAULT,
    LS_LIGHT_METHOD_NNLS,
    LS_LIGHT_METHOD_LEAST_SQUARES
};

struct ls_light_options {
    enum ls_light_solve solve;
    enum ls_light_method method;
    enum lightstage_model
        model;       /* how the daemon is to promote: spectra it cannot serve are left out */
    bool damped;     /* by `tikhonov` in place of the method's own */
    double tikhonov; /* >= 0, of the mean diagonal (core/solve.h) */
    const struct ls_row_weights *rows; /* NULL: every reading of the chart counts the same */
    bool smooth;                       /* cells that overlap smoothly instead of nearest ones */
    double turn_deg;                   /* the environment turned about y, right-handed */
};

/** A word of the command line: spectral, tristimulus, shared, per-target; nnls, least-squares;
 * nearest, smooth. false: none of them. */
bool ls_light_solve_option(const char *word, enum ls_light_solve *out);
bool ls_light_method_option(const char *word, enum ls_light_method *out);
bool ls_light_cells_option(const char *word, bool *smooth);

struct ls_light_weights {
    enum lightstage_weights mode;
    uint32_t n_names;
    char *names[LS_DOCUMENT_CHANNELS]; /* point into the document */
    uint32_t n_rows, n_lights;
    float *rows;    /* [n_rows][n_lights], radiance x sr */
    bool after_m;   /* the picture is Rec. 709 already, M is not to be applied */
    bool by_target; /* strengths of a colour camera per target after M: rows [3][n_names], each
                       target a shared relight of its own whose picture a row of M makes one
                       channel of */
    bool solved;    /* the following are set */
    struct ls_lighting_solution solution; /* the worst over the lights that matter; its space */
    double tikhonov;                      /* as used */
    double residual;                      /* of all lights together, relative */
    double unreachable;                   /* share of the map's energy no light can have exactly */
    const char *warning;                  /* or NULL */
    char left_out[256]; /* a sentence about photographed spectra that are not used, or empty */
};

/** Errors: LS_ERR_UNSUPPORTED (the take's calibration lacks what this solve needs: says what, and
 * what to do; or no spectrum but white is there for the model), those of core/lighting.h. */
LS_MUST_CHECK enum ls_err ls_light_weights_make(const struct ls_take_document *document,
                                                const struct ls_environment_file *environment,
                                                const struct ls_light_options *options,
                                                struct ls_light_weights *out, struct ls_diag *diag);

/** Zeroed is allowed. */
void ls_light_weights_finish(struct ls_light_weights *weights);

#endif
