/*
 * bases: illumination patterns, each a weight per light, that photographed together stand for every
 * single light or for the low frequencies of the field.
 * Layer: core. Threads: any (no state). Ownership: all arrays are the caller's. RT-safe throughout.
 *
 * Multiplexing. An S-matrix of prime order p = 3 mod 4: row j lights column c where (c - j) mod p
 * is 0 or a quadratic residue, so (p + 1) / 2 of p columns; its inverse is 2 (2 S^T - J) / (p + 1),
 * J all ones. (Schechner, Nayar, Belhumeur, "Multiplexing for optimal lighting", PAMI 2007.) Light
 * i is column i; columns beyond the lights stay dark.
 *
 * Harmonics. Real, orthonormal over the sphere in steradians, number l l + l + m: sine terms for
 * m < 0, no Condon-Shortley sign, y up: the axis of m = 0 is +y, the azimuth runs from +z to +x.
 *
 * Accuracy: matrices are whole numbers. Products of harmonics integrate to 0 and 1 within 2e-6, and
 * the lowest are within 1e-7 of their formulas: directions are floats. Weights give Y back within
 * 1e-14 (1 + peak), gradients are exact to 1e-15. A coefficient is off from
 * the sum it stands for by at most 2.4e-7 x 4 pi / n x peak x the picture of all lights: pictures
 * are floats.
 */
#ifndef LS_CORE_BASES_H
#define LS_CORE_BASES_H

#include <stddef.h>
#include <stdint.h>

enum { LS_HARMONICS_MAX_DEGREE = 9 };

/** How a signed function becomes light: (1 + f) / 2 in one picture, or max(f, 0) and max(-f, 0) in
 * two. */
enum ls_basis_form { LS_BASIS_BIASED, LS_BASIS_POSITIVE, LS_BASIS_NEGATIVE };

/** Order of the smallest such matrix with a dark column to spare: the least prime p = 3 mod 4 with
 * p >= n_lights + 1; 347 for 346. n_lights in [1, 65536]. */
uint32_t ls_multiplex_order(uint32_t n_lights);

/** Row @row of the matrix of @order: on[order], 1 or 0. */
void ls_multiplex_row(uint32_t order, uint32_t row, uint8_t *on);

/** Value of harmonic @index < (LS_HARMONICS_MAX_DEGREE + 1)^2 in a direction of any length but 0.
 */
double ls_harmonic(uint32_t index, const float direction[3]);

/**
 * Weights [0, 1] of @n lights for harmonic @index. With f = Y / peak, peak the largest |Y| over
 * these lights: (1 + f) / 2, max(f, 0) or max(-f, 0). Returns peak; where it is 0 (every light on a
 * node) the weights are those of f = 0.
 */
double ls_harmonic_weights(uint32_t index, enum ls_basis_form form, const float (*directions)[3],
                           uint32_t n, double *weights);

/** Weights [0, 1] of @n lights rising along an axis of the stage, 0 x, 1 y, 2 z: (1 + omega_axis) /
 * 2 with omega the unit direction. (Ma et al., spherical gradient illumination, EGSR 2007.) */
void ls_gradient_weights(unsigned axis, const float (*directions)[3], uint32_t n, double *weights);

/**
 * The coefficient a = (4 pi / n) sum_i Y(omega_i) R_i from pictures shown with the weights above,
 * each divided by its duty and multiplied by its factor: in pairs @shown of the positive and @other
 * of the negative weights, biased @shown and @other of all lights at weight 1. 4 pi / n stands for
 * the lights' cells, so a is the projection of the field on Y as well as n equal cells can tell:
 * the sum itself is exact, noise apart. R carries the lights' unequal strengths as they were lit.
 * out[count].
 */
void ls_harmonic_coefficient(enum ls_basis_form form, double peak, uint32_t n, const float *shown,
                             const float *other, size_t count, float *out);

#endif
