/*
 * compare: the promoted field against the true one over one block of pixels, light by light.
 * Layer: tests. Threads: a comparison is read only; a tally belongs to one thread. Ownership: the
 * caller owns every struct and array.
 */
#ifndef LS_TESTS_JUDGE_COMPARE_H
#define LS_TESTS_JUDGE_COMPARE_H

#include "judge.h"

#include "sim/sweep.h"

/** Squared differences and squared truth of one class of pixels, all spectra together. */
struct judge_ratio_sum {
    double difference, truth;
};

/** Sums over a sample's pixels under one light in one spectrum. */
struct judge_sample_sum {
    double promoted[JUDGE_COLOURS], truth[JUDGE_COLOURS];
};

/** What one thread adds up. */
struct judge_tally {
    struct judge_ratio_sum field, interreflection, highlight;
    struct judge_sample_sum *samples; /* [light][spectrum][sample] */
    double black_difference;          /* sum over velvet pixels of (relit - true) / sigma */
    uint64_t black_pixels;
};

/** What is compared. */
struct judge_comparison {
    const struct judge *judge;
    const struct ls_field *field;
    const struct sim_sweep *truth; /* its channels are the field's spectra, in order */
    const float *bounced;          /* [height][width], share of bounced light */
    struct sim_sample samples[SIM_SAMPLES];
};

/**
 * What the model makes of one light alone at strength 1: out[n_spectra][height][width][3], spectra
 * in the field's order, in R's unit. The one place where a model is asked for. Errors: those of
 * daemon/render.h. Any thread.
 */
LS_MUST_CHECK enum ls_err judge_promoted(const struct judge_comparison *comparison, uint32_t light,
                                         const struct ls_demosaic_region *region, float *out,
                                         struct ls_diag *diag);

/** Blocks of a picture. */
uint32_t judge_n_blocks(const struct ls_field *field);

/** Compare block @index under every light. Errors: those of the truth, LS_ERR_NOMEM. */
LS_MUST_CHECK enum ls_err judge_compare_block(const struct judge_comparison *comparison,
                                              uint32_t index, struct judge_tally *tally,
                                              struct ls_diag *diag);

#endif
