/*
 * still_life: the simulated still life in memory, and a camera that photographs it.
 * Layer: tests. Threads: one per world. Ownership: still_life_free.
 *
 * 346 lights of unequal strength (5 %), W R A G C B; R at every pixel, without noise.
 *
 * The sensor: 10500 e full well, 5 e read noise, bracket t, t/8, t/64, where a white diffuser
 * facing a single light reads 0.8 of full scale at t; every sample in range (up to 0.85) counts,
 * weighted by its information. A picture of n lights is exposed 4 / n as long, as a quarter of them
 * faces any surface. Every picture is the mean of two frames: 0.8 % per pixel on white.
 */
#ifndef LS_TESTS_CORE_STILL_LIFE_H
#define LS_TESTS_CORE_STILL_LIFE_H

#include "core/linear.h"

#include <glib.h>
#include <stdbool.h>
#include <stdint.h>

enum { STILL_LIFE_LIGHTS = 346, STILL_LIFE_SPECTRA = 6, STILL_LIFE_COLOURS = 3 };

/** The world, all of it in memory. */
struct still_life {
    uint32_t side, colours;
    size_t n;                         /* values of a picture: side x side x colours */
    float *truth[STILL_LIFE_SPECTRA]; /* [light][pixel][colour] */
    float *specular;                  /* [light][pixel], its share under one light */
    float *bounced;                   /* [pixel], its share under all lights */
    float directions[STILL_LIFE_LIGHTS][3];
    float camera[3];                                 /* direction of the camera, unit */
    double g[STILL_LIFE_SPECTRA][STILL_LIFE_LIGHTS]; /* strengths */
    double p[STILL_LIFE_SPECTRA][STILL_LIFE_COLOURS];
};

/** @side x @side pixels; @cfa: "RG", or "mono" for one colour; @blur_px: of the lens (sim/blur.h).
 * Takes 0.4 GB for 128 px in RGB. */
void still_life_load(struct still_life *world, uint32_t side, const char *cfa, double blur_px);
void still_life_free(struct still_life *world);

/** How a picture is taken. */
struct still_life_camera {
    bool noise, mosaic; /* mosaic: photographed through RGGB and demosaiced */
    GRand *rand;
    double frames; /* averaged in a picture; 0: two, 0.8 % noise on white. 1/8: 3.2 % */
};

/** Full scales per unit of R at the longest exposure of a picture of @n_lights. */
double still_life_rate(double n_lights);

/** Variance of the merged bracket, of two frames, at radiance @x, in the unit of R, squared. */
double still_life_variance(double x, double rate);

/** What promotion is told of it: the longest exposure alone; 0 without noise. */
struct ls_linear_noise still_life_noise(const struct still_life_camera *camera, double rate);

/** Photograph @picture [side][side][colours], which is the truth, in place. */
void still_life_take(const struct still_life *world, const struct still_life_camera *camera,
                     double n_lights, float *picture);

#endif
