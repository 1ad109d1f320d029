/*
 * paper_stage: the still life of 24 + 12 samples under every light of the stage and under an
 * environment of two lamps, on measured spectra.
 * Layer: tests. Threads: one. Ownership: stage_finish frees all.
 */
#ifndef LS_TESTS_SIM_PAPER_STAGE_H
#define LS_TESTS_SIM_PAPER_STAGE_H

#include "core/calibration.h"
#include "core/environment.h"
#include "core/spectrum.h"
#include "sim/truth.h"

#include <glib.h>

enum { LIGHTS = 346, CHANNELS = 8, SPECTRA = 6, SAMPLES = 36, CHART = 24, SEGMENTS = 14 };
enum { V = 6, H = 7, WHITE_PATCH = 18 };

/* How strengths of LEDs are found. */
enum method { TRISTIMULUS, SHARED, PER_TARGET, MONO, METHODS };

/** R of one light, [channel][sample][colour]. */
typedef float samples_of[CHANNELS][SAMPLES][3];

struct stage {
    struct sim_scene *scene;
    struct ls_calibration *cal;
    const float (*directions)[3];
    samples_of *field; /* [LIGHTS] */
    double g[CHANNELS][LIGHTS], k[CHANNELS][LIGHTS];
    double real[SAMPLES][3], m[9];
    struct ls_spectrum sensitivity[3], reflectance[CHART];
    struct ls_lobes lobes;
    struct ls_lobe lobe[2];
    double *cells; /* [LIGHTS][lobes] */
    uint32_t segment[LIGHTS];
};

/** Fail the test with the sentence. */
void ok(enum ls_err err, const struct ls_diag *diag);

/** @folder: of spectra. The lights of a channel differ by 5 %. */
struct stage *stage_new(const char *folder);
void stage_finish(struct stage *stage);

/** Fill `field`. */
void stage_photograph(struct stage *stage);

/** Two area lights left and right, each as bright in green. */
void stage_light_up(struct stage *stage, const struct ls_spectra *illuminants, const char *left,
                    const char *right, double sharpness);

/** Fill `real`: the still life under the lamps themselves, at every wavelength. */
void stage_photograph_real(struct stage *stage);

/** p(s,c) of a colour camera, of one that sees the paper's mix with @colours 1. */
double stage_p(const struct stage *stage, int s, int c, int colours);

/** alpha[LIGHTS][outputs] as core solves it; the mono chart is the colour one mixed. g_free. */
double *stage_strengths(const struct stage *stage, enum method method);

/** A row of a calibration's table. */
void read_row(const struct ls_spectral_table *table, int row, struct ls_spectrum *out);

void apply_m(const double *m, const double in[3], double out[3]);

#endif
