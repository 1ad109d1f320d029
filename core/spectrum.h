/*
 * spectrum: sampled spectra on one fixed grid, the CIE 1931 observer, and RGB to spectrum.
 * Layer: core. Threads: any (no state). Ownership: spectra are values; a table read from CSV is
 * freed with ls_spectra_destroy.
 *
 * The grid is 380 to 780 nm by 5 nm, 81 samples. Integrals over wavelength are the trapezoid rule
 * on that grid, in nm. A Gaussian of FWHM >= 15 nm (the narrowest LED of a stage) integrates within
 * 1e-4; a line narrower than the grid must be given as a 5 nm band of the same energy.
 */
#ifndef LS_CORE_SPECTRUM_H
#define LS_CORE_SPECTRUM_H

#include "core/error.h"

#include <stdbool.h>
#include <stddef.h>

enum {
    LS_SPECTRUM_N = 81,
    LS_SPECTRUM_FIRST_NM = 380,
    LS_SPECTRUM_STEP_NM = 5,
    LS_SPECTRA_MAX = 512,          /* columns of a CSV */
    LS_SPECTRA_MAX_SAMPLES = 8192, /* rows of a CSV */
    LS_SPECTRUM_NAME_BYTES = 64,
};

struct ls_spectrum {
    double v[LS_SPECTRUM_N];
};

/** Named spectra, in the order of their columns. */
struct ls_spectra {
    size_t n;
    struct ls_named_spectrum {
        char name[LS_SPECTRUM_NAME_BYTES];
        struct ls_spectrum spectrum;
    } * item;
};

/**
 * Bring samples @value at strictly ascending @wavelength_nm onto the grid: linear interpolation,
 * zero outside [first, last].
 * LS_ERR_INVALID: n < 1, not ascending, or a value that is not finite.
 */
LS_MUST_CHECK enum ls_err ls_spectrum_resample(const double *wavelength_nm, const double *value,
                                               size_t n, struct ls_spectrum *out,
                                               struct ls_diag *diag);

/**
 * Parse CSV text: `#` lines are comments, the first other line is `wavelength_nm,name,...`, an
 * empty field means "no sample here" (the column's range may be shorter than the table's).
 * Errors: LS_ERR_INVALID with the line and what was expected; LS_ERR_LIMIT. (transfer full).
 */
LS_MUST_CHECK enum ls_err ls_spectra_parse_csv(const char *text, size_t bytes,
                                               struct ls_spectra **out, struct ls_diag *diag);

/** By exact name; NULL if there is none. (transfer none). */
const struct ls_spectrum *ls_spectra_find(const struct ls_spectra *spectra, const char *name);

/** NULL is allowed. */
void ls_spectra_destroy(struct ls_spectra *spectra);

/** Integral of a(l) dl over the grid, in nm times the spectrum's unit. RT-safe. */
double ls_spectrum_integral(const struct ls_spectrum *a);
/** Integral of a(l) b(l) dl. RT-safe. */
double ls_spectrum_dot(const struct ls_spectrum *a, const struct ls_spectrum *b);
/** Integral of a(l) b(l) c(l) dl: light, reflectance, sensitivity. RT-safe. */
double ls_spectrum_dot3(const struct ls_spectrum *a, const struct ls_spectrum *b,
                        const struct ls_spectrum *c);

/** CIE 1931 2-degree colour-matching functions x, y, z (CIE 15 / ISO 11664-1, every 5 nm). */
extern const struct ls_spectrum ls_cie_1931[3];

/**
 * CIE daylight at correlated colour temperature @kelvin in [4000, 25000], scaled to 100 at 560 nm
 * (CIE 15: S0 + M1 S1 + M2 S2, tables every 10 nm, linear between). 6503.616 K is D65; agrees
 * with the tabulated D65 within 0.15 of 100. LS_ERR_INVALID outside the range.
 */
LS_MUST_CHECK enum ls_err ls_daylight(double kelvin, struct ls_spectrum *out);

/**
 * The three functionals of linear Rec.709: rgb_c = ls_spectrum_dot(s, &out[c]). White point and
 * primaries of ITU-R BT.709-6; scaled so that the equal-energy radiance s = 1 has luminance Y = 1
 * (Y = 0.2126 r + 0.7152 g + 0.0722 b), so D65 scaled to Y = 1 is rgb (1, 1, 1) within 1e-3.
 */
void ls_rec709_functionals(struct ls_spectrum out[3]);

/**
 * The same in the unit of a camera: scaled so that the D65 light whose reading ls_spectrum_dot(s,
 * @green) is 1 has rgb (1, 1, 1). Sensitivities and spectra of a calibration share an arbitrary
 * unit; this makes radiance 1 of a map the radiance 1 of the field. LS_ERR_INVALID if @green sees
 * nothing of D65.
 */
LS_MUST_CHECK enum ls_err ls_rec709_functionals_for(const struct ls_spectrum *green,
                                                    struct ls_spectrum out[3],
                                                    struct ls_diag *diag);

/** What ls_spectrum_smoothest found. */
struct ls_smoothest {
    bool reachable;  /* the spectrum reproduces the RGB within 1e-6 of its norm */
    double residual; /* ||functionals(s) - rgb|| / ||rgb||; 0 for black */
    unsigned iterations;
};

/**
 * The smoothest non-negative spectrum that reproduces @rgb: minimise the sum of squared second
 * differences subject to ls_spectrum_dot(s, &functionals[c]) = rgb[c] and s >= 0. @functionals
 * are ls_rec709_functionals or a camera's three sensitivities. An RGB no light can have (outside
 * the spectrum locus, negative) gives the spectrum whose RGB is nearest in the Euclidean norm,
 * smoothest among those, with @report->reachable false and the distance in residual.
 *
 * A strictly convex QP (the equalities enter as a penalty of weight 1e12, sharpened by the method
 * of multipliers until less than 1e-6 of the norm is missed) solved by block principal pivoting
 * with Murty's one-index rule as safeguard (Judice and Pires 1994; Portugal, Judice and Vicente,
 * Math. Comp. 63, 1994), which is finite. A single line, above all below 400 or above 710 nm, lies
 * so close to the border of what is possible that up to 1e-4 of the norm may be missed; anything of
 * 16 nm width or more is met. Homogeneous: scaling rgb scales s. @report may be NULL. Errors:
 * LS_ERR_INVALID (not finite, functionals linearly dependent), LS_ERR_NOMEM.
 */
LS_MUST_CHECK enum ls_err ls_spectrum_smoothest(const double rgb[3],
                                                const struct ls_spectrum functionals[3],
                                                struct ls_spectrum *out,
                                                struct ls_smoothest *report, struct ls_diag *diag);

#endif
