/*
 * polarised_field: a simulated take of W, V and H from every light, and one full sphere per
 * spectrum, made in this process: mosaics of halves with known strengths and noise.
 * Layer: tests. Threads: one. Ownership: finish frees.
 *
 * Sensor: a stored value of 1 is 42000 electrons (a full well of 10500, in the longest of a bracket
 * a factor 4 apart), with 5 electrons read noise, so that variance = (5/42000)^2 + max(e, 0)/42000;
 * a 90 % white facing a light reads 0.5. Strengths spread by 5 %; the calibration knows them
 * exactly.
 */
#ifndef LS_TESTS_SIM_POLARISED_FIELD_H
#define LS_TESTS_SIM_POLARISED_FIELD_H

#include "core/separated.h"
#include "sim/world.h"
#include "tests/core/noise.h"

enum { POLARISED_W = 0, POLARISED_V = 6, POLARISED_H = 7, POLARISED_KINDS = 3 };

struct polarised_field {
    struct sim_scene *scene;
    uint32_t size, n_px, n_lights;
    double to_stored; /* stored = radiance x this */
    bool noisy;
    struct noise noise;
    uint16_t *halves;                             /* [kind W V H][light][tiles in turn] */
    const void **tiles;                           /* [kind][light][tile] */
    struct ls_picture *pictures[POLARISED_KINDS]; /* [light] */
    float *strength[SIM_MAX_CHANNELS];            /* [light] */
    struct ls_polarisation *a;                    /* [light] */
    struct ls_split *split;                       /* [light] */
    double white[3];                              /* p(polarised white, c) */
    struct ls_separated_field field;
};

/** @seed 0: without noise. a is that of the half vector at the centre. */
void polarised_field_init(struct polarised_field *f, const char *scene, uint32_t size,
                          uint32_t n_lights, uint64_t seed);
void polarised_field_finish(struct polarised_field *f);

/** a and coefficients from the half vector where a sphere of @radius_m shows each highlight. */
void polarised_field_factors(struct polarised_field *f, double radius_m);

/** Coefficients from other factors: @a of every light. */
void polarised_field_split(struct polarised_field *f, const struct ls_polarisation *a);

/** p(s, c) of a channel, V and H as the polarised white (their sum). */
void polarised_field_p(const struct polarised_field *f, uint32_t channel, double p[3]);

/** Sums of one row of weights [n_px][3]; any NULL. */
void polarised_field_sums(const struct polarised_field *f, const float *row, float *d, float *s,
                          float *c);

/** The gained mosaic of light @light: @kind 0 W, 1 V, 2 H. */
void polarised_field_mosaic(const struct polarised_field *f, uint32_t kind, uint32_t light,
                            float *out);

/** The demosaiced sum row[i] R(i) of the noisy pictures W. */
void polarised_field_white(const struct polarised_field *f, const float *row, float *out);

/** True R of a channel under light @i in stored units, through mosaic and demosaic, no noise;
 * without the mosaic in @plain (NULL allowed). */
void polarised_field_truth(const struct polarised_field *f, uint32_t light, uint32_t channel,
                           float *plain, float *out);

/** The specular part of that, in W. */
void polarised_field_specular(const struct polarised_field *f, uint32_t light, float *out);

/** sum row[i] R(i) of a channel, the same way; with the noise of one picture if @noisy. */
void polarised_field_sphere(struct polarised_field *f, const float *row, uint32_t channel,
                            bool noisy, float *out);

/** Eq. 1's ratio of a channel, [n_px][3]: @separated by ls_separate_remainder, else F/V of W. */
void polarised_field_ratio(struct polarised_field *f, uint32_t channel, bool separated,
                           float *ratio);

#endif
