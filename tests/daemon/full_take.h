/*
 * full_take: a small take on disk that holds every kind of picture, whose every number the test
 * knows.
 * Layer: tests. Threads: one. Ownership: the fixture's; see free.
 *
 * Eighteen lights; spectra W, R, G and polarisers V, H. W, V and H light by light (and G of a mono
 * camera); W and R as full spheres; R in three segments of six lights, and as a head light of
 * three. Light comes back diffuse, with a colour, and white from a coat; under R its diffuse part
 * depends on where the light stands, so that no model but the truth is right and each is wrong in
 * its own way.
 */
#ifndef LS_TESTS_DAEMON_FULL_TAKE_H
#define LS_TESTS_DAEMON_FULL_TAKE_H

#include "core/calibration.h"

#include <glib.h>
#include <stdbool.h>

enum { FULL_W = 150, FULL_H = 140, FULL_LIGHTS = 18, FULL_PIXELS = FULL_W * FULL_H };
enum { FULL_CHANNELS = 5, FULL_SEGMENTS = 3, FULL_HEAD = 3 };
enum { FULL_GLINT = 3 }; /* its middle at (12 FULL_GLINT, 70) */
enum { FULL_ORDER = 19 };
enum full_channel { FULL_CW, FULL_CR, FULL_CG, FULL_CV, FULL_CH };

struct full_take_options {
    bool mono, mono_two; /* two: G light by light too */
    bool green_like_red; /* G comes back as R does, and both by a light's segment */
    bool polarised_only; /* no W light by light */
    bool polarisation;   /* calibrated: a light's a_V is what its coat keeps of it, 0.9 to 0.98 */
    bool sphere_factors_only;
    bool multiplexed; /* W by rows of the S-matrix, not light by light, under a supply that sags */
    float ambient;    /* that came after the darks: in every row */
    bool some_red;    /* R light by light too, of the head light's lights */
    bool glint;       /* light FULL_GLINT mirrors itself to the camera, 30 times all others */
    bool coloured;    /* lights of W, R and V differ in colour by up to 3 % */
    bool white_coloured; /* those of W and V alone */
    bool ones;           /* calibrated: factors of k for each camera colour that are all 1 */
    int red_lights;      /* R light by light too: of lights 1, 3, 5 .. so many; FULL_LIGHTS = all */
};

struct full_take {
    char *root, *id;
    struct ls_calibration *calibration;
    double scale;
    double k[FULL_CHANNELS][FULL_LIGHTS];
    double colour[FULL_CHANNELS][FULL_LIGHTS][3]; /* factors on k */
    /* stored values, exact halves */
    float light[FULL_CHANNELS][FULL_LIGHTS][FULL_PIXELS];
    float sphere[FULL_CHANNELS][FULL_PIXELS]; /* W, R */
    float segment[FULL_SEGMENTS][FULL_PIXELS];
    float head[FULL_PIXELS];
    float row[FULL_ORDER][FULL_PIXELS]; /* if multiplexed */
};

/** Light i is in segment i % FULL_SEGMENTS; the head light is lights 0 to FULL_HEAD - 1. */
struct full_take *make_full_take(const struct full_take_options *options);

/** R = k E of a pixel's own colour under a light: what the take was made of. */
double full_take_reflected(const struct full_take_options *options, int channel, int light,
                           int pixel);

/** Camera colour of a pixel; mono: 1. */
int full_take_colour_at(int pixel, bool mono);

/** What a stored picture of a pattern is multiplied by: factor / duty. */
double full_take_factor(const char *pattern);

void full_take_free(struct full_take *take);

#endif
