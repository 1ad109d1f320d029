/*
 * pattern_factor: what a picture of several lights gives less than the sum of its lights: supply
 * sag and quantised duty in one number per (channel, pattern, duty).
 * Layer: core. Threads: any; pure. Ownership: everything is the caller's.
 *
 *     factor = sum over the pattern's lights of E / (photographed picture / nominal duty)
 *
 * on the grey sphere, both ungained: >= 1, e.g. 1.20 for a full sphere whose supply sags by a
 * sixth. Estimate: ratio of sums over the sphere's pixels that are valid in both and above 5 % of
 * the brightest (of their colour), weights 1, those refused whose own ratio is more than 6 robust
 * sigmas off; its error from the scatter between blocks of the sphere. Bias of the ratio: about
 * (noise of the photographed sum / sum)^2, < 1e-6. Within 0.5 % of truth by the standard error
 * reported.
 */
#ifndef LS_CORE_PATTERN_FACTOR_H
#define LS_CORE_PATTERN_FACTOR_H

#include "core/error.h"
#include "core/sphere_view.h"

#include <stdint.h>

struct ls_pattern_factor {
    double factor, sigma;
    uint32_t n; /* pixels used */
};

/**
 * @sum: [height][width] sum of the single lights' E; @photographed: E of the pattern at @duty, both
 * merged and ungained. @validity: of the photographed picture, and @sum_validity of the sum (the
 * worst of its parts), either NULL. Errors: LS_ERR_INVALID (duty not in (0, 1]), LS_ERR_NOT_FOUND
 * with a sentence (dark, fewer than 50 usable pixels, a ratio not in [0.2, 5]), LS_ERR_NOMEM.
 */
LS_MUST_CHECK enum ls_err ls_pattern_factor(const struct ls_sphere_view *view, const float *sum,
                                            const uint8_t *sum_validity, const float *photographed,
                                            const uint8_t *validity, double duty,
                                            struct ls_pattern_factor *out, struct ls_diag *diag);

/**
 * One factor for a class of @n pictures (the segments of a partition, several cameras): the mean
 * weighted by 1/sigma^2; its error scaled by their scatter where that is larger than they say.
 * LS_ERR_INVALID: n = 0, or a sigma or factor that is not positive.
 */
LS_MUST_CHECK enum ls_err ls_pattern_factor_combine(const struct ls_pattern_factor *each,
                                                    uint32_t n, struct ls_pattern_factor *out,
                                                    struct ls_diag *diag);

#endif
