/*
 * field: everything promotion and relighting need to know of a take, as spans of memory.
 * Layer: core. Threads: read-only, any. Ownership: a field owns nothing; every span is the
 * caller's and outlives it (typically a mapped take).
 *
 * Pictures are mosaics of half floats in tiles of 64 x 64 pixels, row-major in the picture and
 * inside the tile. A tile at the right or bottom border holds only the pixels of the picture (its
 * rows are as wide as the border leaves), which is how OpenEXR stores it. A tile pointer may have
 * any alignment; NULL means "empty under every light": all zero.
 *
 * Spectra are the channels of kind spectrum, white first; polarised groups are none of them.
 *
 * Units. A stored half is E x referenceExposure, E *ungained*. With k the brightness gain of an
 * LED, R = k E scale is the field under a uniform light from each direction, where the scale makes
 * a 100 % Lambertian facing a white light of unit irradiance read 1/pi in green (mono: its
 * channel). So sum_i Omega_i R_i of a 100 % Lambertian is p(0, c), and p(0, green) = 1.
 */
#ifndef LS_CORE_FIELD_H
#define LS_CORE_FIELD_H

#include "core/demosaic.h"
#include "core/error.h"

#include <stddef.h>
#include <stdint.h>

enum { LS_TILE_SIDE = 64, LS_FIELD_MAX_SPECTRA = 16 };

/** One picture: tile (tx, ty) is tiles[ty * tiles_x + tx]. */
struct ls_picture {
    const void *const *tiles;
};

/** Noise of one stored mosaic value e of a light's picture: var = read_variance + shot * max(e,0).
 * dark_variance is the part every light shares, because one mean dark is subtracted from all. */
struct ls_field_noise {
    double read_variance, dark_variance; /* stored units squared */
    double shot;                         /* stored units */
};

struct ls_field {
    uint32_t n_lights, n_spectra,
        n_channels;         /* spectrum 0 is white; channels 3 (Bayer), 1 (mono) */
    uint32_t width, height; /* px */
    enum ls_cfa cfa;
    enum ls_demosaic_method demosaic; /* how pictures are made of its sums */
    double scale; /* R = scale k stored: the calibration's scale / referenceExposure */
    const struct ls_picture *white;  /* [n_lights] */
    const struct ls_picture *sphere; /* [n_spectra], photographed full spheres; may be NULL */
    const double *k;                 /* [n_spectra][n_lights] */
    const double *g;                 /* [n_spectra][n_lights], 1/k, mean 1 per spectrum */
    const double *omega_sr;          /* [n_lights] */
    const float (*directions)[3];    /* [n_lights], unit, towards the light */
    const double *p;                 /* [n_spectra][n_channels] */
    const double *duty, *factor; /* [n_spectra], of each full sphere: nominal duty, droop factor */
    struct ls_field_noise noise;
};

uint32_t ls_field_tiles_x(const struct ls_field *field);
uint32_t ls_field_tiles_y(const struct ls_field *field);

/** A rectangle of tiles: [x0, x1) x [y0, y1), in tiles. */
struct ls_tile_region {
    uint32_t x0, y0, x1, y1;
};

/** Pixels of a region, clipped at the picture. RT-safe. */
uint32_t ls_region_width_px(const struct ls_field *field, const struct ls_tile_region *region);
uint32_t ls_region_height_px(const struct ls_field *field, const struct ls_tile_region *region);

/** The smallest region of tiles that holds pixels [x0, x1) x [y0, y1) and a border of @halo px
 * around them, clipped at the picture. RT-safe. */
struct ls_tile_region ls_region_of_pixels(const struct ls_field *field, uint32_t x0, uint32_t y0,
                                          uint32_t x1, uint32_t y1, uint32_t halo);

/**
 * Is it a field? Checks sizes, that gains and strengths are finite and positive, g = 1/k within
 * 1e-6, mean g = 1 within 1e-3 for every spectrum, duties in (0, 1], factors in (0, 10], Omega
 * summing to 4 pi within 1e-3, p positive with p(0, green) = 1 within 1e-3, scale positive.
 * LS_ERR_INVALID says which and what was expected. Spans that are NULL are LS_ERR_INVALID, except
 * sphere.
 */
LS_MUST_CHECK enum ls_err ls_field_check(const struct ls_field *field, struct ls_diag *diag);

/**
 * k from strengths as measured, in any unit: g normalised to mean 1, k = 1/g. Both [n].
 * LS_ERR_INVALID if a strength is not finite and positive.
 */
LS_MUST_CHECK enum ls_err ls_field_normalise_gains(const double *strength, size_t n, double *k,
                                                   double *g, struct ls_diag *diag);

#endif
