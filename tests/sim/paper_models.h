/*
 * paper_models: a paper_take promoted by each model and relit, by the core's own functions.
 * Layer: tests. Threads: one. Ownership: the take's.
 */
#ifndef LS_TESTS_SIM_PAPER_MODELS_H
#define LS_TESTS_SIM_PAPER_MODELS_H

#include "tests/sim/paper_take.h"

/** Ratios, matrices and whatever else @model needs are made anew. */
void paper_take_promote(struct paper_take *take, enum model model);

/** Camera RGB (mono: the same thrice) of every sample under w[SPECTRA][LIGHTS], radiance x sr, as
 * the model promoted last has it. */
void paper_take_relight(const struct paper_take *take, const double *w, double out[SAMPLES][3]);

/** The baseline: the environment's camera RGB per light w[3][LIGHTS] on white. Used up. */
void paper_take_tristimulus(const struct paper_take *take, double *w, double out[SAMPLES][3]);

#endif
