/*
 * promote_tile: a tile photographed under white, to the same tile under every other spectrum.
 * Layer: core. Threads: any; pure. Ownership: everything is the caller's.
 *
 * The last step of LeGendre, Yu and Debevec, Eq. 1: R(i,p,s,c) = k E(i,p,0,c) x ratio(p,s,c), on
 * demosaiced samples, where the ratio is F / V as promote.h makes it. A sample does not see its
 * neighbours, so a tile is any span of samples: planar or interleaved, one colour or three, as long
 * as white, ratios and results are alike. Ratios are those of the pixels, the same for every light.
 *
 * Accuracy: the nearest half of the exact product where the gain is a power of two, else within
 * 2^-11 + 2^-23 of it, relative (half denormals: within 2^-25). Products beyond half's range become
 * +-65504. A sample or ratio that is Inf or NaN (a damaged file) makes 0, and is counted. The same
 * bits from every instruction set. Example: 0.5 x ratio 1.5 = 0.75; 60000 x 2 = 65504.
 */
#ifndef LS_CORE_PROMOTE_TILE_H
#define LS_CORE_PROMOTE_TILE_H

#include <stddef.h>
#include <stdint.h>

/** What to promote; every span has @n samples (halves, any alignment of elements) and overlaps no
 * other. */
struct ls_promote_tile {
    const uint16_t *white;
    uint32_t n_spectra;
    const uint16_t *const *ratio; /* [n_spectra] */
    uint16_t *const *out;         /* [n_spectra] */
    size_t n;
    float gain; /* of the white sample: 1, or k(i) x the field's scale; magnitude <= 1e24 */
};

/** Fill out[s][j] = gain white[j] ratio[s][j]. Returns how many results are 0 because what they are
 * made of is not finite. RT-safe. */
size_t ls_promote_tile(const struct ls_promote_tile *tile);

#endif
