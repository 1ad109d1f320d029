/*
 * relight_take: a take of a Lambertian sphere made from the definitions, and it relit as the daemon
 * does: weight rows, sums, ratios and pictures by core alone.
 * Layer: tests. Threads: one. Ownership: relight_take_free.
 */
#ifndef LS_TESTS_CORE_RELIGHT_TAKE_H
#define LS_TESTS_CORE_RELIGHT_TAKE_H

#include "core/field.h"
#include "core/relight.h"

#include <glib.h>

enum { N_MAX = 400, SPECTRA = 3, W = 70, H = 65 };

/** Where the lights are. */
enum layout {
    LAYOUT_DOME,    /* rings of latitude */
    LAYOUT_346,     /* as many as a stage has, evenly spread */
    LAYOUT_DOUBLED, /* 173 directions of two lights each */
    LAYOUT_PARTLY,  /* 300 directions, 46 of them of two lights */
};

/** Lights of spread strength, droop and duty in the spheres, everything stored as half mosaics. */
struct take {
    struct ls_field field;
    uint32_t n;
    float direction[N_MAX][3];
    double omega[N_MAX], k[SPECTRA * N_MAX], g[SPECTRA * N_MAX], p[SPECTRA * 3];
    double duty[SPECTRA], factor[SPECTRA], albedo[SPECTRA][3];
    struct ls_picture white[N_MAX], sphere[SPECTRA];
    const void *tiles[N_MAX + SPECTRA][4];
    GByteArray *store;
    double *shade; /* [n][H][W], n.l */
};

/** Strengths are random within 1 +- @spread; the seed is printed. */
struct take *relight_take_new(enum ls_cfa cfa, double spread, enum layout layout);
void relight_take_free(struct take *take);

/** Make the pictures anew, of what the take now says. */
void relight_take_photograph(struct take *take);

/** sums[n_sums][H][W] of pictures. */
void relight_take_sum(const struct ls_field *field, const struct ls_picture *pictures, uint32_t n,
                      const float *weights, uint32_t n_sums, float *sums);

/** The ratio of spectrum @s over the whole picture, from what a take holds. */
void relight_take_ratio(const struct ls_field *field, uint32_t s, float *ratio);

/** out[H][W][3]: relit with @w[n_lights][SPECTRA], shared weights. */
void relight_take_relight(const struct ls_field *field, const double *w, float *out);

/** Weights of an environment that is not symmetric in any way, another per spectrum. */
void relight_take_environment(const struct take *take, gboolean mirrored, double *w);

/** Relative RMS error of @field relit in that environment (or its mirror image) against the
 * definition, over the middle of each surface where demosaicing does not matter. */
double relight_take_error(struct take *take, const struct ls_field *field, gboolean mirrored);

/** What that error may be. Mono: no demosaic, so the halves' 2.4e-4 rms per sample, averaged over
 * the lights, and of the one picture F is all. Bayer: the shading's curvature across two pixels
 * comes on top. */
double relight_take_bound(const struct take *take);

static const struct ls_demosaic_region all_px = {0, 0, W, H};

#endif
