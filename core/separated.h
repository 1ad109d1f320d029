/*
 * separated: sums over all lights of diffuse, specular and metallic light, in one pass.
 * Layer: core. Threads: reentrant; a caller splits a picture into regions as it likes and gets the
 * same bits. Ownership: all arrays are the caller's.
 *
 * A relit picture of a polarised field is, per spectrum s, with w_i the weights of the lights,
 *
 *     out = ratio (sum w_i D_i + C) + tint (sum w_i S_i - C),   C = sum w_i share(i,p) S_i,
 *     tint = p(s,c)/p(w,c)
 *
 * (Eq. 1 for the diffuse part and for conductors, Eq. 3 for dielectrics; ratio from
 * ls_separate_remainder). The share depends on pixel and light, so C cannot be summed on the
 * mosaic: each light's S is demosaiced once, its colour judged (core/conductor.h), and all rows of
 * weights take from it. D and S are summed on the mosaic and demosaiced once per row.
 *
 * What it costs: with six rows about ten times as many sums of V and H as for Eq. 1 (tests/bench).
 * A third of that is gathering the pictures with their borders, a sixth the sums, a sixth
 * demosaicing, an eighth widening and separating, a tenth the blend. Where S does not exceed its
 * noise fourfold anywhere in half a tile, as in shadow, the gate lets nothing through and a light
 * is neither demosaiced nor blended there: the same bits, at 0.8 of the time with every other light
 * dark.
 *
 * One light alone is a row with a single 1. The denominators of the ratio are rows too: g(i,s).
 */
#ifndef LS_CORE_SEPARATED_H
#define LS_CORE_SEPARATED_H

#include "core/conductor.h"
#include "core/demosaic.h"
#include "core/error.h"
#include "core/field.h"
#include "core/separate.h"

#include <stddef.h>
#include <stdint.h>

/** A polarised field: pictures of halves in tiles, as in core/field.h. */
struct ls_separated_field {
    uint32_t n_lights, n_channels; /* 3 (Bayer) or 1 (mono: no colour, all dielectric) */
    uint32_t width, height;        /* px */
    enum ls_cfa cfa;
    const struct ls_picture *v, *h; /* [n_lights] each, ungained; a NULL tile is 0 */
    const struct ls_split *split;   /* [n_lights], which holds the gains */
    struct ls_field_noise noise;    /* of a stored value of V or H */
    struct ls_conductor conductor;  /* Bayer only */
    const float *v_max,
        *h_max; /* [tiles_y * tiles_x][n_lights], max |value| of the tile; or NULL */
};

enum { LS_SEPARATED_MAX_ROWS = 256 };

/** A rectangle of pixels of the picture, anywhere, any size. Its sums cost least when it begins and
 * ends on multiples of LS_TILE_SIDE. */
struct ls_separated_job {
    const struct ls_separated_field *field;
    uint32_t n_rows;
    const float *weights; /* [n_rows][n_lights] */
    struct ls_demosaic_region region;
    enum ls_demosaic_method method;
    double max_error; /* per row and pixel, in units of D and S: what of |D| + |S| may be left out
                         of the mosaic; 0 = none. Needs v_max and h_max */
};

struct ls_separated_report {
    double bound;        /* largest sum of |w| (|D| + |S|) left out, over rows and tiles */
    uint64_t tiles_read; /* (light, tile) pairs of which V and H were read */
    uint64_t tiles_skipped;
    uint64_t not_finite; /* stored Inf or NaN met, each counted as 0; those near a border of
                            tiles more than once */
};

/**
 * Demosaiced sums [n_rows][region.height][region.width][n_channels]: @diffuse = sum w D, @specular
 * = sum w S, @conductor = sum w share S; each may be NULL. A light whose weight is 0 in every row
 * is not read. The noise of the gate is that of the samples of V and H in the 2 x 2 cell right of
 * and below the pixel, every colour once, the largest.
 *
 * With max_error, lights are left out of a tile, D, S and share together, by core/left_out.h. A
 * light reaches (|d_v| + |s_v|) max |E_V| + (|d_h| + |s_h|) max |E_H|, maxima over the tile and, as
 * demosaicing looks beyond it, the eight around it: a share lies in [0, 1], so nothing of what is
 * made of D + share S and of S - share S is larger. Demosaicing makes at most 2.5 times the bound
 * of it (core/demosaic_lanes.h). A part of a picture is left out where the whole's is.
 *
 * Accuracy: as ls_accumulate, (n/8 + 12) 2^-24 sum |w| (|s_v E_V| + |s_h E_H|) for S, likewise for
 * D; groups of 8 lights in ascending order, in float; the same bits for any kernels; besides that
 * the bound. Memory: below 1 MiB + 48 KiB per row, on the heap. Errors: LS_ERR_INVALID (region,
 * n_rows, n_channels, a weight that is not finite, max_error without maxima), LS_ERR_NOMEM.
 */
LS_MUST_CHECK enum ls_err ls_separated_accumulate(const struct ls_separated_job *job,
                                                  float *diffuse, float *specular, float *conductor,
                                                  struct ls_separated_report *report,
                                                  struct ls_diag *diag);

/**
 * Noise of a row's denominator sum w (D + share S) (ls_separate_remainder), for ls_promote_ratio:
 * sigma^2 = read sum w^2 (d_v^2 + d_h^2) + dark (sum w (d_v + d_h))^2
 * + shot max_i(w_i d_i^2 / k_i) max(total, 0), d^2/k the larger of V's and H's. @row: one row of
 * weights >= 0; @total: that row's sums of D + S, n values. As with ls_promote_sigma, what
 * demosaicing does to noise is not modelled, nor is the smaller noise of conductors.
 */
void ls_separated_sigma(const struct ls_separated_field *field, const float *row,
                        const float *total, size_t n, float *sigma);

/**
 * out += scale (ratio (diffuse + conductor) + tint (specular - conductor)), n_px pixels of
 * n_channels; one row's sums of ls_separated_accumulate. @ratio: [n_px][n_channels], or NULL for
 * the polarised white itself (ratio 1, tint unused). @conductor NULL = 0. @tint: p(s,c)/p(w,c)
 * [n_channels]. Float. RT-safe.
 */
void ls_separated_finish(const float *diffuse, const float *specular, const float *conductor,
                         const float *ratio, const double *tint, double scale, size_t n_px,
                         uint32_t n_channels, float *out);

#endif
