/*
 * conductor: is a highlight the colour of the light (dielectric) or of the material (metal)?
 * Layer: core. Threads: any; pure. Ownership: all arrays are the caller's.
 *
 * LeGendre, Yu and Debevec promote the specular part S of a light in two ways: Eq. 3, S p(s)/p(w),
 * right for dielectrics, and Eq. 1, S F(s)/V, right for conductors, whose highlights have the
 * colour of the rest of the material; w is the polarised white. Between them they blend by how far
 * the colour of S is from the light's. With r = R/R_w, g = G/G_w, b = B/B_w, where (R_w, G_w, B_w)
 * = p(w,.) is what a spectrally flat object reads and (R, G, B) is S after demosaicing:
 *
 *     a = |1 - (R/G)/(R_w/G_w)| = |g - r|/|g|        b = |1 - (R/B)/(R_w/B_w)| = |b - r|/|b|
 *     share = q (min(a/t, 1) + min(b/t, 1))/2,   t = 0.3
 *
 * share = 0: dielectric, 1: conductor. The paper's own |R_w/G_w - R/G| is a R_w/G_w, and
 * |R_w/B_w - R/B| is b R_w/B_w: `plain`, an option; it depends on the camera's white balance.
 *
 * q is the gate: a colour means nothing in the noise. With m = max(|r|,|g|,|b|) and sigma the noise
 * of S over the smallest of p(w,.), q goes smoothly from 0 at m = 10 sigma to 1 at 30 sigma, where
 * the noise of a and b is 5 % and a sixth of t. Too dark means dielectric. A negative S (noise, or
 * a light whose a is off) has a colour like any other, so its sign makes no difference.
 */
#ifndef LS_CORE_CONDUCTOR_H
#define LS_CORE_CONDUCTOR_H

#include "core/error.h"

#include <stdbool.h>
#include <stddef.h>

#define LS_CONDUCTOR_THRESHOLD 0.3
#define LS_CONDUCTOR_SIGMA_FROM 10.0f
#define LS_CONDUCTOR_SIGMA_FULL 30.0f

/** Made by ls_conductor_make. */
struct ls_conductor {
    float scale[3];    /* 1 / p(w,c) */
    float threshold_a; /* t, or t G_w/R_w in the plain form */
    float threshold_b;
};

/**
 * @white: p(w,c) of the polarised white, R G B; @t: LS_CONDUCTOR_THRESHOLD. Errors: LS_ERR_INVALID
 * (a white that is not within [1e-6, 1e6], t not within [1e-6, 1e6]).
 */
LS_MUST_CHECK enum ls_err ls_conductor_make(const double white[3], double t, bool plain,
                                            struct ls_conductor *out, struct ls_diag *diag);

/**
 * The conductor's part of S: out = share x S, and the share itself. @s: three planes of n samples,
 * finite; @sigma: the noise of S in the same unit, >= 0, one per sample, over the smallest of
 * p(w,.); NULL = none. @out: three planes, may be @s; @share: n samples, or NULL. In [0, 1] and
 * finite for any finite input; 0 where S is 0. Accuracy: 1e-6 of |S|, against exact arithmetic.
 * Fixed order, no fused operation: the same bits everywhere. RT-safe.
 */
void ls_conductor_part(const struct ls_conductor *conductor, const float *const s[3],
                       const float *sigma, size_t n, float *const out[3], float *share);

#endif
