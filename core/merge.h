/*
 * merge: the exposures of one condition to one radiance estimate per pixel, on the mosaic.
 * Layer: core. Threads: any; a pure function over spans, so several threads may share an image by
 * rows: every split gives the same bits. Ownership: everything is the caller's.
 *
 * Source: the optimal linear estimator, of inverse-variance weighting (Aitken, On Least Squares,
 * Proc. R. Soc. Edinburgh 55, 1935). With y = x - D (raw minus mean dark, DN), t the exposure and
 * sigma^2 its modelled variance, the estimate over a set S of exposures is
 *
 *     E_S = sum_S w' y / sum_S w' t,   w' = t / sigma^2,   Var E_S = 1 / sum_S w' t.
 *
 * sigma^2(t) = read_noise^2 + 1/12 + max(E t, 0) / electrons_per_dn, in DN^2, evaluated at an
 * estimate, never at the sample itself. The steps, per pixel:
 *   1. pooled: sum y / sum t over the unclipped samples (x < clip_dn); the optimum for shot noise;
 *   2. pooled again with w' from step 1, which is the optimum to second order;
 *   3. an exposure is *high* when it clipped or D + E t > range_high full_scale, *low* when
 *      D + E t < range_low full_scale, else in range;
 *   4. E over the in-range exposures, with w' from the estimate of step 2.
 * Why the choice in step 3 adds no bias: the pooled estimate is efficient, so every unbiased
 * estimate T from a subset of its samples has Cov(T, pooled) = Var(pooled), hence
 * E[T | pooled] = pooled: whichever subset the pooled value selects, the mean stays. A choice by
 * the noisy sample itself would bias E by up to 0.4 sigma at the edge.
 *
 * None in range: all high -> the shortest, SATURATED; all low -> the longest, DARK; some high, some
 * low -> the longest that is not high, GAP. Nothing is clamped: E of a dark pixel is as often
 * negative as positive.
 *
 * Defective pixels are replaced after their neighbours are merged and before anything else sees
 * the mosaic: E of the four nearest same-colour pixels that are not defective themselves, of the
 * pair (left-right or up-down) that differs less where both pairs are whole, else their mean; where
 * none of the four is good, the next ring out, up to LS_MERGE_DEFECT_RINGS; where none is good even
 * there, the pixel stays as it is. Variance follows; validity is the worst of those used
 * (saturated, gap, dark, ok).
 *
 * Accuracy: within 4e-6 of the exact weighted mean, relative to sum w'|y| / sum w't (float
 * arithmetic in a fixed order, the same bits from every instruction set; an exposure whose expected
 * value lies within 1e-5 of a range edge may fall either way). Darks must be finite. Bias over
 * noise <= 0.1 % of E for noise >= 0.45 DN (below that the quantiser itself is biased) and sigma <=
 * 3 % at range_high (so that clipping stays far from it). Example: t = 1, 4, 16 ms, 8 bits, D = 8:
 * y = 5, 20, 80 -> expected raw 13, 28, 88; only 28 and 88 lie in [25.5, 216.75]; E = about 5000
 * DN/s / 255 = 19.6 full scale / s.
 */
#ifndef LS_CORE_MERGE_H
#define LS_CORE_MERGE_H

#include "core/error.h"
#include "core/pixel.h"

#include <stddef.h>
#include <stdint.h>

enum {
    LS_MERGE_MAX_EXPOSURES = 8,
    LS_MERGE_DEFECT_RINGS = 4,
};

#define LS_MERGE_RANGE_LOW 0.10
#define LS_MERGE_RANGE_HIGH 0.85

/** What is known of a merged pixel; stored as one byte. */
enum ls_validity {
    LS_VALIDITY_OK = 0,
    LS_VALIDITY_SATURATED = 1, /* high in every exposure: E is a lower bound */
    LS_VALIDITY_DARK = 2,      /* low in every exposure: unbiased, but noisy */
    LS_VALIDITY_GAP = 3,       /* between two exposures too far apart */
};

struct ls_merge_params {
    const struct ls_pixel_format *format;
    uint32_t width, height;                    /* px */
    uint32_t n_exposures;                      /* 1 .. LS_MERGE_MAX_EXPOSURES */
    double exposure_s[LS_MERGE_MAX_EXPOSURES]; /* as really used, any order, > 0 */
    double range_low, range_high;              /* of full scale; 0.10 and 0.85 */
    double full_scale_dn;                      /* E is in units of this per second */
    double clip_dn;                            /* samples >= this are clipped; <= full scale */
    double electrons_per_dn, read_noise_dn;    /* noise model; > 0, >= 0 */
    const uint32_t *defects;                   /* ascending y width + x (transfer none), or NULL */
    uint32_t n_defects;
    double reference_exposure_s; /* of the stored halves; 0 where none are asked for */
};

/** Inputs and outputs of one image; every pointer is to the first pixel of the whole image. */
struct ls_merge_spans {
    const void *raw[LS_MERGE_MAX_EXPOSURES];   /* as on the wire, in the order of exposure_s */
    const float *dark[LS_MERGE_MAX_EXPOSURES]; /* mean dark, DN; NULL = 0 everywhere */
    float *e;                                  /* full scale / s, or NULL */
    uint8_t *validity;                         /* enum ls_validity */
    float *variance;                           /* (full scale / s)^2, or NULL */
    uint16_t *half;                            /* as ls_merge_store_half makes of e, or NULL */
};

/** Check parameters once, before merging many images. LS_ERR_INVALID with a sentence. */
LS_MUST_CHECK enum ls_err ls_merge_check(const struct ls_merge_params *params,
                                         struct ls_diag *diag);

/**
 * Merge rows [@first_row, @first_row + @n_rows) of an image. @params must have passed
 * ls_merge_check. Inputs are read in the band and, next to defective pixels, up to
 * 2 LS_MERGE_DEFECT_RINGS rows beyond it. Outputs are written in the band only; they overlap
 * nothing. Uses about 24 KiB of stack. RT-safe.
 */
void ls_merge_rows(const struct ls_merge_params *params, const struct ls_merge_spans *spans,
                   uint32_t first_row, uint32_t n_rows);

/**
 * Number of steps of a bracket that leave a gap: neighbouring exposures (after sorting) with a
 * ratio above range_high / range_low, so that some radiance is too bright for one and too dark for
 * the next. A black level above 0 only helps, so 0 gaps is 0 gaps for any. @shorter_s: the
 * shorter exposure of the first such step (NULL is allowed). RT-safe.
 */
uint32_t ls_merge_bracket_gaps(const double *exposure_s, uint32_t n_exposures, double range_low,
                               double range_high, double *shorter_s);

/**
 * Stored value: nearest half of E @reference_exposure_s, so that white is near 1. Beyond the range
 * of half (65504) the largest finite half is stored and the pixel's validity becomes
 * LS_VALIDITY_SATURATED; returns how many. A NaN cannot come out of the merge; one given here is
 * stored as 0 and marked likewise. @n pixels, any split. RT-safe.
 */
size_t ls_merge_store_half(const float *e, size_t n, double reference_exposure_s, uint16_t *half,
                           uint8_t *validity);

#endif
