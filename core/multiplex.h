/*
 * multiplex: pictures of half the lights at a time, back to pictures of one light, and when that is
 * worth it.
 * Layer: core. Threads: any (no state). Ownership: all arrays are the caller's.
 *
 * With the S-matrix of core/bases.h, of order p, the picture of row j, its dark (and so all steady
 * ambient) subtracted, shows
 *     m_j = d sum_i S_ji e_i / f
 * with e_i the picture of light i alone, d the duty the row was shown at, f the pattern's factor
 * (core/calibration.h). With the inverse of S,
 *     e_i = (f / d) 2 / (p + 1) sum_j (2 S_ji - 1) m_j.
 * Nothing needs to be decoded to be used: any weighted sum over lights is a weighted sum over the
 * pictures taken, with the weights of ls_multiplex_weights; one light is the sum of one weight.
 *
 * Noise (Schechner, Nayar, Belhumeur, "Multiplexing for optimal lighting", PAMI 29, 2007). A sample
 * has the variance r^2 + q x, r read noise and quantisation, q one electron. Every weight has the
 * same size, so the variance of a decoded light is
 *     (f / d)^2 4 / (p + 1)^2 (p r^2 + q sum_j m_j),   sum_j m_j = (d / f) (p + 1) / 2 sum_i e_i:
 * of read noise, taken one by one, only 2 sqrt(p) / (p + 1) of sigma is left at full duty (1 / 9.3
 * for p = 347); of shot noise, at full duty and with lights alike, sqrt(2) times as much. What wins
 * is a question of how bright a light alone is: ls_multiplex_noise answers it.
 */
#ifndef LS_CORE_MULTIPLEX_H
#define LS_CORE_MULTIPLEX_H

#include "core/error.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/**
 * Weights over the pictures of the rows that sum to the lights' own: sum_j row[j] m_j = sum_i
 * weights[i] e_i. @scale: f / d. @weights: [n_lights]; row[order]. Allocates nothing; order x
 * n_lights steps. Errors: LS_ERR_INVALID (order that is not a prime 3 mod 4 above n_lights, scale
 * not finite and positive, a weight that is not finite).
 */
LS_MUST_CHECK enum ls_err ls_multiplex_weights(uint32_t order, uint32_t n_lights, double scale,
                                               const double *weights, double *row,
                                               struct ls_diag *diag);

/** What a column without a light shows. */
struct ls_multiplex_spare {
    double mean;  /* over the samples, in the unit of a light alone; 0 when all is well */
    double sigma; /* standard error of the mean that the noise model predicts */
    bool alarm;   /* |mean| > 5 sigma: ambient light that changed after the darks, or a sensor or a
                     supply that is not linear */
};

/**
 * Decode the last column, which no light has. @rows: [order], each @n samples of one mosaic, dark
 * subtracted, duty not divided. Noise of a sample x: read_variance + shot max(x, 0); the part that
 * all rows share by having the same dark subtracted, dark_variance, enters each decoded sample as
 * its 2 / (p + 1). The rows that light the spare column show one real light fewer than the others,
 * so a supply that sags by the number of lights shows here too: at a droop of 1.2 and 346 lights by
 * 5e-4 of a row. Errors: as above; also a sample that is not finite.
 */
LS_MUST_CHECK enum ls_err ls_multiplex_spare(uint32_t order, uint32_t n_lights, double scale,
                                             const float *const *rows, size_t n,
                                             double read_variance, double dark_variance,
                                             double shot, struct ls_multiplex_spare *out,
                                             struct ls_diag *diag);

struct ls_multiplex_noise {
    double single_sigma;      /* of a light photographed alone at full duty */
    double multiplexed_sigma; /* of the same light decoded */
    double gain;              /* single / multiplexed: above 1 multiplexing wins */
    double break_even;        /* mean of a light alone below which it wins; 0: never, INFINITY:
                                 always */
};

/**
 * Is it worth it? @mean_e: mean over the lights of what one alone reads, in the unit of the
 * variances' roots; @n_lights of them share each picture of @order rows; same exposure for both.
 * Example: order 347, 346 lights, scale 1, shot 0: gain 9.34; read_variance 0: gain 0.71.
 * Errors: LS_ERR_INVALID as above, or a variance or mean that is negative or not finite.
 */
LS_MUST_CHECK enum ls_err ls_multiplex_noise(uint32_t order, uint32_t n_lights, double scale,
                                             double mean_e, double read_variance, double shot,
                                             struct ls_multiplex_noise *out, struct ls_diag *diag);

#endif
