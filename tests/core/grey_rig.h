/*
 * grey_rig: merged pictures of a simulated rig with a ball at its centre, made in process: the
 * simulator's sensor noise, the real merge, darks and all. For tests of calibration.
 */
#ifndef LS_TESTS_CORE_GREY_RIG_H
#define LS_TESTS_CORE_GREY_RIG_H

#include "core/pinhole.h"
#include "core/sphere_outline.h"
#include "sim/scene.h"

#include <stdint.h>

struct grey_rig_options {
    const char *scene; /* "grey", "chrome" */
    uint64_t seed;
    double gain_sigma;
    uint32_t n_cameras;
    const char *channels;  /* letters of W R A G C B V H, in the rig's order */
    uint32_t size_px;      /* of every camera; the ball is 0.78 of that */
    const char *cfa;       /* "RG" or "mono" */
    double exposure_scale; /* of the exposure times: 1 for grey, less for chrome */
};

struct grey_rig {
    struct grey_rig_options options;
    struct sim_scene *scene;
    uint32_t n_channels, n_lights, n_pixels;
    struct ls_pinhole camera[SIM_MAX_CAMERAS];
    double camera_m[SIM_MAX_CAMERAS][3];
    struct ls_sphere sphere;
    float *dark[SIM_MAX_CAMERAS][3]; /* per exposure */
    uint64_t sequence;
};

/** Conditions: (channel, light) alone at full duty, then (channel, all lights) at @sphere_duty,
 * then (channel, group g: lights i % n_groups == g) at @group_duty. */
struct grey_rig *grey_rig_create(const struct grey_rig_options *options, double sphere_duty,
                                 uint32_t n_groups, double group_duty);
void grey_rig_destroy(struct grey_rig *rig);

uint32_t grey_rig_light(const struct grey_rig *rig, uint32_t channel, uint32_t light);
uint32_t grey_rig_full(const struct grey_rig *rig, uint32_t channel);
uint32_t grey_rig_group(const struct grey_rig *rig, uint32_t channel, uint32_t group,
                        uint32_t n_groups);

/** Photograph a condition and merge it. @e, @validity: [n_pixels]. */
void grey_rig_picture(struct grey_rig *rig, uint32_t camera, uint32_t condition, float *e,
                      uint8_t *validity);

void grey_rig_position(const struct grey_rig *rig, uint32_t light, double position_m[3]);

#endif
