/*
 * take_fixture: a small take on disk, made through the store, whose every number the test knows.
 * Layer: tests. Threads: one. Ownership: the fixture's; see free.
 *
 * Seven lights, channels W, R and the polarised V, a Bayer camera of 150 x 140 pixels (three tiles
 * across and down, the last ones narrow). W is photographed light by light; W and R as full
 * spheres. What R's sphere shows is the white field under R's strengths times a smooth ratio; light
 * and contrast are such that the stable ratio is the plain one everywhere.
 */
#ifndef LS_TESTS_DAEMON_TAKE_FIXTURE_H
#define LS_TESTS_DAEMON_TAKE_FIXTURE_H

#include "core/calibration.h"

#include <glib.h>
#include <stdint.h>

enum { TAKE_W = 150, TAKE_H = 140, TAKE_LIGHTS = 7, TAKE_PIXELS = TAKE_W * TAKE_H };
enum { TAKE_LEVEL = 728, TAKE_PATCHES = 6 };
#define TAKE_SHORT_S 0.002
#define TAKE_LONG_S 0.01
#define TAKE_REFERENCE_S 0.01

enum { TAKE_FLAGGED = 2 }; /* the light whose picture has pixels of every validity */

struct made_take {
    char *id;
    struct ls_calibration *calibration;    /* as in its take.json; NULL = made without */
    double scale;                          /* R = scale k stored */
    float light[TAKE_LIGHTS][TAKE_PIXELS]; /* stored values of W, exact halves */
    float sphere_r[TAKE_PIXELS];           /* stored, exact halves */
    double k[2][TAKE_LIGHTS];              /* of W and R, as read back from JSON */
};

/** Make it under @storage. @missing: a light that is not published, or -1. */
struct made_take *make_take(const char *storage, bool calibrated, int missing);

/** The same, complete, with a second camera whose picture of light i shows light i + 1 (the last:
 * light 0). */
struct made_take *make_take_of_two_cameras(const char *storage);

void made_take_free(struct made_take *take);

/** take.json of such a take. g_free. */
char *take_json_text(const struct ls_calibration *calibration, uint32_t n_cameras);

/** Gaussian spectra, a chart, L consistent with them. (transfer full). */
struct ls_calibration *made_calibration(void);

/** enum ls_validity of a pixel of a light's picture. */
uint8_t made_validity(int light, int pixel);

/** The calibration's LED spectrum of channel @c at @nm. */
double made_spectrum(int c, double nm);

#endif
