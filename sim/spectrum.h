/*
 * spectrum: sampled spectra and the small text files they come from.
 * Layer: sim. Threads: any; no shared state. Ownership: values only.
 *
 * Every spectrum of the simulator is resampled on load (linear interpolation, ends held for
 * reflectances, zero outside for emitters and sensitivities) to one grid: 380 to 780 nm by 5 nm.
 * A file has a header line `wavelength_nm,name,...`, then rows of numbers with strictly increasing
 * wavelengths at most 10 nm apart; lines starting with '#' are comments.
 */
#ifndef LS_SIM_SPECTRUM_H
#define LS_SIM_SPECTRUM_H

#include "core/error.h"

#include <stdbool.h>
#include <stdint.h>

enum {
    SIM_SPECTRUM_START_NM = 380,
    SIM_SPECTRUM_STEP_NM = 5,
    SIM_SPECTRUM_N = 81,
    SIM_SPECTRUM_COLUMNS = 64, /* at most, per file */
};

struct sim_spectrum {
    float v[SIM_SPECTRUM_N];
};

struct sim_spectra {
    uint32_t n;
    char name[SIM_SPECTRUM_COLUMNS][32];
    struct sim_spectrum *spectrum; /* n of them */
};

/**
 * Load every column of a file. @hold_ends: repeat the first and last sample outside the file's
 * range, else zero. (transfer full). Errors: LS_ERR_NOT_FOUND, LS_ERR_INVALID naming file and line.
 */
LS_MUST_CHECK enum ls_err sim_spectra_load(const char *directory, const char *file, bool hold_ends,
                                           struct sim_spectra *out, struct ls_diag *diag);
void sim_spectra_finish(struct sim_spectra *spectra);

/** Column by name, or NULL. (transfer none). */
const struct sim_spectrum *sim_spectra_find(const struct sim_spectra *spectra, const char *name);

/** Integral over wavelength of a(l) b(l) dl, in nm (midpoint sum over the grid). */
double sim_spectrum_dot(const struct sim_spectrum *a, const struct sim_spectrum *b);

/** Integral over wavelength of a(l) b(l) c(l) dl. */
double sim_spectrum_dot3(const struct sim_spectrum *a, const struct sim_spectrum *b,
                         const struct sim_spectrum *c);

#endif
