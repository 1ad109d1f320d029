/*
 * primaries: linear RGB spaces by their primaries and white, and the way from one to another.
 * Layer: core. Threads: any; pure, RT-safe. Ownership: the caller's.
 *
 * What is white stays white: (1, 1, 1) of one space is (1, 1, 1) of the other. Where their whites
 * differ, colours are adapted by the linear Bradford transform (ICC.1:2010, Annex E), as those of
 * ACES are: XYZ to cone responses, these in the ratio of the two whites', and back.
 *
 * Accuracy: a way there and back is the identity within 1e-14. Rec. 709 to ACEScg is
 *     0.613097 0.339523 0.047379 / 0.070194 0.916354 0.013452 / 0.020616 0.109570 0.869815.
 * A colour is multiplied in double and rounded once to float: off by at most 2^-24 of its own size
 * and 2^-51 of the sum of |m v|.
 */
#ifndef LS_CORE_PRIMARIES_H
#define LS_CORE_PRIMARIES_H

#include <stddef.h>

/** CIE 1931 xy of red, green, blue and white. */
struct ls_primaries {
    double xy[4][2];
};

extern const struct ls_primaries ls_primaries_rec709; /* ITU-R BT.709-6; D65 */
extern const struct ls_primaries ls_primaries_acescg; /* AP1, S-2014-004; the ACES white */

/** XYZ = m rgb, white with Y = 1. */
void ls_primaries_to_xyz(const struct ls_primaries *primaries, double m[3][3]);

/** rgb = m XYZ: its inverse. */
void ls_primaries_from_xyz(const struct ls_primaries *primaries, double m[3][3]);

/** rgb in @to = m rgb in @from. */
void ls_primaries_convert(const struct ls_primaries *from, const struct ls_primaries *to,
                          double m[3][3]);

/** out = a b; @out is neither of them. */
void ls_colours_multiply(const double a[3][3], const double b[3][3], double out[3][3]);

/** out[n][3] = m rgb[n][3]; @out may be @rgb. */
void ls_colours_apply(const double m[3][3], const float *rgb, size_t n, float *out);

#endif
